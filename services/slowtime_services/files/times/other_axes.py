"""Columns that grow like a clock and are another axis: frequency, angle, distance, speed."""

import re

from .time_units import stated_scale, words_of

_FREQUENCY = re.compile(
    r"freq|fréq|frec|hertz|(?<![a-z])k?hz(?![a-z])|^\W*f\W*$|"
    r"^\W*period|(?<![a-z])period\W*$",
    re.I,
)
_OTHER = re.compile(
    r"angle|angular|winkel|degree|azimut|distan|abstand|depth|tiefe|profond|height|strain|"
    r"stress|dehnung|spannung|period|chainage|position|displ|force|kraft|load|length|speed|"
    r"veloc|volt|wavelen|temper|revol|phase|mileage|acc|"
    r"(?<![a-z])(?:deg|rad|rpm|u/min|pos|dist|order|station|stage|cycle|cycles)(?![a-z])",
    re.I,
)
_UNIT_BEHIND = frozenset(
    "m mm cm km ft in deg rad rpm hz khz pct percent v mv g n kn pa kpa mpa bar c kg".split()
)
"""Words at the end of a name that are units of another axis, as in ``x_mm``."""
_NO_UNIT = frozenset(("", "-", "1", "none", "#"))


def is_frequency_axis(name: str, unit: str) -> bool:
    """Whether a column is the axis of a spectrum, by its name and unit.

    Examples
    --------
    >>> [is_frequency_axis(name, "") for name in ("Frequency (Hz)", "f_Hz", "f", "Time")]
    [True, True, True, False]
    >>> is_frequency_axis("F", "kN")
    False
    """
    plain = unit.strip("[]() ").casefold()
    if plain in ("hz", "khz", "hertz"):
        return True
    if plain not in _NO_UNIT and stated_scale("", plain) is None:
        return False
    return bool(_FREQUENCY.search(name.replace("_", " ")))


def is_other_axis(name: str, unit: str) -> bool:
    """Whether name or unit say that a column which grows evenly is no clock.

    Examples
    --------
    >>> [is_other_axis(name, "") for name in ("Angle", "distance_m", "x_mm", "x", "")]
    [True, True, True, False, False]
    >>> is_other_axis("x", "mm"), is_other_axis("x", "ms")
    (True, False)
    """
    plain = unit.strip("[]() ").casefold()
    if plain not in _NO_UNIT and stated_scale("", plain) is None:
        return True
    spaced = name.replace("_", " ")
    words = words_of(name)
    behind = len(words) > 1 and words[-1] in _UNIT_BEHIND
    return is_frequency_axis(name, unit) or bool(_OTHER.search(spaced)) or behind
