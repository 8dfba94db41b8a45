"""The AsyncAPI document of the streams, as `openapi.json` is of REST.

`python -m slowtime_schemas.asyncapi` writes it to `schemas/asyncapi.json`; the twin server
gives the same at `/api/v1/asyncapi.json`. It speaks as slowtime: what sensors and edges send is
received, what the twin sends is sent.
"""

import functools
import importlib.metadata
import json
import sys
from typing import Any

from .batches import MARK
from .codec import REASONS
from .frozen import folder, schema_text
from .messages import Message
from .raw_header import RawHeader
from .streams import (
    ABOUT,
    FATIGUE,
    FEATURES,
    FORMER_ROOT,
    RAW,
    REGISTRATION,
    REQUESTS,
    STREAMS,
    Stream,
    alive_key,
    request_key,
)

Node = dict[str, Any]

PARAMETERS: dict[str, Node] = {
    "site": {"description": "Where assets stand together.", "examples": ["lab"]},
    "partition": {
        "description": "First byte of the SHA-256 of the asset's name in UTF-8, 0 to 255.",
        "examples": ["174"],
    },
    "asset": {"description": "One structure of the site.", "examples": ["beam"]},
}
ANSWERED_BY: dict[str, tuple[str, Stream | None]] = {
    "account": ("edge", None),
    "features": ("edge", FEATURES),
    "raw": ("edge", RAW),
    "about": ("edge", ABOUT),
    "fatigue": ("edge", FATIGUE),
    "flush": ("edge", None),
    "registration": ("twin", REGISTRATION),
}
"""Who answers each of `REQUESTS`, and the stream whose message the answer is."""

_ATTACHMENT = (
    "Beside the payload, as the Zenoh attachment: one byte of format and flags, the sender's "
    "clock in nanoseconds as an unsigned 64-bit integer, little-endian. What is recorded is "
    "the payload alone."
)


def document() -> Node:
    """Make the document, of AsyncAPI 3.0.0."""
    schemas: dict[str, Node] = {}
    channels = {stream.name: _channel(stream) for stream in STREAMS}
    channels |= {f"request_{what}": _request_channel(what) for what in REQUESTS}
    channels["alive"] = _address(alive_key("{site}", "{asset}")) | {
        "description": "A Zenoh liveliness token: there as long as the edge agent lives.",
        "messages": {"token": {"summary": "No payload.", "payload": {"maxLength": 0}}},
    }
    messages = {stream.name: _message(stream, schemas) for stream in STREAMS}
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "slowtime streams",
            "version": importlib.metadata.version("slowtime"),
            "description": "What edge agents and the twin server say to each other, over "
            f"Eclipse Zenoh. {_ATTACHMENT} Keys of the former version, "
            f"{FORMER_ROOT}/SITE/ASSET/STREAM, are read as well. What is refused is counted by "
            "reason: " + "; ".join(f"`{word}`, {says}" for word, says in REASONS.items()) + ".",
            "license": {
                "name": "Apache-2.0",
                "url": "https://www.apache.org/licenses/LICENSE-2.0",
            },
        },
        "defaultContentType": "application/json",
        "servers": {
            "router": {
                "host": "127.0.0.1:7447",
                "protocol": "zenoh",
                "description": "A Zenoh router; `tls/` with the keys of `slowtime keys`.",
            }
        },
        "channels": channels,
        "operations": {_named(stream): _operation(stream) for stream in STREAMS}
        | {f"request_{what}": _request(what) for what in REQUESTS},
        "components": {"messages": messages, "schemas": schemas},
    }


def text() -> str:
    """Write the document as the file has it."""
    return json.dumps(document(), indent=1, ensure_ascii=False) + "\n"


def _named(stream: Stream) -> str:
    return f"{'send' if stream.sender == 'twin' else 'receive'}_{stream.name}"


def _address(key: str) -> Node:
    return {"address": key, "parameters": PARAMETERS}


def _channel(stream: Stream) -> Node:
    return _address(stream.key("{site}", "{asset}")) | {
        "description": stream.says,
        "messages": {stream.name: {"$ref": f"#/components/messages/{stream.name}"}},
    }


def _operation(stream: Stream) -> Node:
    channel = f"#/channels/{stream.name}"
    return {
        "action": "send" if stream.sender == "twin" else "receive",
        "channel": {"$ref": channel},
        "summary": stream.says,
        "messages": [{"$ref": f"{channel}/messages/{stream.name}"}],
    }


def _message(stream: Stream, schemas: dict[str, Node]) -> Node:
    kind: type[Message] = stream.message or RawHeader
    described = _schema_of(kind, schemas)
    rate = stream.nominal_rate_hz
    more: Node = {} if rate is None else {"x-nominal-rate-hz": rate}
    if stream is FEATURES:
        more["x-batch"] = (
            f"Several messages in one payload: {MARK!r}, then raw DEFLATE of a JSON object "
            "with the texts between numbers, and the numbers in columns."
        )
    if stream.message is None:
        # Four magic bytes, the header's length, the header, the samples: see `raw`.
        more["x-header"] = described
        described = {"type": "string", "format": "binary", "description": kind.__doc__ or ""}
    return {
        "name": stream.name,
        "title": kind.__name__,
        "summary": stream.says,
        "contentType": stream.encoding,
        "payload": described,
        "x-version": kind.VERSION,
        "x-recorded": stream.recorded,
        "x-max-bytes": stream.max_bytes,
        **more,
    }


def _schema_of(kind: type[Message], schemas: dict[str, Node]) -> Node:
    """Add a frozen schema and its parts to `schemas`, and return a reference to it."""
    whole: Node = json.loads(schema_text(kind.MESSAGE, kind.VERSION))
    whole.pop("$schema")
    parts: dict[str, Node] = whole.pop("$defs", {})
    for name, part in {kind.__name__: whole, **parts}.items():
        if schemas.setdefault(name, (moved := _with_new_references(part))) != moved:
            raise ValueError(f"Two schemas are called {name}. Give one of them another name.")
    return {"$ref": f"#/components/schemas/{kind.__name__}"}


def _with_new_references(node: Any) -> Any:
    """Let references lead to where the parts are now."""
    if isinstance(node, list):
        return [_with_new_references(part) for part in node]
    if not isinstance(node, dict):
        return node
    return {
        key: value.replace("#/$defs/", "#/components/schemas/")
        if key == "$ref"
        else _with_new_references(value)
        for key, value in node.items()
    }


def _request_channel(what: str) -> Node:
    messages: dict[str, Node] = {
        "query": {
            "summary": "Parameters of the Zenoh selector; the query has no payload.",
            "payload": {"type": "object", "additionalProperties": {"type": "string"}},
        }
    }
    whole = {"type": "integer", "minimum": 0}
    if what == "flush":
        messages["answer"] = {
            "payload": {
                "type": "object",
                "required": ["sent"],
                "properties": {"sent": whole},
            }
        }
    elif ANSWERED_BY[what][1] is None:
        messages["answer"] = {
            "payload": {
                "type": "object",
                "required": ["boot", "first", "last"],
                "properties": {
                    "boot": {"type": "string"},
                    "first": whole,
                    "last": whole,
                    "ack_version": whole,
                    "withheld": {"type": "boolean"},
                    "damaged": {
                        "type": "array",
                        "items": {
                            "type": "array",
                            "items": whole,
                            "minItems": 2,
                            "maxItems": 2,
                        },
                    },
                },
            }
        }
    return _address(request_key("{site}", "{asset}", what)) | {
        "description": REQUESTS[what],
        "messages": messages,
    }


def _request(what: str) -> Node:
    who, stream = ANSWERED_BY[what]
    asked = f"#/channels/request_{what}"
    place = asked if stream is None else f"#/channels/{stream.name}"
    name = "answer" if stream is None else stream.name
    return {
        "action": "send" if who == "edge" else "receive",
        "channel": {"$ref": asked},
        "summary": REQUESTS[what],
        "messages": [{"$ref": f"{asked}/messages/query"}],
        "reply": {
            "channel": {"$ref": place},
            "messages": [{"$ref": f"{place}/messages/{name}"}],
        },
    }


@functools.cache
def served() -> bytes:
    """Give the document as it is served, made once."""
    return json.dumps(document(), ensure_ascii=False).encode()


if __name__ == "__main__":
    path = folder().parent / "asyncapi.json"
    path.write_text(text())
    sys.stdout.write(f"{path} written\n")
