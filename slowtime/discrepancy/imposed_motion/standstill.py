"""Samples of an imposed motion at which the element stands still, or its memory is unknown.

Friction holds any force within its limit while nothing moves, and hysteresis remembers a motion
from before the record. Neither tells anything of the law.
"""

from collections.abc import Sequence

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float

from slowtime.discrepancy.data.screening import Finding
from slowtime.dynamics.effects import Motion

from .records import ForceRecord

STILL_RANGE = 0.005
"""[share of the range of motion] Within which an element stands still. Source: over
`STILL_PERIODS` a sine covers at least 3.5 % of its range, even at its reversal."""
STILL_PERIODS = 0.12
"""[periods of the motion] For which it stays there. Source: see `STILL_RANGE`."""
FORGOTTEN_PATH = 0.25
"""[range of motion] Path from its first move after which an element has forgotten what was
before the record. Source: a decision; friction with play slides within a quarter of the range
wherever the record shows it sliding."""
STILL_FORCE = 0.2
"""[range of the force] Within which the force stays while nothing moves. Source: a decision;
transducers drift and seals relax by less, and a sensor that is stuck in the middle of a motion
sees the force go from one side to the other."""
JUMP = 0.02
"""[share of the range of motion] By which the motion goes on from a standstill at most. Source:
a decision: a sensor that comes back after it was stuck jumps by more."""
MIN_STILL = 5
"""[samples] Least length of the window of a standstill. Source: docs/what_decides.md: half and
double change no answer."""


def informative(motion: Motion) -> Bool[np.ndarray, " time"]:
    """Return the samples that tell something of the law; all if they are under a third."""
    span = float(np.ptp(motion.e))
    moving = ~_still(motion.e)
    path = np.cumsum(np.abs(np.diff(motion.e, prepend=motion.e[0])) * moving)
    way = np.sign(np.pad(motion.v, 1, mode="edge"))
    turns = (way[:-2] != way[1:-1]) | (way[1:-1] != way[2:])
    # Next to a reversal, the sign of the rate is within its error and friction jumps. Until
    # `FORGOTTEN_PATH` after the first move, memory is that of a motion before the record.
    kept = moving & (path >= FORGOTTEN_PATH * span) & ~turns
    if 3 * np.count_nonzero(kept) < len(kept):
        return np.ones(len(kept), dtype=bool)
    return np.asarray(kept)


def _still(e: Float[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
    """Mask the samples of a standstill, its whole window included."""
    rising = int(np.count_nonzero(np.diff(np.sign(e - np.median(e))) > 0))
    window = max(int(STILL_PERIODS * len(e) / max(rising, 1)), MIN_STILL) | 1
    window = min(window, len(e) // 4 | 1)
    reach = scipy.ndimage.maximum_filter1d(e, window) - scipy.ndimage.minimum_filter1d(
        e, window
    )
    calm = reach <= STILL_RANGE * float(np.ptp(e))
    return np.asarray(scipy.ndimage.binary_dilation(calm, np.ones(window, dtype=bool)))


def without_standstills(
    findings: Sequence[Finding], records: Sequence[ForceRecord]
) -> tuple[Finding, ...]:
    """Drop findings of equal samples that a standstill of the element explains."""
    return tuple(
        one
        for one in findings
        if one.fault not in ("stuck", "zero")
        or not all(any(_rests(record, span) for record in records) for span in one.spans_s)
    )


def _rests(record: ForceRecord, span_s: tuple[float, float]) -> bool:
    times, e, force = record.motion.times, record.motion.e, record.force
    half = 0.5 * float(times[1] - times[0])
    inside = np.flatnonzero((times >= span_s[0] - half) & (times < span_s[1] - half))
    if not len(inside):
        return False
    first, last = int(inside[0]), int(inside[-1])
    about = e[max(first - 1, 0) : last + 2]
    low, high = np.percentile(force[first : last + 1], [5, 95])
    return bool(np.ptp(about) <= JUMP * np.ptp(e) and high - low <= STILL_FORCE * np.ptp(force))
