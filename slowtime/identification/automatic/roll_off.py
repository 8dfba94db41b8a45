"""Where the filter of a logger, or of a decimation, begins to take the spectrum away.

Beyond that frequency a spectrum has the shape of the filter. A noise floor that falls within
the window of a mode would be taken for its skirt, and the roll-off for a mode.
"""

import numpy as np
from jaxtyping import Complex

PARTS = 200
"""Equal parts of the spectrum whose levels are compared, up to half the sampling rate."""

FALL_DB = 6.0
"""Fall below the quiet parts of the octave before, from which a filter is told [dB]. Half the
amplitude; levels of a part scatter by less than 1 dB in a record of 2,000 samples."""

BEGIN_DB = 1.0
"""Fall at which the roll-off is said to begin [dB]."""

QUIET = 0.1
"""Quantile of the levels of the octave before that counts as its quiet parts [1]."""

SAFE = 0.9
"""Share of the frequency below that is used [1]. A fall of less than `BEGIN_DB` still moves
damping: of a mode at 0.54 of half the rate of a record resampled by 5/4, by 2 standard
deviations; with this share by 0.2."""

LOWEST = 0.4
"""Lowest beginning of a roll-off, relative to half the sampling rate [1]: filters of loggers
and decimations begin above; a fall below is the structure's own."""


def roll_off_hz(
    transform: Complex[np.ndarray, "frequency channel"], nyquist_hz: float
) -> float:
    """Find where all channels fall below the quiet parts of the octave before, and stay there.

    Half the sampling rate [Hz] where there is none.
    """
    parts = np.array_split(np.arange(1, len(transform)), min(PARTS, len(transform) - 1))
    power = [np.median(np.abs(transform[part]) ** 2, axis=0) for part in parts]
    level = 10.0 * np.log10(np.maximum(power, np.finfo(float).tiny))
    count = len(level)
    highest_above = np.maximum.accumulate(level[::-1], axis=0)[::-1]
    for at in range(max(2, int(LOWEST * count)), count):
        quiet = np.quantile(level[at // 2 : at], QUIET, axis=0)
        if (highest_above[at] >= quiet - FALL_DB).any():
            continue
        while at > LOWEST * count and (level[at - 1] < quiet - BEGIN_DB).any():
            at -= 1
        return float(SAFE * at * nyquist_hz / count)
    return nyquist_hz
