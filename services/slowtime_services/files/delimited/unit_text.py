"""Recognition of texts that are units, of any quantity, behind or below names of columns."""

import re

from slowtime_services.files.record import looks_like_unit
from slowtime_services.files.units import unit_of

LONGEST = 24
"""Characters of the longest text that is looked at as a unit [1]."""
_SYMBOL = (
    r"(?:[nuµμmcdk]|micro|milli|kilo)?(?:strain|ohms?|gauss|bar|pa|hz|gal|rad|sec|ms|m|s|g|n|v|a|"
    r"w|t|j|ω|ε|e)"
    r"|[mg]pa|[mg]hz|[µu]str|°[cfk]?|deg[cf]?|degrees?|min|hr?|lb[fs]?|kip|psi|ksi|in|inch(?:es)?|"
    r"ft|feet|mils?|volts?|amp(?:ere)?s?|newtons?|lsbs?|counts?|digits?|bits?|dbv?|rpm|sps|vdc|"
    r"vac|ppm|lux|dps|cm|mm|km"
)
_FACTOR = rf"\(?(?:{_SYMBOL})(?:[-+]?[1-4])?\)?"
_UNIT = re.compile(
    rf"(?:\d+(?:\.\d*)?(?:e[+-]?\d+)?\s*)?{_FACTOR}(?:\s*[/.*·\s]\s*{_FACTOR})*"
    r"(?:\s*(?:rms|peak|pk|pp|p-p|pk-pk|0-p))?"
)
_WHOLE = frozenset("% ‰ raw adc adu unit units - au a.u. arb".split())


def is_unit(text: str) -> bool:
    """Whether a text is a unit: of motion, or a product of known symbols with their powers.

    Examples
    --------
    >>> [is_unit(text) for text in ("m/s^2", "kN/mm²", "mV/V", "deg/s", "10^-3 g")]
    [True, True, True, True, True]
    >>> [is_unit(text) for text in ("1", "x", "roof", "LGR S/N: 12")]
    [False, False, False, False]
    """
    plain = text.strip().casefold()
    if not plain or len(plain) > LONGEST or re.fullmatch(r"\W*\d+\W*", plain):
        return False
    if plain in _WHOLE or looks_like_unit(plain) or unit_of(plain) is not None:
        return True
    for mark, digit in zip("⁻¹²³", "-123", strict=True):
        plain = plain.replace(mark, digit)
    return _UNIT.fullmatch(plain.replace("**", "").replace("^", "")) is not None
