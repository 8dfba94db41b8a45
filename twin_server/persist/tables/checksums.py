"""The tables with their columns, and the checksum of each row by which damage is noticed.

CRC-32 finds each change of up to 32 bits in a row, and misses one in four billion of others.
"""

import zlib
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from twin_server.persist.errors import DamagedStoreError


class SqlTable(NamedTuple):
    """A table of the store: its columns, and which checksum covers which of them."""

    name: str
    columns: tuple[str, ...]
    seals: tuple[tuple[str, tuple[str, ...]], ...]
    """Names of the checksum and of what it covers."""
    key: str
    """What its rows are in the order of."""
    places: tuple[tuple[int, ...], ...]
    """Of each checksum, the places of the columns that it covers."""

    @property
    def all_columns(self) -> tuple[str, ...]:
        """Columns and checksums."""
        return (*self.columns, *(name for name, _ in self.seals))

    def sealed(self, row: Sequence[object]) -> tuple[object, ...]:
        """Append the checksums to a row."""
        if len(row) != len(self.columns):
            raise ValueError(f"A row of {self.name} has {len(self.columns)} columns.")
        return (*row, *[seal(*[row[place] for place in places]) for places in self.places])

    def is_sound(self, row: Sequence[object]) -> bool:
        """Whether the checksums of a row of all columns hold."""
        count = len(self.columns)
        return self.sealed(row[:count])[count:] == tuple(row[count:])


def _table(name: str, columns: str, key: str, **seals: str) -> SqlTable:
    names = tuple(columns.split())
    covered = {n: tuple(c.split()) for n, c in seals.items()} or {"crc": names}
    places = tuple(tuple(map(names.index, of_one)) for of_one in covered.values())
    return SqlTable(name, names, tuple(covered.items()), key, places)


TWINS = _table("twins", "id place site asset registration checkpoint", "place")
RUNS = _table(
    "runs",
    "number site asset boot slow_time_unit next last last_t_ns told closed lost twin "
    "slow_last slow_rises",
    "number",
)
FEATURES = _table(
    "features",
    "id t_ns slow_time message state",
    "id",
    message_crc="id t_ns slow_time message",
    state_crc="id state",
)
DETAILS = _table(
    "details", "id changes body", "id", changes_crc="id changes", body_crc="id body"
)
LEVELS = _table("levels", "level id bucket", "level, id")
DIGESTS = _table("digests", "id count sha256", "id")
HELD = _table("held", "number sequence message", "number, sequence")
EVENTS = _table("events", "number twin site asset t_ns slow_time derived body", "number")
DIAGNOSES = _table(
    "diagnoses",
    "number twin asked_ns ended_ns state request error report page model",
    "number",
    crc="number twin asked_ns ended_ns state request error report",
    files_crc="number page model",
)
DELIVERIES = _table(
    "deliveries",
    "id twin receiver event kind severity reminder remind_s state tries created_ns due_ns "
    "ended_ns error body",
    "id",
)
ACKNOWLEDGEMENTS = _table("acknowledgements", "event twin t_ns by_whom principal note", "event")
ASSET_EVENTS = _table(
    "asset_events", "twin event number t_ns principal body", "twin, number, event"
)
COMPOSITES = _table("composites", "number composite t_ns principal body", "number")
LEDGER = _table("ledger", "twin count entries link", "twin, count")
HEADS = _table("heads", "number t_ns body", "number")
FATIGUE = _table("fatigue", "twin boot hour sequence t_ns message", "twin, boot, hour")
OUTLOOKS = _table("outlooks", "twin id slow_time body", "twin, id")
QUARANTINE = _table(
    "quarantine",
    "number twin boot sequence set_ns key why accepted dropped message",
    "number",
)
NUMBERS = _table("numbers", "what value", "what")
TABLES = (
    TWINS, RUNS, FEATURES, DETAILS, LEVELS, DIGESTS, HELD, EVENTS, DIAGNOSES, DELIVERIES,
    ACKNOWLEDGEMENTS, ASSET_EVENTS, LEDGER, HEADS, FATIGUE, COMPOSITES,
    QUARANTINE, OUTLOOKS,
    NUMBERS,
)  # fmt: skip


def seal(*values: object) -> int:
    """Checksum of some values of a row, their types and their limits included.

    Examples
    --------
    >>> seal(1, "a", b"b", None) == seal(1, "a", b"b", None)
    True
    >>> len({seal(1), seal(1.0), seal("1"), seal(b"1"), seal("a", "b"), seal("ab")})
    6
    """
    parts = [
        b"b%d%b" % (len(value), value)
        if type(value) is bytes
        else repr(value).encode("utf-8", "surrogatepass")
        for value in values
    ]
    return zlib.crc32(b"".join(parts))


def damaged(what: str) -> DamagedStoreError:
    """Make the error for damaged data, with advice."""
    return DamagedStoreError(
        f"{what} is damaged: its checksum is wrong, so its content is not used. Stop the "
        "server and run `slowtime db restore` with the last backup. Edge agents then resend "
        "the features that they still hold; all others are reported as lost."
    )


def opened(table: SqlTable, rows: Iterable[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Return the columns of all rows; the checksum of each row is verified."""
    count, found = len(table.columns), []
    for row in rows:
        if not table.is_sound(row):
            raise damaged(f"A row of {table.name} ({row[0]!r:.60})")
        found.append(tuple(row[:count]))
    return found
