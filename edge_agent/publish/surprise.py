"""Recognises readings that the ones before did not predict, which are sent without delay."""

import math
from collections import deque
from statistics import median

from slowtime_schemas.messages import Features

REMEMBERED = 20
"""Readings that predict the next one; a lasting change is news for about half as many."""

FEWEST = 8
"""Readings without which nothing is predicted: the spread of fewer is too uncertain."""

MAD_TO_SD = 1.4826
"""Standard deviation of a normal distribution per median absolute deviation [1]."""

LEAST_RELATIVE_SD = 1e-6
"""Relative standard deviation below which no frequency is known [1]."""

MOST_MODES = 64
"""Identities of modes that are followed, as many as a message may hold."""


class SurpriseCheck:
    """Compares the readings of one boot with their predecessors.

    Parameters
    ----------
    threshold_sd
        Deviation from the median of the last readings, in standard deviations of the reading
        and of their spread together, from which on a frequency is a surprise.
    """

    def __init__(self, threshold_sd: float) -> None:
        self._threshold_sd = threshold_sd
        self._frequencies: dict[int | None, deque[float]] = {}
        self._identified: deque[bool] = deque(maxlen=REMEMBERED)
        self._flags: deque[frozenset[str]] = deque(maxlen=REMEMBERED)

    def check(self, message: Features) -> bool:
        """Take a reading; whether it is one that was not predicted."""
        found = [self._lost_all_modes(message), self._has_new_flags(message)]
        for mode in message.modes:
            if mode.identity is None and len(message.modes) > 1:
                continue  # followed by nobody: it may be any mode
            frequency = mode.frequency_hz
            found.append(self._differs(mode.identity, frequency.value, frequency.sd))
        return any(found)

    def _lost_all_modes(self, message: Features) -> bool:
        before, identified = self._identified, bool(message.modes)
        lost = not identified and len(before) >= FEWEST and all(list(before)[-FEWEST:])
        before.append(identified)
        return lost

    def _has_new_flags(self, message: Features) -> bool:
        flags = frozenset(message.quality.flags)
        new = flags.difference(*self._flags) if len(self._flags) >= FEWEST else frozenset()
        self._flags.append(flags)
        return bool(new)

    def _differs(self, identity: int | None, value: float, sd: float) -> bool:
        before = self._frequencies.get(identity)
        if before is None:
            if len(self._frequencies) >= MOST_MODES:
                del self._frequencies[next(iter(self._frequencies))]
            before = self._frequencies[identity] = deque(maxlen=REMEMBERED)
        differs = False
        if len(before) >= FEWEST:
            middle = median(before)
            spread = MAD_TO_SD * median(abs(one - middle) for one in before)
            scale = math.hypot(sd, spread, LEAST_RELATIVE_SD * middle)
            differs = abs(value - middle) > self._threshold_sd * scale
        before.append(value)
        return differs
