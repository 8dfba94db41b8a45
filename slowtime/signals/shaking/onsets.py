"""Finds events in a long record: the short-time average of power over the long-time one."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float


class Span(NamedTuple):
    """Rows of an event: from `first` up to, and without, `end`."""

    first: int
    end: int


def sta_lta(
    samples: Float[np.ndarray, "time channel"], short: int, long: int
) -> Float[np.ndarray, "time channel"]:
    """Compute the ratio of short- to long-time averages of squared samples, recursively.

    Parameters
    ----------
    samples
        Without offset, in any unit.
    short, long
        Time constants [samples].

    Returns
    -------
    The ratio [1]; 0 for the first `long` samples, in which the long average is not formed yet.

    References
    ----------
    M. Withers et al., "A comparison of select trigger algorithms for automated global seismic
    phase and event detection", Bulletin of the Seismological Society of America 88 (1998).
    """
    power = samples**2
    # The first sample starts no average: its square is one draw, and would be remembered.
    power[0] = 0.0
    averages = [
        scipy.signal.lfilter([1 / n], [1.0, 1 / n - 1.0], power, axis=0) for n in (short, long)
    ]
    tiny = np.finfo(float).tiny
    ratio = np.asarray(averages[0] / np.maximum(averages[1], tiny))
    ratio[:long] = 0.0
    return ratio


def spans_above(ratio: Float[np.ndarray, " time"], on: float, off: float) -> list[Span]:
    """Find where a ratio is from `on` upwards, until it falls below `off` [1]."""
    begins = _rises(ratio >= on)
    ends = _rises(ratio < off)
    spans: list[Span] = []
    for begin in begins:
        if spans and begin < spans[-1].end:
            continue
        later = ends[np.searchsorted(ends, begin) :]
        spans.append(Span(int(begin), int(later[0]) if later.size else len(ratio)))
    return spans


def merged(spans: list[Span], before: int, after: int, count: int) -> list[Span]:
    """Widen spans by rows before and after them, and join those that then touch."""
    joined: list[Span] = []
    for span in sorted(spans):
        first, end = max(span.first - before, 0), min(span.end + after, count)
        if joined and first <= joined[-1].end:
            joined[-1] = Span(joined[-1].first, max(end, joined[-1].end))
        else:
            joined.append(Span(first, end))
    return joined


def _rises(flags: Bool[np.ndarray, " time"]) -> np.ndarray:
    return np.flatnonzero(flags & ~np.concatenate(([False], flags[:-1])))
