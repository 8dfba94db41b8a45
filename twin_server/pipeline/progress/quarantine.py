"""Messages that were set aside: which they are, how many fit, and rows and events of them."""

from collections.abc import Iterable
from typing import Any

from twin_server.persist import AsideRow, Store
from twin_server.settings import ProgressSettings

KIND = "message_set_aside"
"""Kind of the event that a message was set aside."""

RELEASED, DROPPED = "message_released", "message_dropped"
"""Kinds of the events that a person released or dropped one."""


class Quarantine:
    """What is aside, as it is in the store.

    Parameters
    ----------
    settings
        How much is kept.
    """

    def __init__(self, store: Store, settings: ProgressSettings) -> None:
        self._store, self._settings = store, settings
        self._places: dict[str, set[tuple[str, int]]] = {}
        self._counts: dict[str, int] = {}
        self._bytes = self._kept = 0
        self.load()

    def load(self) -> None:
        """Read what is durable."""
        self._places, self._counts, self._bytes, self._kept = {}, {}, 0, 0
        for row in self._store.aside():
            self.note(row)

    def note(self, row: AsideRow) -> None:
        """Note a row that is durable."""
        if row.accepted:
            self._places.setdefault(row.twin, set()).add((row.boot, row.sequence))
        if not row.dropped:
            self._kept += 1
            self._counts[row.twin] = self._counts.get(row.twin, 0) + 1
            self._bytes += len(row.message)

    def has_place(self, twin_id: str, boot: str, sequence: int) -> bool:
        """Whether features have a place in the history, and no estimate."""
        return (boot, sequence) in self._places.get(twin_id, ())

    def has_any(self, twin_id: str) -> bool:
        """Whether features of a twin have a place without an estimate."""
        return twin_id in self._places

    def has_room(self, twin_id: str, size: int) -> bool:
        """Whether one more message of a twin may be set aside."""
        limits = self._settings
        return (
            self._kept < limits.max_aside
            and self._counts.get(twin_id, 0) < limits.max_aside_of_one
            and self._bytes + size <= limits.max_aside_bytes
        )

    def is_full(self, twin_id: str) -> bool:
        """Whether a twin that has messages aside may have no more."""
        return twin_id in self._counts and not self.has_room(twin_id, 0)

    def count(self, twin_id: str) -> int:
        """Return how many messages of a twin are aside."""
        return self._counts.get(twin_id, 0)

    def gauge(self) -> int:
        """Return how many messages are aside."""
        return self._kept


def sentence(row: AsideRow) -> str:
    """Describe a row to a person."""
    place = (
        "It has its place in the history, without an estimate."
        if row.accepted
        else "It was not taken into the history."
    )
    return (
        f"Message {row.sequence} of boot {row.boot} was set aside: {row.why}. {place} Other "
        "messages go on. Release it to try it again, or drop it (`slowtime twin quarantine`)."
    )


def listed(rows: Iterable[AsideRow]) -> list[dict[str, Any]]:
    """Return rows as REST shows them, the newest first."""
    return [
        {
            "number": row.ordinal,
            "id": row.twin,
            "boot": row.boot,
            "sequence": row.sequence,
            "set_ns": row.set_ns,
            "key": row.key,
            "why": row.why,
            "in_history": row.accepted,
            "bytes": len(row.message),
        }
        for row in sorted(rows, key=lambda row: -row.number)
        if not row.dropped
    ]
