"""Keeps signed heads elsewhere: a file, an HTTP address, a time-stamping authority.

A thread of its own sends. Each witness gets the newest head; one that it missed while it could
not be reached is vouched for by the next, which contains its hash.
"""

import contextlib
import http.client
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from slowtime_services.credentials.timestamps import (
    LARGEST,
    TimestampError,
    check_answer,
    request_of,
)
from slowtime_services.ledger import Head, last_head
from twin_server.settings import LedgerSettings

from .message import NotDeliveredError, connection_error_text
from .webhook import tls

logger = logging.getLogger(__name__)

RETRY_S = 30.0
"""Delay before a witness that failed is tried again [s]."""
ENDING_S = 5.0
"""How long a server that ends waits for its last head to be kept [s]."""
TIMEOUT_S = 20.0
"""How long the answer of a witness may take [s]."""


class _Target(NamedTuple):
    """One witness: its name, what keeps a head there, and how often at most [s]."""

    name: str
    keep: Callable[[Head], None]
    every_s: float


class HeadWitnesses:
    """Gives each signed head to the witnesses that the settings name."""

    def __init__(self, settings: LedgerSettings) -> None:
        self.failures = 0
        """Attempts that failed."""
        self._settings = settings
        self._pending: dict[str, Head] = {}
        self._due_s: dict[str, float] = {}
        self._changed, self._ending = threading.Condition(), False
        self._targets = list(_targets(settings))
        self._thread: threading.Thread | None = None

    @property
    def last(self) -> Head | None:
        """The last head in the file of heads; None without one.

        Raises
        ------
        ValueError
            If the file does not end with a head.
        """
        path = self._settings.witness_file
        if path is None or not path.is_file():
            return None
        return last_head(path)

    def take(self, head: Head) -> None:
        """Keep one more, without waiting."""
        if not self._targets:
            return
        with self._changed:
            self._pending.update({one.name: head for one in self._targets})
            self._changed.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="witnesses", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Wait a moment for what is on its way, and end."""
        with self._changed:
            self._ending = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(ENDING_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                due = self._due()
                if not due and self._ending:
                    return
                if not due:
                    self._changed.wait(RETRY_S if self._pending else None)
                    continue
                work = [(one, self._pending.pop(one.name)) for one in due]
            for one, head in work:
                self._keep(one, head)

    def _due(self) -> Sequence[_Target]:
        now_s = time.monotonic()
        return [
            one
            for one in self._targets
            if one.name in self._pending and self._due_s.get(one.name, now_s) <= now_s
        ]

    def _keep(self, one: _Target, head: Head) -> None:
        try:
            one.keep(head)
        except (OSError, NotDeliveredError, TimestampError) as error:
            self.failures += 1
            self._due_s[one.name] = time.monotonic() + RETRY_S
            logger.warning("Head %d could not be kept by %s: %s", head.number, one.name, error)
            with self._changed:
                self._pending.setdefault(one.name, head)
            return
        self._due_s[one.name] = time.monotonic() + one.every_s


def _targets(settings: LedgerSettings) -> Sequence[_Target]:
    found = []
    if (path := settings.witness_file) is not None:
        found.append(_Target(str(path), lambda head: _append(path, head), 0.0))
    if (url := settings.witness_url) is not None:
        found.append(_Target(url, lambda head: _send(url, head), 0.0))
    if (stamping := settings.timestamp_url) is not None:
        folder = settings.timestamp_folder
        found.append(
            _Target(
                stamping,
                lambda head: _stamp(stamping, folder, head),
                settings.timestamp_every_s,
            )
        )
    return found


def _written(head: Head) -> bytes:
    return json.dumps(head._asdict()).encode() + b"\n"


def _send(url: str, head: Head) -> None:
    _post(url, _written(head), "application/json")


def _append(path: Path, head: Head) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    is_cut = path.is_file() and not _ends_a_line(path)  # when its volume was full, say
    # Only appended to: the folder may be one where nothing can be overwritten.
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644), "wb") as file:
        file.write(b"\n" * is_cut + _written(head))
        file.flush()
        os.fsync(file.fileno())


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 1))
        return file.read() in (b"", b"\n")


def _stamp(url: str, folder: Path, head: Head) -> None:
    """Have a head stamped; keep the head and the answer beside it."""
    request = request_of(head.hashed)
    answer = _post(url, request.as_bytes(), "application/timestamp-query")
    check_answer(request, answer)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"head-{head.number}.json").write_bytes(_written(head))
    (folder / f"head-{head.number}.tsr").write_bytes(answer)


def _post(url: str, payload: bytes, kind: str) -> bytes:
    """POST some bytes to an address of the settings; no redirection is followed."""
    parts = urlsplit(url)
    assert parts.hostname is not None  # of the settings, which are checked
    connection: http.client.HTTPConnection
    if parts.scheme == "http":
        connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=TIMEOUT_S)
    else:
        connection = http.client.HTTPSConnection(
            parts.hostname, parts.port, timeout=TIMEOUT_S, context=tls(None)
        )
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    headers = {"Content-Type": kind, "User-Agent": "slowtime"}
    with contextlib.closing(connection):
        try:
            connection.request("POST", path, payload, headers)
            with connection.getresponse() as answer:
                body = answer.read(LARGEST)
                if not 200 <= answer.status < 300:
                    raise NotDeliveredError(f"It answered {answer.status}.")
        except (OSError, http.client.HTTPException) as error:
            raise NotDeliveredError(f"{connection_error_text(error)}.") from error
    return body
