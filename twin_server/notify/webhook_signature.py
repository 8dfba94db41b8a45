"""The signature of a webhook: HMAC-SHA256 over the time of sending and the body."""

import hashlib
import hmac

SHORTEST = 16
"""Bytes of a secret; a shorter one can be guessed."""


def signature(secret: bytes, timestamp: str, payload: bytes) -> str:
    """Sign a body as of a moment; the receiver computes the same and compares.

    Examples
    --------
    >>> signature(b"a secret of 16 b", "1795233600", b"{}")[:24]
    'v1=6de25c95607a1ad51813a'
    """
    signed = timestamp.encode() + b"." + payload
    return f"v1={hmac.new(secret, signed, hashlib.sha256).hexdigest()}"
