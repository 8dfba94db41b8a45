"""Time stamps by an authority (RFC 3161): requests, and their verification.

A time stamp shows that some bytes existed at a moment, also to those who do not trust who shows
them, nor their clock. The library, `rfc3161-client`, is an extra and imported only where used.
"""

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from rfc3161_client import TimeStampRequest, TimeStampResponse

LARGEST = 64 * 1024
"""Longest answer of an authority that is read [bytes]; with certificates it has some 6,000."""


class TimestampError(ValueError):
    """No time stamp, or one that does not show what it should."""


class Stamped(NamedTuple):
    """What a time stamp shows."""

    t: datetime.datetime
    """When the bytes existed at the latest."""
    serial: int


def request_of(said: bytes) -> "TimeStampRequest":
    """Make a request for a time stamp of some bytes, with a nonce.

    Raises
    ------
    TimestampError
        If the library is not installed.
    """
    _library()
    from rfc3161_client import HashAlgorithm, TimestampRequestBuilder

    builder = TimestampRequestBuilder().data(said)
    return builder.hash_algorithm(HashAlgorithm.SHA256).nonce(nonce=True).build()


def check_answer(request: "TimeStampRequest", answer: bytes) -> None:
    """Check that an answer grants what was asked; its signature is verified by `stamped`.

    Raises
    ------
    TimestampError
        If it does not.
    """
    found = _decoded(answer)
    asked = request.message_imprint.message
    if found.status != 0:
        raise TimestampError(f"The authority did not grant the time stamp: {found.status}.")
    told = found.tst_info
    if told.message_imprint.message != asked or told.nonce != request.nonce:
        raise TimestampError("The authority stamped something else than was asked.")


def stamped(said: bytes, answer: bytes, authority: Path) -> Stamped:
    """Verify a time stamp of some bytes.

    Parameters
    ----------
    authority
        Certificate of the root that the authority's certificate leads to, PEM.

    Raises
    ------
    TimestampError
        If it is not of these bytes, or not by this authority.
    """
    _library()
    from cryptography.x509 import load_pem_x509_certificate
    from rfc3161_client import VerificationError, VerifierBuilder

    found = _decoded(answer)
    try:
        root = load_pem_x509_certificate(authority.read_bytes())
        VerifierBuilder().add_root_certificate(root).build().verify_message(found, said)
    except (VerificationError, ValueError, OSError) as error:
        raise TimestampError(
            f"The time stamp is not one of this head by {authority}: {error}."
        ) from error
    return Stamped(found.tst_info.gen_time, found.tst_info.serial_number)


def _decoded(answer: bytes) -> "TimeStampResponse":
    _library()
    from rfc3161_client import decode_timestamp_response

    try:
        return decode_timestamp_response(answer)
    except ValueError as error:
        raise TimestampError(f"This is no answer of RFC 3161: {error}.") from error


def _library() -> None:
    try:
        import rfc3161_client  # noqa: F401
    except ImportError as error:
        raise TimestampError(
            "Time stamps need a library: pip install 'slowtime[timestamps]'."
        ) from error
