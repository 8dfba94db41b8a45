"""Units of motion: spellings in files, and factors to SI."""

import dataclasses
import re
from typing import Literal

from slowtime.signals.units import GRAVITY

Motion = Literal["acceleration", "velocity", "displacement"]

SI: dict[Motion, str] = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}
"""Unit that each quantity is turned into."""
VOLTS = {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e-3, "millivolt": 1e-3, "uv": 1e-6,
         "µv": 1e-6, "kv": 1e3}  # fmt: skip
COUNTS = frozenset(("", "count", "counts", "lsb", "digit", "digits", "raw", "adc"))
"""Units of numbers as a converter gives them."""
_LENGTHS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3,
    "um": 1e-6, "µm": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9, "in": 0.0254,
    "inch": 0.0254, "inches": 0.0254, "mil": 2.54e-5, "mils": 2.54e-5, "ft": 0.3048,
    "foot": 0.3048, "feet": 0.3048,
}  # fmt: skip
_GRAVITIES = {
    "g": GRAVITY, "gn": GRAVITY, "g0": GRAVITY, "g_n": GRAVITY, "gs": GRAVITY, "g's": GRAVITY,
    "mg": 1e-3 * GRAVITY, "milli-g": 1e-3 * GRAVITY, "ug": 1e-6 * GRAVITY,
    "µg": 1e-6 * GRAVITY, "g/10": 0.1 * GRAVITY, "gal": 1e-2, "gals": 1e-2, "mgal": 1e-5,
    "g-force": GRAVITY, "gforce": GRAVITY, "millig": 1e-3 * GRAVITY, "microg": 1e-6 * GRAVITY,
}  # fmt: skip
_SECOND = r"(?:s|sec|second|seconds)"
_PER_SQUARE = rf"/{_SECOND}2|/{_SECOND}/{_SECOND}|/\({_SECOND}2\)|[.*]?s-2|[.*]?sec-2|/s\*s|/ss"
_PER_SECOND = rf"/{_SECOND}|[.*]?s-1|[.*]?sec-1"
_LENGTH = "|".join(sorted(map(re.escape, _LENGTHS), key=len, reverse=True))
_OF_LENGTH = re.compile(
    rf"(?P<length>{_LENGTH})(?:(?P<square>{_PER_SQUARE})|(?P<once>{_PER_SECOND}))?"
)
_NUMBER = r"(?P<number>\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)?"
_TIMES = re.compile(
    r"[\[(]?\s*(?P<mantissa>\d+\.?\d*(?:e[+-]?\d+)?)?\s*[x×*·]?\s*"
    r"(?:10\s*(?:\^|\*\*)\s*\(?(?P<power>[+-]?\d{1,2})\)?)?\s*[*·×]?\s*(?P<rest>[^\W\d].*)"
)
"""A number in front of a unit, such as ``1e-3 m/s2`` and ``10^-3 g``."""
_OTHER_QUANTITY = re.compile(
    r"\b(?:mag[xyz]?|magnet\w*|gauss|weights?|\w*gewicht|mass|load(?:cell)?s?|forces?|\w*kraft)\b"
)
"""Words in names of channels whose ``g`` are grams, and whose ``mG`` are milligauss."""
_ACCELERATION = re.compile(r"\b(?:acc[xyz]?|accel\w*|\w*beschleunigung\w*|a[xyz]|g ?forces?)\b")
"""Words that say acceleration, whatever other words a name has."""
_NEW_WORD = re.compile(r"(?<=[^\W\d_A-Z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][^\W\d_A-Z])|[\W\d_]+")
"""Where a word of a name ends: before capitals, and at what is no letter."""


@dataclasses.dataclass(frozen=True, slots=True)
class Unit:
    """A unit of motion: the factor from its numbers to SI."""

    quantity: Motion
    factor: float


@dataclasses.dataclass(frozen=True, slots=True)
class Sensitivity:
    """Output of a sensor for one m/s^2, m/s or m.

    Parameters
    ----------
    of
        ``"V"`` for volts, ``"counts"`` for numbers of a converter.
    per_si
        Volts, or counts, per unit of SI.
    """

    quantity: Motion
    of: Literal["V", "counts"]
    per_si: float


def unit_of(text: str, channel: str = "") -> Unit | None:
    """Parse a unit of motion; None for others, and if the channel's name contradicts it.

    A number in front of the unit is part of its factor.

    Examples
    --------
    >>> unit_of("mm/s²")
    Unit(quantity='acceleration', factor=0.001)
    >>> unit_of("V"), unit_of("mG", "MagX")
    (None, None)
    >>> unit_of("g", "damaged_acc_1").quantity
    'acceleration'
    """
    times = _times(text)
    if times is not None:
        inner = unit_of(times[1], channel)
        return None if inner is None else Unit(inner.quantity, times[0] * inner.factor)
    plain = _normalized(text)
    if plain in _GRAVITIES:
        another = _names_other_quantity(channel)
        return None if another else Unit("acceleration", _GRAVITIES[plain])
    match = _OF_LENGTH.fullmatch(plain)
    if match is None:
        return None
    worth = _LENGTHS[match["length"]]
    if match["square"]:
        return Unit("acceleration", worth)
    return Unit("velocity" if match["once"] else "displacement", worth)


def _times(text: str) -> tuple[float, str] | None:
    """Split a number from the unit behind it; None where there is no number in front."""
    plain = text.strip().casefold().replace("⁻", "-")
    for high, digit in zip("³⁶⁹", "369", strict=True):
        plain = plain.replace(f"10-{high}", f"10^-{digit}")
    match = _TIMES.fullmatch(plain.rstrip(")]") if plain[:1] in ("(", "[") else plain)
    if match is None or (match["mantissa"] is None and match["power"] is None):
        return None
    factor = float(match["mantissa"] or 1.0) * 10.0 ** int(match["power"] or 0)
    return (factor, match["rest"]) if factor > 0 else None


def sensitivity_of(text: str) -> Sensitivity:
    """Read ``100 mV/g``, ``10.2 mV/(m/s^2)``, ``256 LSB/g`` or ``9.81 m/s^2/V``.

    Raises
    ------
    ValueError
        Where it is none.

    Examples
    --------
    >>> sensitivity_of("9.80665 mV/g")
    Sensitivity(quantity='acceleration', of='V', per_si=0.001)
    """
    plain = _normalized(text)
    match = re.match(rf"{_NUMBER}\s*(?P<rest>.+)", plain)
    number = float(match["number"] or 1.0) if match else 0.0
    rest = match["rest"] if match else ""
    top, _, below = rest.partition("/")
    signal, inverse = _signal(top), False
    motion = unit_of(below.removeprefix("(").removesuffix(")")) if signal else None
    if motion is None:
        over, _, last = rest.rpartition("/")
        signal, inverse = _signal(last), True
        motion = unit_of(over.removeprefix("(").removesuffix(")")) if signal else None
    if signal is None or motion is None or not 0 < number < 1e15:
        raise ValueError(
            f"{text!r} is not a valid sensitivity. Give volts or counts per unit "
            "of motion, such as "
            "100mV/g, 10.2mV/(m/s^2) or 256LSB/g."
        )
    of, worth = signal
    per_si = worth / (number * motion.factor) if inverse else number * worth / motion.factor
    return Sensitivity(motion.quantity, of, per_si)


def _names_other_quantity(channel: str) -> bool:
    words = _NEW_WORD.sub(" ", channel).casefold()
    return bool(_OTHER_QUANTITY.search(words)) and not _ACCELERATION.search(words)


def _signal(text: str) -> tuple[Literal["V", "counts"], float] | None:
    if text in VOLTS:
        return "V", VOLTS[text]
    return ("counts", 1.0) if text in COUNTS - {""} else None


def _normalized(text: str) -> str:
    """Lower case without blanks, brackets around it, and signs of powers."""
    plain = text.strip().casefold().replace("²", "2").replace("⁻", "-").replace("¹", "1")
    for sign in ("**", "^", "{", "}", " "):
        plain = plain.replace(sign, "")
    plain = plain.replace("·", ".").replace("⋅", ".").replace("μ", "µ")
    while len(plain) > 1 and plain[0] + plain[-1] in ("[]", "<>"):
        plain = plain[1:-1]
    whole = re.fullmatch(r"\(([^()]*)\)", plain)
    return whole[1] if whole else plain
