"""Sidebands: lines at one distance from many multiples of a machine's speed.

Slip, belts and cages modulate the vibration of a machine, which puts lines beside its
harmonics. Each of them may be too weak or too near a strong line to be told from a mode by
itself; no structure explains that many of them are at one distance.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import bdtrc

from .families import CHANCE

LEAST_BINS = 3.0
"""Least distance of a sideband from its multiple [bins]: nearer is the main lobe of a tapered
tone, and what a wandering line leaves."""

REACH_BINS = 1.0
"""Largest deviation of a sideband from the common distance [bins]: peaks are located to half a
bin."""

FEWEST = 5
"""Least number of lines at one distance."""


@dataclasses.dataclass(frozen=True, slots=True)
class Sidebands:
    """Lines at one distance from multiples of one base frequency.

    Parameters
    ----------
    offset_hz
        Median distance from the multiples [Hz].
    members
        Which of the peaks given belong, counted from 0.
    p_chance
        Probability that as many of so many unrelated peaks would be at one distance.
    """

    offset_hz: float
    members: tuple[int, ...]
    p_chance: float


def group_into_sidebands(
    peaks_hz: Float[np.ndarray, " peak"], *, base_hz: float, resolution_hz: float
) -> tuple[Sidebands, ...]:
    """Group peaks by their distance from the nearest multiple of a base.

    The distance of each peak is tried. Unrelated peaks are within e of a distance with
    probability 4 e / b, b the base; the chance of a group is the binomial one, times the number
    of distances tried.

    Parameters
    ----------
    peaks_hz
        Frequencies of peaks [Hz].
    base_hz
        Speed of the machine [Hz].
    resolution_hz
        Of the record: one over its duration.

    Returns
    -------
    Groups, the least probable by chance first.

    Examples
    --------
    >>> peaks = np.array([3.1, 8.0, 12.0, 18.0, 22.0, 28.0, 32.0, 33.3])
    >>> found = group_into_sidebands(peaks, base_hz=10.0, resolution_hz=0.01)
    >>> [(group.offset_hz, group.members) for group in found]
    [(2.0, (1, 2, 3, 4, 5, 6))]
    """
    multiple = base_hz * np.maximum(np.round(peaks_hz / base_hz), 1.0)
    offset = np.abs(peaks_hz - multiple)
    # Below half of the base a peak is no sideband: its own motion may be what modulates.
    free = np.flatnonzero((offset > LEAST_BINS * resolution_hz) & (offset <= base_hz / 2))
    found: list[Sidebands] = []
    while len(free) >= FEWEST:
        near = np.abs(offset[free, None] - offset[free]) <= REACH_BINS * resolution_hz
        members = free[near[np.argmax(np.count_nonzero(near, axis=1))]]
        meets = min(1.0, 4.0 * REACH_BINS * resolution_hz / base_hz)
        # The peak whose distance is tried meets it in any case.
        chance = float(bdtrc(len(members) - 2, len(free) - 1, meets)) * len(free)
        if len(members) < FEWEST or chance > CHANCE:
            break
        found.append(
            Sidebands(float(np.median(offset[members])), tuple(members.tolist()), chance)
        )
        free = np.setdiff1d(free, members)
    return tuple(found)
