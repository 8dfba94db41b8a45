"""Frequencies at which the parts of a rolling bearing meet a defect."""

import math
from typing import NamedTuple


class BearingFrequencies(NamedTuple):
    """Of a bearing whose outer race stands still [Hz].

    Parameters
    ----------
    outer_race, inner_race
        Rate at which rolling elements pass a point of each race.
    rolling_element
        Rate at which a point of a rolling element meets one and the other race: twice its spin.
    cage
        Rotation of the cage.
    """

    outer_race: float
    inner_race: float
    rolling_element: float
    cage: float


def bearing_frequencies(
    shaft_hz: float, elements: int, diameter: float, pitch: float, contact_angle_deg: float = 0
) -> BearingFrequencies:
    """Compute the frequencies for rolling without slip; slip lowers them by 1 to 2 %.

    Parameters
    ----------
    shaft_hz
        Rotation of the inner race [Hz].
    elements
        Number of rolling elements.
    diameter, pitch
        Of a rolling element, and of the circle of their centres, in the same unit.

    References
    ----------
    R. B. Randall and J. Antoni, "Rolling element bearing diagnostics: a tutorial", Mechanical
    Systems and Signal Processing 25 (2011) 485-520, table 1.
    """
    ratio = diameter / pitch * math.cos(math.radians(contact_angle_deg))
    return BearingFrequencies(
        outer_race=elements * shaft_hz / 2 * (1 - ratio),
        inner_race=elements * shaft_hz / 2 * (1 + ratio),
        rolling_element=pitch / diameter * shaft_hz * (1 - ratio**2),
        cage=shaft_hz / 2 * (1 - ratio),
    )
