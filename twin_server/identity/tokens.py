"""A file of tokens: each shown once, kept as a keyed hash, expired or revoked at once.

A token is 256 random bits behind a number by which it is found. The file holds its HMAC-SHA256
under a key that lies in a file of its own, so that neither file alone lets anybody test a
guess; a slow hash would add nothing against guessing 256 bits, and would let strangers keep
the server busy. Both files have mode 0600. The file is looked at for each request and read
when it has changed, so that a revocation holds from the next request on.
"""

import contextlib
import dataclasses
import datetime
import hashlib
import hmac
import json
import os
import re
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from slowtime_schemas.plain_text import plain_text
from slowtime_services.documents.document_files import read_json_file
from slowtime_services.operating_system import access_of_others, lock_file

from .principals import Principal, Scope

FORM = re.compile(r"slowtime_([0-9a-f]{8})_([A-Za-z0-9_-]{43})")
LONGEST = 8_192
"""Characters of a bearer token that is looked at; JWTs may be long."""


class WrongTokenFileError(ValueError):
    """A file of tokens that is not there, not whole, or readable by others."""


class RefusedTokenError(Exception):
    """A token that is refused; the text gives the holder the reason."""


@dataclasses.dataclass(frozen=True, slots=True)
class Token:
    """Stored form of a token."""

    id: str
    name: str
    scope: str
    sites: tuple[str, ...]
    hash: str = dataclasses.field(repr=False)
    created: str
    expires: str
    revoked: str | None = None

    def standing(self, now: datetime.datetime) -> str:
        """One of good, expired, revoked."""
        if self.revoked is not None:
            return "revoked"
        return "good" if now < datetime.datetime.fromisoformat(self.expires) else "expired"

    @property
    def principal(self) -> Principal:
        """Return the principal of the token."""
        until = datetime.datetime.fromisoformat(self.expires).timestamp()
        sites = None if "*" in self.sites else frozenset(self.sites)
        return Principal(f"{self.name} ({self.id})", Scope.of(self.scope), sites, until)


class TokenFile:
    """The tokens of a server.

    Parameters
    ----------
    path
        The file; its key is beside it, with ``.key`` after its name.
    now
        Seconds since 1970.
    """

    def __init__(self, path: Path, now: Callable[[], float] = time.time) -> None:
        self.path, self._now = path, now
        self._key_path = path.with_name(path.name + ".key")
        self._lock = threading.Lock()
        self._seen: tuple[int, ...] = ()
        self._tokens: dict[str, Token] = {}
        self._key = b""

    def check(self) -> None:
        """Read the file.

        Raises
        ------
        WrongTokenFileError
            If it cannot be used.
        """
        for path in (self.path, self._key_path):
            if not path.is_file():
                raise WrongTokenFileError(
                    f"There is no {path}. Make the first token: slowtime tokens add NAME "
                    f"--scope admin --site '*' --file {self.path}."
                )
            if mode := access_of_others(path):
                raise WrongTokenFileError(
                    f"Other users of this computer can use {path} (permissions {mode:03o} "
                    f"for them), which holds secrets. Run: chmod 600 {path}."
                )
        self._read()

    def all(self) -> tuple[Token, ...]:
        """Every token ever made, oldest first."""
        if self.path.exists():
            self._read()
        return tuple(self._tokens.values())

    def add(
        self, name: str, scope: str, sites: Sequence[str], lasts: datetime.timedelta
    ) -> str:
        """Make a token and return it: it can never be shown again.

        Raises
        ------
        ValueError
            Where its name has characters that cannot be seen.
        """
        plain_text(name)
        number = secrets.token_hex(4)
        text = f"slowtime_{number}_{secrets.token_urlsafe(32)}"
        now = datetime.datetime.fromtimestamp(self._now(), datetime.UTC)
        with self._changing() as tokens:
            tokens[number] = Token(
                number,
                name,
                Scope.of(scope).word,
                tuple(sites),
                self._hash(text),
                now.isoformat(timespec="seconds"),
                (now + lasts).isoformat(timespec="milliseconds"),
            )
        return text

    def revoke(self, number: str) -> Token:
        """Take a token back.

        Raises
        ------
        ValueError
            If there is none of that number.
        """
        now = datetime.datetime.fromtimestamp(self._now(), datetime.UTC)
        with self._changing() as tokens:
            if number not in tokens:
                raise ValueError(
                    f"No token has the number {number!r}. `slowtime tokens list` shows them."
                )
            when = tokens[number].revoked or now.isoformat(timespec="seconds")
            tokens[number] = dataclasses.replace(tokens[number], revoked=when)
            return tokens[number]

    def verify(self, text: str) -> Principal:
        """Return the principal of a token.

        Raises
        ------
        RefusedTokenError
            If it is none of ours, expired or revoked.
        """
        self._refresh()
        form = FORM.fullmatch(text)
        token = self._tokens.get(form.group(1)) if form else None
        # Compared even where there is nothing to compare with, so that time tells nothing.
        same = hmac.compare_digest(self._hash(text), token.hash if token else "0" * 64)
        if token is None or not same:
            raise RefusedTokenError("It is not known here.")
        standing = token.standing(datetime.datetime.fromtimestamp(self._now(), datetime.UTC))
        if standing != "good":
            raise RefusedTokenError(f"It is {standing}.")
        return dataclasses.replace(token.principal, still=lambda: self._is_good(token.id))

    def _is_good(self, number: str) -> bool:
        self._refresh()
        token = self._tokens.get(number)
        now = datetime.datetime.fromtimestamp(self._now(), datetime.UTC)
        return token is not None and token.standing(now) == "good"

    def _hash(self, text: str) -> str:
        return hmac.new(self._key, text.encode(), hashlib.sha256).hexdigest()

    def _refresh(self) -> None:
        try:
            found = os.stat(self.path)
        except OSError:
            with self._lock:  # without the file nobody is let in
                self._seen, self._tokens = (), {}
            return
        if (found.st_mtime_ns, found.st_size, found.st_ino) != self._seen:
            self._read()

    def _read(self) -> None:
        with self._lock:
            found = os.stat(self.path)
            try:
                kept = read_json_file(self.path)
                tokens = [Token(**t | {"sites": tuple(t["sites"])}) for t in kept["tokens"]]
                self._key = bytes.fromhex(self._key_path.read_text().strip())
            except (ValueError, TypeError, KeyError, OSError) as error:
                raise WrongTokenFileError(
                    f"{self.path} cannot be read ({type(error).__name__}). Restore it and its "
                    "key from a backup, or remove both and make new tokens."
                ) from None
            self._tokens = {token.id: token for token in tokens}
            self._seen = (found.st_mtime_ns, found.st_size, found.st_ino)

    @contextlib.contextmanager
    def _changing(self) -> Iterator[dict[str, Token]]:
        """Change the tokens, with no other process doing so, whole or not at all."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lock = self.path.with_name(f".{self.path.name}.lock")
        with os.fdopen(os.open(lock, os.O_WRONLY | os.O_CREAT, 0o600), "w") as held:
            lock_file(held.fileno(), wait=True)
            if not self._key_path.exists():
                _write(self._key_path, secrets.token_hex(32))
            if self.path.exists():
                self._read()
            else:
                self._key, self._tokens = bytes.fromhex(self._key_path.read_text()), {}
            changed = dict(self._tokens)
            yield changed
            kept = {"tokens": [dataclasses.asdict(token) for token in changed.values()]}
            _write(self.path, json.dumps(kept, indent=1))
            self._read()


def _write(path: Path, content: str) -> None:
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
