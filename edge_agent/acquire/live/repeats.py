"""Counts samples that repeat the one before: a sensor polled faster than it measures."""

import logging

import numpy as np

from edge_agent.acquire.live.counts import SampleCounts
from slowtime.signals.repeated_samples import find_hold

logger = logging.getLogger(__name__)

LOOKED_AT = 512
"""[rows] That are looked at together. Source: a tenth of them repeated is told from chance."""


class RepeatWatch:
    """Looks at rows as they came, before any filter, and warns once."""

    def __init__(self, tally: SampleCounts) -> None:
        self._tally, self._warned = tally, False
        self._rows: list[np.ndarray] = []

    def note(self, rows: np.ndarray) -> None:
        """Take rows that follow those before."""
        self._rows.append(rows)
        if sum(len(part) for part in self._rows) < LOOKED_AT:
            return
        joined = np.concatenate(self._rows)
        hold = find_hold(joined)
        self._rows = []
        if hold is None:
            return
        self._tally.add("samples_repeated", len(joined) - len(hold.first))
        if not self._warned:
            self._warned = True
            logger.warning(
                "%.0f %% of the samples repeat the one before in all channels: the sensor is "
                "polled faster than it measures, and images of modes will be taken for modes. "
                "Poll it %.3g times more slowly, or by its own clock.",
                100 * hold.share, hold.ratio,
            )  # fmt: skip
