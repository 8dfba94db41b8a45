"""Checks that no counter was set back, so that a number would be given twice."""

from typing import Any

from twin_server.persist.chains.coverage import COVERED
from twin_server.persist.tables.checksums import (
    DIAGNOSES,
    EVENTS,
    NUMBERS,
    QUARANTINE,
    opened,
)
from twin_server.persist.tables.counted import BITS, OVER_ALL_TWINS

from .chain_walk import Walk

_OF_ALL = {"composite": "composites", "run": "runs"}
"""Counters over all chains, and the tables whose numbers they give."""
_OF_TWINS = (EVENTS.name, DIAGNOSES.name, QUARANTINE.name)
"""Tables whose rows are counted for each twin (see `tables.counted`)."""


class Counters:
    """Greatest numbers that rows were ever given, of rows that are gone as well."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._may_exceed = False

    def take(self, owner: str, walked: Walk) -> None:
        """Note the numbers of one chain."""
        # Before a chain was renewed, rows may have gone that had greater numbers.
        self._may_exceed |= walked.basis > 0
        for what, table in _OF_ALL.items():
            self._note(what, walked, table)
        for table in _OF_TWINS:
            self._note(f"{table} of {owner}", walked, table, has_place=True)
            self._note(OVER_ALL_TWINS[table], walked, table)

    def _note(self, what: str, walked: Walk, table: str, *, has_place: bool = False) -> None:
        number = walked.greatest.get((COVERED[table].kind.encode(), has_place), 0)
        if number:
            self._last[what] = max(number, self._last.get(what, 0))

    def wrong(self, reader: Any) -> list[str]:
        """Return a sentence on each counter that is not at the last number given."""
        rows = reader.execute(f"select {', '.join(NUMBERS.all_columns)} from numbers")
        values = dict(opened(NUMBERS, rows))
        newest = reader.execute("select coalesce(max(number), 0) from runs").fetchone()[0]
        # The counter of boots is that of the next one, written where the last was deleted.
        values["run"] = max(values.get("run", 1) - 1, newest)
        for table in _OF_TWINS:
            given = [v >> BITS for what, v in values.items() if what.startswith(f"{table} of ")]
            self._last[f"{table} places"] = max(given, default=0)
        found = []
        for what in sorted(values.keys() | self._last.keys()):
            value, last = values.get(what, 0), self._last.get(what, 0)
            is_other = (what, value) not in (("check", 1), ("run", 0))
            if value != last and is_other and not (value > last and self._is_lax(what)):
                found.append(
                    f"the row {what} of numbers says {value}, but the last number given was "
                    f"{last}"
                )
        return found

    def _is_lax(self, what: str) -> bool:
        return self._may_exceed and not what.endswith(" places")
