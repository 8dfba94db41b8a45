"""Grouping of spectral lines into harmonic series of rotating machines."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from scipy.special import bdtrc

from slowtime.identification.estimates import Measured

HIGHEST_ORDER = 60
"""Largest order of a harmonic."""

LOWEST_OF_A_FAMILY = 8
"""Largest order of the lowest line of a family."""

CHANCE = 1e-3
"""Largest probability of a family among unrelated lines."""

RESOLUTION_SHARE = 0.1
"""Least error of a line, relative to the resolution of the record [1]: machine speeds vary."""

REACH = 3.0
"""Largest distance of a line from its multiple [standard deviations]."""


@dataclasses.dataclass(frozen=True, slots=True)
class HarmonicFamily:
    """Lines at multiples of one base frequency.

    Parameters
    ----------
    members
        Which of the lines given belong, counted from 0.
    orders
        Of which multiple each is.
    p_chance
        Probability that as many of so many unrelated lines would meet multiples of some base.
    """

    base_hz: Measured
    members: tuple[int, ...]
    orders: tuple[int, ...]
    p_chance: float


def group_into_families(
    lines: tuple[Measured, ...], *, resolution_hz: float
) -> tuple[HarmonicFamily, ...]:
    """Group lines into harmonic series; a line belongs to at most one.

    Every line over 1, 2, ... and every difference of two lines is tried as a base. Unrelated
    lines meet a multiple of a base b within their error e with probability 2 e / b; the chance
    of a family is the binomial one of so many meetings, times the number of bases tried.

    The least probable by chance come first; `resolution_hz` is one over the duration of the
    record.

    Examples
    --------
    >>> found = group_into_families(tuple(Measured(f, 0.001) for f in (9.9, 16.7, 29.7, 49.5)),
    ...                  resolution_hz=0.01)
    >>> [(round(family.base_hz.value, 3), family.orders) for family in found]
    [(9.9, (1, 3, 5))]
    """
    value = np.array([line.value for line in lines])
    error = np.array([np.hypot(line.sd, RESOLUTION_SHARE * resolution_hz) for line in lines])
    free = np.arange(len(lines))
    found: list[HarmonicFamily] = []
    while len(free) >= 2:
        family = _most_surprising(value[free], error[free])
        if family is None or family.p_chance > CHANCE:
            break
        members = tuple(int(free[i]) for i in family.members)
        found.append(dataclasses.replace(family, members=members))
        free = np.setdiff1d(free, members)
    return tuple(found)


def _most_surprising(value: np.ndarray, error: np.ndarray) -> HarmonicFamily | None:
    bases = [b for b in _bases(value) if b > 2.0 * REACH * error.max()]
    found = [family for base in bases if (family := _family(base, value, error, len(bases)))]
    # Halves of a base explain as much with higher orders, and are more accidental.
    return min(found, key=lambda f: (f.p_chance, -f.base_hz.value), default=None)


def _bases(value: np.ndarray) -> Iterator[float]:
    for i, line in enumerate(value):
        for order in range(1, LOWEST_OF_A_FAMILY + 1):
            yield float(line / order)
        for other in value[:i]:
            yield float(abs(line - other))


def _family(
    base: float, value: np.ndarray, error: np.ndarray, tried: int
) -> HarmonicFamily | None:
    """Members within reach of multiples of a base that is fitted to them as they join."""
    order = np.maximum(np.round(value / base), 1.0)
    # A base read off a line carries that line's error, magnified at higher orders.
    near = np.abs(value - order * base) < REACH * error * (1.0 + order / order.min())
    for _ in range(3):
        near &= order <= HIGHEST_ORDER
        if np.count_nonzero(near) < 2:
            return None
        weight = near / error**2
        base = float(weight @ (order * value) / (weight @ order**2))
        order = np.maximum(np.round(value / base), 1.0)
        near = np.abs(value - order * base) < REACH * error
    members = np.flatnonzero(near & (order <= HIGHEST_ORDER))
    if len(members) < 2 or np.gcd.reduce(order[members].astype(int)) > 1:
        return None
    # The base takes the freedom of one line: that one meets its multiple in any case.
    meets = min(1.0, float(np.mean(2.0 * REACH * error)) / base)
    chance = float(bdtrc(len(members) - 2, len(value) - 1, meets)) * tried
    sd = 1.0 / np.sqrt(np.sum((order[members] / error[members]) ** 2))
    return HarmonicFamily(
        Measured(base, float(sd)),
        tuple(int(i) for i in members),
        tuple(int(n) for n in order[members]),
        min(chance, 1.0),
    )
