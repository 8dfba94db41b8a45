"""Checks the values of a live sensor as they came: repeated, clipped, stuck, coarse, hum."""

import logging
from collections.abc import Sequence

import numpy as np

from edge_agent.acquire.live.counts import SampleCounts
from slowtime.signals.repeated_samples import find_hold
from slowtime.signals.value_checks import hold_note, value_notes

logger = logging.getLogger(__name__)

LOOKED_AT = 512
"""[rows] That are looked at together for repetition. Source: a tenth of them repeated is told
from chance."""

CHECKED_S = 60.0
"""[s] Of which all values are checked. Source: hum is told from 32 s on."""

MOST_CHECKED = 1 << 16
"""[rows] That are checked at most, so that memory is bounded."""


class ValueWatch:
    """Looks at rows as they came, before any filter, and warns once of each fault.

    Repetition is counted throughout. All values are checked in the first minute, and again
    after twice the time, four times the time and so on.
    """

    def __init__(self, tally: SampleCounts) -> None:
        self._tally = tally
        self._warned: set[str] = set()
        self._rows: list[np.ndarray] = []
        self._checked: list[np.ndarray] = []
        self._names: Sequence[str] = ()
        self._rate_hz: float | None = None
        self._seen = self._due = 0

    def begin(self, names: Sequence[str], rate_hz: float) -> None:
        """Take names and rate [Hz] of the channels from here on."""
        self._names, self._rate_hz = names, rate_hz
        self._rows, self._checked, self._seen, self._due = [], [], 0, 0

    def note(self, rows: np.ndarray) -> None:
        """Take rows that follow those before."""
        self._check(rows)
        self._rows.append(rows)
        if sum(len(part) for part in self._rows) < LOOKED_AT:
            return
        joined = np.concatenate(self._rows)
        hold = find_hold(joined)
        self._rows = []
        if hold is None:
            return
        self._tally.add("samples_repeated", len(joined) - len(hold.first))
        self._warn("hold", hold_note(hold))

    def _check(self, rows: np.ndarray) -> None:
        """Collect rows where a check is due, and check as many as make a minute."""
        self._seen += len(rows)
        if self._rate_hz is None or self._seen <= self._due:
            return
        self._checked.append(rows)
        joined_rows = sum(len(part) for part in self._checked)
        if joined_rows < min(CHECKED_S * self._rate_hz, MOST_CHECKED):
            return
        self._due, columns = 2 * self._seen, np.concatenate(self._checked)
        self._checked = []
        for said in value_notes(columns, self._names, self._rate_hz):
            # One warning of each fault, whatever its share.
            self._warn("".join(letter for letter in said if not letter.isdigit()), said)

    def _warn(self, fault: str, said: str) -> None:
        if fault not in self._warned:
            self._warned.add(fault)
            logger.warning("%s", said)
