"""Numbers that count the rows of one twin, in tables whose keys are unique over all twins.

People see the number of an event or a diagnosis. Counted over all twins, the numbers of one
site would tell how much happens at the others. A key is therefore the place of a twin, which
nobody sees, and below it the count of its rows. Rows from before this was so have the place 0
and a count over all twins; the counts of twins that have such rows go on behind the last one.
"""

from collections.abc import Mapping

from .checksums import NUMBERS, SqlTable
from .statements import KEYS_PER_QUERY, Connection, last_number, rows_by_key, upsert

BITS = 32
"""Bits of the count; the place is above them."""

_COUNT = (1 << BITS) - 1

NUMBERED = f"(number & {_COUNT}) = ?"
"""Condition on the number of a row, to be asked beside its twin."""

OVER_ALL_TWINS = {"events": "event", "diagnoses": "diagnosis", "quarantine": "quarantine"}
"""What the last number over all twins was kept as, by table."""


def count_of(key: int) -> int:
    """Return the number that people see.

    Examples
    --------
    >>> count_of(7 << BITS | 3), count_of(118)
    (3, 118)
    """
    return key & _COUNT


def next_keys(writer: Connection, table: SqlTable, rows: Mapping[str, int]) -> dict[str, range]:
    """Take the next keys of twins.

    Parameters
    ----------
    rows
        How many keys each twin needs.
    """
    last = _last_keys(writer, table, list(rows))
    found = {
        twin: range(last[twin] + 1, last[twin] + 1 + count) for twin, count in rows.items()
    }
    upsert(writer, NUMBERS, [(_name(table, twin), keys[-1]) for twin, keys in found.items()])
    return found


def key_after(reader: Connection, table: SqlTable, twin: str, number: int) -> int:
    """Return the key behind which the rows of a twin lie that follow a number."""
    last = last_number(reader, _name(table, twin))
    if last is None:
        return number
    key = last & ~_COUNT | min(number, _COUNT)
    of_before = reader.execute(
        f"select max(number) from {table.name} where twin = ? and number <= ?", (twin, _COUNT)
    ).fetchone()[0]
    return number if number < (of_before or 0) else key


def _last_keys(writer: Connection, table: SqlTable, twins: list[str]) -> dict[str, int]:
    """Return the last key of each twin; one that has none yet gets a place."""
    names = {_name(table, twin): twin for twin in twins}
    known = rows_by_key(writer, NUMBERS, list(names))
    last = {names[name]: int(row[1]) for name, row in known.items()}
    new = [twin for twin in twins if twin not in last]
    if new:
        places = f"{table.name} places"
        place = last_number(writer, places) or 0
        counts = _counts_of_before(writer, table, new)
        for twin in new:
            place += 1
            last[twin] = place << BITS | counts.get(twin, 0)
        upsert(writer, NUMBERS, [(places, place)])
    return last


def _counts_of_before(writer: Connection, table: SqlTable, twins: list[str]) -> dict[str, int]:
    """Return where the counts of twins go on that have rows with a number over all twins."""
    last = last_number(writer, OVER_ALL_TWINS[table.name]) or 0
    found: dict[str, int] = {}
    for first in range(0, len(twins), KEYS_PER_QUERY):
        asked = twins[first : first + KEYS_PER_QUERY]
        rows = writer.execute(
            f"select twin, max(number) from {table.name} "
            f"where twin in ({','.join('?' * len(asked))}) group by twin",
            asked,
        ).fetchall()
        found |= {twin: max(number, last) for twin, number in rows}
    return found


def _name(table: SqlTable, twin: str) -> str:
    return f"{table.name} of {twin}"
