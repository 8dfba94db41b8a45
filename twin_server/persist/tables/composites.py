"""The table of composites, to which registrations are only appended."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .checksums import COMPOSITES, opened


class CompositeRow(NamedTuple):
    """One registration of a composite as it is kept.

    Parameters
    ----------
    number
        Counts all of a store, 0 before it is kept.
    t_ns
        When it was registered [ns since 1970-01-01 UTC].
    principal
        Who registered it.
    body
        The registration as JSON; empty where the composite was deleted.
    """

    number: int
    composite: str
    t_ns: int
    principal: str
    body: str


def insert(writer: Any, rows: Sequence[CompositeRow], following: int) -> None:
    """Keep rows under the numbers from `following` on."""
    names = COMPOSITES.all_columns
    sealed = [
        COMPOSITES.sealed(row._replace(number=following + at)) for at, row in enumerate(rows)
    ]
    if sealed:
        writer.executemany(
            f"insert into composites ({', '.join(names)}) "
            f"values ({','.join('?' * len(names))})",
            sealed,
        )


def read(reader: Any, composite: str | None) -> list[CompositeRow]:
    """Read the rows of one composite, or of all, in order."""
    where, parameters = ("", ()) if composite is None else ("where composite = ?", (composite,))
    rows = reader.execute(
        f"select {', '.join(COMPOSITES.all_columns)} from composites {where} order by number",
        parameters,
    )
    return [CompositeRow(*row) for row in opened(COMPOSITES, rows)]
