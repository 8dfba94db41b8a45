"""The table of composites, to which registrations are only appended."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .checksums import COMPOSITES, opened
from .statements import insert as insert_rows


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


def insert(writer: Any, rows: Sequence[CompositeRow], following: int) -> Sequence[CompositeRow]:
    """Keep rows under the numbers from `following` on, and return them so."""
    numbered = [row._replace(number=following + at) for at, row in enumerate(rows)]
    insert_rows(writer, COMPOSITES, numbered)
    return numbered


def read(reader: Any, composite: str | None) -> list[CompositeRow]:
    """Read the rows of one composite, or of all, in order."""
    where, parameters = ("", ()) if composite is None else ("where composite = ?", (composite,))
    rows = reader.execute(
        f"select {', '.join(COMPOSITES.all_columns)} from composites {where} order by number",
        parameters,
    )
    return [CompositeRow(*row) for row in opened(COMPOSITES, rows)]
