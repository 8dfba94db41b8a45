"""What the edges have made, kept outside of them; and whether the twin's account agrees."""

import contextlib
import json
import multiprocessing.connection
import threading
import time
from typing import Any, NamedTuple

Key = tuple[str, str, int]
"""Asset, boot, sequence."""


class Ledger:
    """Payloads by what they are: made at all, and kept by a spool."""

    def __init__(self) -> None:
        self.made: dict[Key, bytes] = {}
        self.kept: set[Key] = set()
        self._ends: list[Any] = []
        self._lock = threading.Lock()
        self._closed = False

    def add(self, end: Any) -> None:
        """Listen to one more edge."""
        with self._lock:
            self._ends.append(end)

    def read_all(self) -> None:
        """Note what edges tell, until closed; even what the dead have told."""
        while not self._closed:
            with self._lock:
                ends = list(self._ends)
            for end in multiprocessing.connection.wait(ends, 0.2) if ends else ():
                try:
                    self._note(end.recv_bytes())  # type: ignore[union-attr]
                except (EOFError, OSError):
                    with self._lock:
                        self._ends.remove(end)
            if not ends:
                time.sleep(0.1)

    def close(self) -> None:
        """Listen no more."""
        self._closed = True

    def _note(self, line: bytes) -> None:
        with contextlib.suppress(ValueError):
            content = json.loads(line[1:])
            key = (content["asset"], content["boot"], content["sequence"])
            with self._lock:
                self.made[key] = line[1:]
                if line[:1] == b"K":
                    self.kept.add(key)

    def snapshot(self) -> tuple[dict[Key, bytes], set[Key]]:
        """What is known now."""
        with self._lock:
            return dict(self.made), set(self.kept)


class Seen(NamedTuple):
    """What the twin's database says."""

    history: list[tuple[Key, bytes]]
    lost: list[tuple[str, str, int, int, str]]
    """Asset, boot, first, last, why."""


class Verdict(NamedTuple):
    """What the account says against the ledger; sound where all lists are empty."""

    doubled: list[Key]
    altered: list[Key]
    invented: list[Key]
    unaccounted: list[Key]
    contradicted: list[Key]
    """In history, and reported lost as well."""
    accepted: int
    lost: int
    made: int

    @property
    def faults(self) -> list[str]:
        """One line for each list that should be empty."""
        return [
            f"{len(found)} {name}, such as {found[:3]}"
            for name, found in self._asdict().items()
            if isinstance(found, list) and found
        ]


def judge(ledger: Ledger, seen: Seen) -> Verdict:
    """Hold the twin's history and its reported losses against what the edges have made."""
    made, kept = ledger.snapshot()
    history: dict[Key, bytes] = {}
    doubled = []
    for key, payload in seen.history:
        if key in history:
            doubled.append(key)
        history[key] = payload
    lost: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for asset, boot, first, last, _ in seen.lost:
        lost.setdefault((asset, boot), []).append((first, last))

    def reported(key: Key) -> bool:
        return any(a <= key[2] <= b for a, b in lost.get(key[:2], ()))

    return Verdict(
        doubled,
        [key for key, payload in history.items() if made.get(key, payload) != payload],
        [key for key in history if key not in made],
        sorted(key for key in kept if key not in history and not reported(key)),
        sorted(key for key in history if reported(key)),
        len(history),
        sum(b - a + 1 for ranges in lost.values() for a, b in ranges),
        len(made),
    )
