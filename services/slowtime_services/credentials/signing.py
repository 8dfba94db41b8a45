"""Ed25519 keys that sign heads of the ledger; the private one has a file of its own.

RFC 8032. A signature shows who wrote some bytes; it says nothing of whether they are true.
"""

import base64
import contextlib
import hashlib
import hmac
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Self

from slowtime_services.operating_system import access_of_others

from .credential_folder import CredentialsError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

PUBLIC = ".pub"
"""Behind the name of a private key's file: the public one beside it."""
_BYTES = 32


class Signer:
    """A private key.

    Parameters
    ----------
    key
        Of the Ed25519 kind.
    """

    def __init__(self, key: "Ed25519PrivateKey") -> None:
        from cryptography.hazmat.primitives.hashes import SHA256
        from cryptography.hazmat.primitives.kdf.hkdf import HKDF

        self._key = key
        self.public = base64.b64encode(key.public_key().public_bytes_raw()).decode()
        # A key of its own for each purpose (RFC 5869, section 3.2): a seal is no signature.
        derivation = HKDF(SHA256(), length=_BYTES, salt=None, info=b"slowtime ledger seal")
        self._seal_key = derivation.derive(key.private_bytes_raw())

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a private key that `make_key` wrote.

        Raises
        ------
        CredentialsError
            If it is not there, no such key, or others may read it.
        """
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        if not path.is_file():
            raise CredentialsError(f"There is no key {path}. Make one: slowtime db ledger key.")
        if access_of_others(path):
            mode = stat.S_IMODE(path.stat().st_mode)
            raise CredentialsError(
                f"{path} holds a secret, but other users of this computer can read it "
                f"(permissions {mode:04o}; must be 0600). Run: chmod 600 {path}. If "
                "somebody may have read it, create a new key with `slowtime db ledger key` "
                "and stop using this one."
            )
        key = None
        with contextlib.suppress(ValueError, TypeError):
            key = load_pem_private_key(path.read_bytes(), password=None)
        if not isinstance(key, Ed25519PrivateKey):
            raise CredentialsError(
                f"{path} is not an Ed25519 private key in PEM. Make one: slowtime db ledger "
                "key."
            )
        return cls(key)

    def sign(self, said: bytes) -> str:
        """Sign some bytes; the signature in base64."""
        return base64.b64encode(self._key.sign(said)).decode()

    def seal(self, said: bytes) -> bytes:
        """Return an authentication code (HMAC-SHA256) that only holders of the key can make.

        It costs a hundredth of a signature, and only holders of the key can verify it.
        """
        return hmac.digest(self._seal_key, said, "sha256")


def make_key(path: Path) -> str:
    """Make a key: the private one at `path`, the public one, which is given, beside it.

    Raises
    ------
    CredentialsError
        If there is a file of either name.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
    )

    beside = path.with_name(path.name + PUBLIC)
    for one in (path, beside):
        if one.exists():
            raise CredentialsError(f"{one} exists. Give a new file, or take that one away.")
    key = Ed25519PrivateKey.generate()
    path.parent.mkdir(parents=True, exist_ok=True)
    text = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(text)
    public = Signer(key).public
    beside.write_text(public + "\n")
    return public


def public_key(text: str) -> str:
    """Read a public key: itself, in base64, or its file.

    Raises
    ------
    CredentialsError
        If it is neither.
    """
    path = Path(text)
    given = path.read_text().strip() if path.is_file() else text.strip()
    with contextlib.suppress(ValueError):
        if len(base64.b64decode(given, validate=True)) == _BYTES:
            return given
    raise CredentialsError(
        f"{text:.80} is not a public key. Give the file that ends in {PUBLIC}, or its 44 "
        "characters."
    )


def is_signed(said: bytes, signature: str, public: str) -> bool:
    """Whether the holder of a public key's private one has signed these bytes."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        key = Ed25519PublicKey.from_public_bytes(base64.b64decode(public, validate=True))
        key.verify(base64.b64decode(signature, validate=True), said)
    except (InvalidSignature, ValueError):
        return False
    return True


def fingerprint(public: str) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of a public key: its short name."""
    return hashlib.sha256(public.encode()).hexdigest()[:16]
