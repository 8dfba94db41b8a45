"""Encodes messages, and decodes payloads or refuses them with a reason."""

from collections.abc import Mapping
from types import MappingProxyType

from pydantic import ValidationError
from pydantic_core import from_json, to_json

from .batches import is_batch
from .messages import Message
from .migrations import UnknownVersionError, migrate
from .raw import RawHeader, decode_raw
from .streams import Stream, parse_key

REASONS: Mapping[str, str] = MappingProxyType(
    {
        "too_large": "the payload is larger than its stream allows",
        "not_json": "the payload is not JSON",
        "batch": "several messages in one payload, where one is expected, or a damaged batch",
        "not_raw": "the payload is not a raw block, or is cut short",
        "not_finite": "a number is NaN or infinite",
        "unknown_version": "no version of the message that can be read here",
        "unknown_field": "a field that the message does not have",
        "invalid": "a field is missing, of the wrong type or out of range",
        "unknown_key": "no stream has such a key",
        "foreign_key": "the message speaks of another asset than the key it came on",
    }
)
"""Why a payload may be refused: a word to count by, and what it means."""


class Refused(ValueError):
    """A payload that is not accepted.

    Parameters
    ----------
    reason
        One of `REASONS`.
    sentence
        What was given, what is allowed, what to do.
    """

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


def encode(message: Message) -> bytes:
    """`message` as it travels; the raw block has its own form, see `raw.encode_raw`."""
    return message.__pydantic_serializer__.to_json(message)


def decode(stream: Stream, payload: bytes) -> Message:
    """Read the message in a payload of `stream`; of a raw block, its header.

    Raises
    ------
    Refused
        With a reason and a sentence, whatever is wrong with the payload.
    """
    if len(payload) > stream.max_bytes:
        raise Refused(
            "too_large",
            f"A {stream.name} message of {len(payload):,} bytes was given. Allowed: up to "
            f"{stream.max_bytes:,}. Send less at once.",
        )
    if stream.message is None:
        return _decode_raw(payload)
    if is_batch(payload):
        raise Refused(
            "batch",
            f"A batch of {stream.name} messages was given, or a damaged one. Allowed: one "
            "message. Unpack it with slowtime_schemas.batches.unpack.",
        )
    try:
        message = stream.message.model_validate_json(payload, strict=True)
    except ValidationError as error:
        return _older_or_refused(stream.message, payload, error)
    if "version" not in message.model_fields_set:
        raise Refused(
            "unknown_version",
            f"A {stream.name} message without a version was given. Send "
            f'"version": {stream.message.VERSION}.',
        )
    return message


def decode_sample(key: str, payload: bytes) -> Message:
    """Read the message that came on `key`; refused too where it speaks of another asset.

    Raises
    ------
    Refused
        With a reason and a sentence.
    """
    try:
        stream, site, asset = parse_key(key)
    except ValueError as error:
        raise Refused("unknown_key", str(error)) from error
    message = decode(stream, payload)
    if message.site != site or message.asset != asset:
        raise Refused(
            "foreign_key",
            f"A message of {message.twin_id} was given on the key of {site}.{asset}. Allowed: "
            "each asset on its own key. Correct site and asset in the sender's settings.",
        )
    return message


def _decode_raw(payload: bytes) -> RawHeader:
    try:
        return decode_raw(payload)[0]
    except ValueError as error:
        raise Refused("not_raw", f"{error} Send what encode_raw makes.") from error


def _older_or_refused(
    message: type[Message], payload: bytes, error: ValidationError
) -> Message:
    """Decode an older version, which the quick way refused; or say why it was refused."""
    content = _parse(payload)
    if not isinstance(content, dict):
        raise Refused(
            "invalid",
            f"A {type(content).__name__} was given. Allowed: a JSON object, the "
            f"{message.MESSAGE} message.",
        ) from error
    if content.get("version") == message.VERSION:
        raise _refusal(message, error) from error
    try:
        return message.model_validate_json(
            to_json(migrate(message.MESSAGE, content)), strict=True
        )
    except UnknownVersionError as unknown:
        raise Refused("unknown_version", str(unknown)) from unknown
    except ValidationError as still:
        raise _refusal(message, still) from still


def _parse(payload: bytes) -> object:
    try:
        return from_json(payload, allow_inf_nan=False)
    except ValueError as error:
        lenient = _is_json_with_nan(payload)
        raise Refused(
            "not_finite" if lenient else "not_json",
            f"{'NaN or infinity' if lenient else 'Something that is not JSON'} was given: "
            f"{error}. Allowed: JSON with finite numbers. It begins with {payload[:40]!r}.",
        ) from error


def _is_json_with_nan(payload: bytes) -> bool:
    try:
        from_json(payload, allow_inf_nan=True)
    except ValueError:
        return False
    return True


def _refusal(message: type[Message], error: ValidationError) -> Refused:
    """One sentence for the first of pydantic's complaints; the others are usually its echo."""
    complaints = error.errors(include_url=False)
    first = complaints[0]
    kinds = {complaint["type"] for complaint in complaints}
    reason = (
        "not_finite"
        if "finite_number" in kinds
        else "unknown_field"
        if kinds == {"extra_forbidden"}
        else "invalid"
    )
    where = ".".join(map(str, first["loc"])) or "the message as a whole"
    return Refused(
        reason,
        f"{message.MESSAGE}: at {where}, {first['input']!r:.80} was given: {first['msg']}. "
        f"{len(complaints)} fault(s) in all. What is allowed is in the schema, "
        f"json/{message.MESSAGE}/v{message.VERSION}.json.",
    )
