"""Hammer blows in a record of force: where they are, and which are of no use.

A blow is of no use if the hammer bounced (a second pulse within the block), if the next blow
falls into its block, if force or response reached the limit of the measuring range, or if the
block does not fit into the record.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float

TRIGGER = 0.2
"""[largest force] From which a blow is a blow. Source: common practice, 5-20 % of the range."""

BOUNCE = 0.05
"""[peak of the blow] From which a second pulse is a double hit. A bounce of 5 % bends the force
spectrum by as much."""

PULSE = 0.02
"""[peak of the blow] Below which the pulse is over."""

NOISE_FACTOR = 6.0
"""[standard deviations of the force at rest] Below which nothing counts as a pulse."""

STEEP = 4.0
"""[smallest step of the channel] Into or out of neighbouring samples at the largest value of
the record, from which these are a clipped top. The top of a slow vibration is flat as well
where the converter is coarse, but is reached by single steps of it."""

AT_REST = 0.3
"""[1] Motion just before the first blow over that after it, above which the structure was not
at rest. Source: judgement; the pulse itself begins before it reaches the threshold."""

PRE_SHARE = 0.02
"""[block] Before the blow, so that the pulse is seen from its very beginning."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """One blow.

    Parameters
    ----------
    first, last
        First sample of the block, and sample after its last.
    pulse
        First sample of the pulse and sample after its last.
    at_s
        Time of the peak [s].
    peak
        Largest force, in the unit of the record.
    ringing
        Size of the responses just before the blow over that just after it [1]: near 0 where the
        structure was at rest.
    refused
        Why the blow is of no use; empty where it is used.
    """

    first: int
    last: int
    pulse: tuple[int, int]
    at_s: float
    peak: float
    ringing: float
    refused: str


def find_hits(
    force: Float[np.ndarray, " time"],
    responses: Float[np.ndarray, "time output"],
    rate_hz: float,
    *,
    block_s: float | None = None,
    limits: Float[np.ndarray, " channel"] | None = None,
) -> tuple[Hit, ...]:
    """Find the blows of a record, and judge each.

    Parameters
    ----------
    block_s
        Length of a block [s]; by default from a blow to the next, the shortest such.
    limits
        Largest value that force and responses can have, where it is known. Otherwise an
        overload is told by neighbouring samples of the same, largest value.

    Raises
    ------
    ValueError
        Where the record holds no blow.
    """
    signed = _upright(force)
    threshold = max(TRIGGER * signed.max(), NOISE_FACTOR * _noise(signed))
    starts = _starts(signed, threshold, rate_hz)
    if len(starts) == 0 or signed.max() <= NOISE_FACTOR * _noise(signed):
        raise ValueError(
            f"No blow was found in {len(force)} samples of force (largest "
            f"{np.abs(force).max():.4g}). Give the channel of the hammer, or a record with "
            "blows."
        )
    length = _length(starts, len(force), rate_hz, block_s)
    overloaded = _overloads(np.column_stack([force, responses]), limits)
    found = []
    for start, following in itertools.pairwise([*map(int, starts), len(force)]):
        first = start - round(PRE_SHARE * length)
        hit = _judged(signed, overloaded, (first, first + length), (start, following), rate_hz)
        found.append(dataclasses.replace(hit, ringing=_ringing(responses, hit)))
    return tuple(found)


def rest_before(
    force: Float[np.ndarray, " time"], responses: Float[np.ndarray, "time output"]
) -> int:
    """Return how many samples of rest a record lacks that begins with its first blow.

    It is 0 where the record begins long enough before the blow, or the structure moves before
    it.
    """
    signed = _upright(force)
    threshold = max(TRIGGER * signed.max(), NOISE_FACTOR * _noise(signed))
    above = np.flatnonzero(signed >= threshold)
    # A recorder that is triggered by the hammer stores nothing before it; the structure was at
    # rest then, and force and responses may be continued by their levels.
    needed = int(np.ceil(PRE_SHARE * len(force))) + 2
    if not len(above) or above[0] >= needed:
        return 0
    start = int(above[0])
    level = np.median(responses, axis=0)
    before, after = responses[:start] - level, responses[start : start + needed] - level
    if start and np.mean(before**2) > AT_REST**2 * np.mean(after**2):
        return 0
    return needed


def _ringing(responses: np.ndarray, hit: Hit) -> float:
    """Return the size of the responses before the blow over that after it."""
    reach = max(4, (hit.last - hit.first) // 20)
    level = np.median(responses, axis=0)
    before = responses[max(hit.pulse[0] - reach, 0) : hit.pulse[0]] - level
    after = responses[hit.pulse[1] : hit.pulse[1] + reach] - level
    if len(before) == 0 or len(after) == 0:
        return 0.0
    return float(np.sqrt(np.mean(before**2) / max(float(np.mean(after**2)), 1e-300)))


def _upright(force: np.ndarray) -> np.ndarray:
    centred = force - np.median(force)
    return np.asarray(centred if centred.max() >= -centred.min() else -centred)


def _noise(signed: np.ndarray) -> float:
    """Return standard deviation of the force between blows, by the median of its size."""
    return 1.4826 * float(np.median(np.abs(signed)))


def _starts(signed: np.ndarray, threshold: float, rate_hz: float) -> np.ndarray:
    """Return the first sample of each blow; a bounce belongs to the blow before it."""
    above = np.flatnonzero((signed[1:] >= threshold) & (signed[:-1] < threshold)) + 1
    if len(above) < 2:
        return above
    gaps = np.diff(above)
    # A bounce follows within a small part of the usual distance of blows.
    usual = float(np.max(gaps))
    apart = np.concatenate([[True], gaps > min(0.2 * usual, 0.5 * rate_hz)])
    return np.asarray(above[apart])


def _length(starts: np.ndarray, count: int, rate_hz: float, block_s: float | None) -> int:
    if block_s is not None:
        length = round(block_s * rate_hz)
        if not 16 <= length <= count:
            raise ValueError(
                f"block_s={block_s:g} is {length} samples of a record of {count}. Give between "
                f"{16 / rate_hz:g} and {count / rate_hz:g} s."
            )
        return length
    gaps = np.diff(np.append(starts, count))
    usual = np.median(gaps)
    return int(min(gaps[gaps >= 0.5 * usual].min(), count) * (1.0 - PRE_SHARE))


def _overloads(
    channels: np.ndarray, limits: np.ndarray | None
) -> Bool[np.ndarray, "time channel"]:
    size = np.abs(channels)
    if limits is not None:
        return np.asarray(size >= 0.999 * np.asarray(limits))
    found = np.zeros(channels.shape, dtype=bool)
    for column, values in enumerate(channels.T):
        top = size[:, column] == size[:, column].max()
        edges = np.flatnonzero(np.diff(np.concatenate([[False], top, [False]])))
        steps = np.abs(np.diff(values, prepend=values[0], append=values[-1]))
        least = float(steps[steps > 0].min(initial=np.inf))
        for first, last in edges.reshape(-1, 2):
            steep = max(steps[first], steps[last]) > STEEP * least
            found[first:last, column] = last - first > 1 and steep
    return found


def _judged(
    signed: np.ndarray,
    overloaded: np.ndarray,
    block: tuple[int, int],
    starts: tuple[int, int],
    rate_hz: float,
) -> Hit:
    """Judge one blow by its block, its start and that of the next blow."""
    (first, last), (start, following) = block, starts
    length = last - first
    inside = signed[max(first, 0) : min(last, len(signed))]
    peak_at = start + int(np.argmax(signed[start : min(start + length // 4 + 2, len(signed))]))
    # The first pulse, even where the bounce is the greater.
    end_of_first = start + _ends(signed[start:last], PULSE * signed[peak_at])
    peak_at = start + int(np.argmax(signed[start : max(end_of_first, start + 1)]))
    peak = float(signed[peak_at])
    pulse = _pulse(signed, first, last, peak_at, peak)
    rest = signed[pulse[1] : min(last, following)]
    bounce = float(rest.max(initial=0.0))
    refused = ""
    if first < 0 or last > len(signed):
        refused = "its block reaches beyond the record"
    elif overloaded[first:last].any():
        which = int(np.argmax(overloaded[first:last].any(axis=0)))
        name = "the force" if which == 0 else f"response {which}"
        refused = f"overload of {name}"
    elif bounce > max(BOUNCE * peak, NOISE_FACTOR * _noise(inside)):
        refused = f"double hit, the second {100 * bounce / peak:.0f} % of the first"
    elif following < last and following < len(signed):
        later_s, block_s = (following - start) / rate_hz, length / rate_hz
        refused = f"the next blow comes {later_s:.3g} s later, in its block of {block_s:.3g} s"
    return Hit(
        first=first,
        last=last,
        pulse=pulse,
        at_s=peak_at / rate_hz,
        peak=peak,
        ringing=0.0,
        refused=refused,
    )


def _ends(tail: np.ndarray, level: float) -> int:
    below = np.flatnonzero(tail < level)
    return int(below[0]) if len(below) else len(tail)


def _pulse(
    signed: np.ndarray, first: int, last: int, peak_at: int, peak: float
) -> tuple[int, int]:
    """Return samples of the pulse: from and to where the force is small, with as much again."""
    level = max(PULSE * peak, 3.0 * _noise(signed))
    after = peak_at + _ends(signed[peak_at:last], level)
    before = peak_at - _ends(
        signed[peak_at : max(first, 0) - 1 if first > 0 else None : -1], level
    )
    wide = max(2, after - before)
    return max(first, before - wide, 0), min(after + wide, last)
