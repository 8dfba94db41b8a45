"""Finds spikes in samples of a vibration and bridges them.

A sample's deviation from the mean of its two neighbours is small for a vibration that is
sampled well, and large for a spike. It is judged against the usual deviation of its chunk, and
against that of the eight nearest samples but two: the start of a free decay is large compared
with its tail, but not with what follows it.
"""

import numpy as np
from jaxtyping import Bool, Float

REACH = 24
"""Samples on either side that can decide whether one is a spike [samples]. Source: derivation,
each of `PASSES` looks six samples further (five for the median, one for the deviation), and a
run of `LONGEST` is looked at beyond; the rest of 24 is margin."""
PASSES = 3
"""Passes in which spikes are sought, each after those found before are bridged [1]. Source:
judgement; no study is recorded."""
LONGEST = 3
"""Samples in a row that can be a spike; more are an event [samples]. Source: judgement; no
study is recorded."""
RELIABLE = 64
"""Samples from which the usual deviation of a chunk is taken without that of the chunk before
[samples]. Source: derivation, the median absolute deviation of n normal values has a relative
standard deviation of 1.17 / sqrt(n), 15 % of 64."""

Windows = Float[np.ndarray, "chunk time channel"]
Which = Bool[np.ndarray, "chunk time channel"]
Scales = Float[np.ndarray, "chunk channel"]


def bridged(windows: Windows, gone: Which) -> Windows:
    """Bridge missing samples by straight lines; by the nearest value at an end."""
    filled = windows.copy()
    places = np.arange(windows.shape[1])
    for chunk, channel in np.argwhere(gone.any(axis=1)):
        away = gone[chunk, :, channel]
        column = filled[chunk, :, channel]
        if away.all():
            column[:] = 0.0
        else:
            column[away] = np.interp(places[away], places[~away], column[~away])
    return filled


def usual_deviation(windows: Windows, before: Float[np.ndarray, " channel"] | None) -> Scales:
    """Robust standard deviation of the deviations from the neighbours' mean.

    Windows and the result are by chunk and channel, in the unit of the samples.
    """
    size = np.abs(_deviation(windows))
    # The mean deviation is larger in a signal that hardly ever moves. A short chunk is not
    # judged calmer than the one before.
    scales = np.maximum(1.4826 * np.median(size, axis=1), size.mean(axis=1))
    if windows.shape[1] < RELIABLE and before is not None:
        scales = np.maximum(scales, before)
    return np.asarray(scales)


def without_spikes(
    windows: Windows,
    fixed: Which,
    outside: Bool[np.ndarray, "chunk time"],
    scales: Scales,
    threshold: float,
) -> tuple[Windows, Which]:
    """Bridge outliers, and return where they were.

    Samples that are `fixed` have been bridged already and are not judged. Rows `outside` lie
    beyond the ends of the segment; what is next to an end has too few neighbours to be judged
    by, and is left. The threshold is in `scales`.
    """
    spikes = np.zeros_like(fixed)
    mended = windows
    for _ in range(PASSES):
        found = _standing_out(mended, outside, scales, threshold) & ~fixed & ~spikes
        if not found.any():
            break
        spikes |= found
        mended = bridged(windows, spikes)
    if not spikes.any():
        return windows, spikes
    # Two spikes side by side make their sound neighbours stand out as much as themselves.
    spikes &= np.abs(windows - mended) > threshold * scales[:, None]
    spikes = _short_runs(spikes)
    return bridged(windows, spikes), spikes


def _standing_out(
    windows: Windows,
    outside: Bool[np.ndarray, "chunk time"],
    scales: Scales,
    threshold: float,
) -> Which:
    """Mark samples whose deviation exceeds the usual one and is the largest of three."""
    size = np.abs(_deviation(windows))
    found: Which = size > threshold * scales[:, None]
    if not found.any():
        return found
    known = np.where(outside[:, :, None], size.max(axis=1, keepdims=True), size)
    found &= size > threshold * 1.4826 * _neighbours(known)
    found &= size >= np.maximum(np.roll(size, 1, axis=1), np.roll(size, -1, axis=1))
    return np.asarray(found & ~outside[:, :, None])


def _deviation(windows: Windows) -> Windows:
    """Each sample less the mean of its two neighbours; zero at the edges."""
    out = np.zeros_like(windows)
    out[:, 1:-1] = windows[:, 1:-1] - 0.5 * (windows[:, :-2] + windows[:, 2:])
    return out


def _neighbours(size: Windows) -> Windows:
    """Median over the samples two to five steps away on either side."""
    shifts = [np.roll(size, step, axis=1) for step in (-5, -4, -3, -2, 2, 3, 4, 5)]
    middle = np.partition(np.stack(shifts), (3, 4), axis=0)[3:5]
    return np.asarray(middle.mean(axis=0))


def _short_runs(spikes: Which) -> Which:
    """Leave out runs longer than `LONGEST`."""
    begins_long = spikes.copy()
    for step in range(1, LONGEST + 1):
        begins_long[:, :-step] &= spikes[:, step:]
        begins_long[:, -step:] = False
    inside = begins_long.copy()
    for step in range(1, LONGEST + 1):
        inside[:, step:] |= begins_long[:, :-step]
    return np.asarray(spikes & ~inside)
