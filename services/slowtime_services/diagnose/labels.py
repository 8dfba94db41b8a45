"""Labels and phrases that report, page and terminal share."""

import re

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.effects.effect_catalogue import catalogue
from slowtime_schemas.files.diagnosis import Estimated

UNIT = re.compile(r"(?:_(?:n|m[23]?|s2?|kg|hz|rad|c|per))+$")
"""A unit at the end of a parameter's name."""

WHOLE = re.compile(r"(?<![\w.,])\d{5,}(?!\w)")
"""Whole part of a number, of so many digits that its thousands are set apart."""

SHORT_S = 0.1
"""Times below are written in milliseconds [s]."""


def named(effect: str) -> str:
    """Name an effect as a person reads it.

    Examples
    --------
    >>> named("gap_one_sided")
    'gap one sided'
    """
    return effect.replace("_", " ")


def labelled(parameter: str, unit: str) -> str:
    """Name a parameter as a person reads it, without its unit, which its number carries.

    Examples
    --------
    >>> labelled("friction_n", "N"), labelled("k3_n_per_m3", "N/m^3"), labelled("n", "")
    ('friction', 'k3', 'n')
    >>> labelled("friction_n", "N m"), labelled("t_jump_s", "s"), labelled("drift_total", "g")
    ('friction', 't jump', 'drift total')
    """
    return (UNIT.sub("", parameter) if unit else parameter).replace("_", " ")


def meaning_of(kind: str, parameter: str, unit: str) -> str:
    """Name a parameter by its meaning; one of an effect of an owner by its own name.

    Examples
    --------
    >>> meaning_of("coulomb", "friction_n", "N"), meaning_of("own_law", "friction_n", "N")
    ('friction of sliding', 'friction')
    """
    known = catalogue().get(kind)
    every = () if known is None else known.parameters
    meanings = {one.name: one.meaning for one in every}
    return meanings.get(parameter) or labelled(parameter, unit)


def placed(kind: str, name: str) -> str:
    """Name a place.

    Examples
    --------
    >>> placed("element", "j1"), placed("base", "base")
    ('element j1', 'the base')
    """
    return "the base" if kind == "base" else f"{kind} {name}"


def rare(chance: float) -> str:
    """Write a probability; very small ones as an upper bound.

    Parameters
    ----------
    chance
        Probability, from 0 to 1.

    Returns
    -------
    The probability with two digits.

    Examples
    --------
    >>> rare(0.034), rare(0.0)
    ('0.034', 'below 1e-12')
    """
    return f"{chance:.2g}" if chance >= 1e-12 else "below 1e-12"


def thousands_apart(text: str) -> str:
    """Separate the thousands of whole parts of numbers of five digits and more.

    Examples
    --------
    >>> thousands_apart("200000.2 ± 5.0 N/m^3"), thousands_apart("0.123456 ± 1e-05 m")
    ('200,000.2 ± 5.0 N/m^3', '0.123456 ± 1e-05 m')
    """
    return WHOLE.sub(lambda found: f"{int(found[0]):,}", text)


def number(estimated: Estimated) -> str:
    """Write a number with its standard deviation, to the digits that this leaves.

    Examples
    --------
    >>> number(Estimated(value=20.388, sd=0.14, unit="N"))
    '20.39 ± 0.14 N'
    >>> number(Estimated(value=1.0, sd=0.0))
    '1'
    >>> number(Estimated(value=0.011995, sd=2.3e-6, unit="s"))
    '11.9950 ± 0.0023 ms'
    """
    if estimated.unit == "s" and 0.0 < abs(estimated.value) < SHORT_S:
        thousand = {"value": 1e3 * estimated.value, "sd": 1e3 * estimated.sd, "unit": "ms"}
        estimated = Estimated(**thousand)
    if estimated.sd == 0:
        return f"{estimated.value:.6g} {estimated.unit}".rstrip()
    digits = f"{estimated.sd:.1e}"
    places = 1 - int(digits.partition("e")[2])
    if abs(estimated.value) < 1e7 and places <= 6:
        places = max(places, 0)
        text = f"{estimated.value:.{places}f} ± {estimated.sd:.{places}f}"
    else:
        text = f"{estimated.value:.5g} ± {estimated.sd:.2g}"
    return f"{text} {estimated.unit}".rstrip()


def raised(text: str) -> str:
    """Write powers of units as raised digits.

    Examples
    --------
    >>> raised("200 ± 5 N/m^3")
    '200 ± 5 N/m³'
    """
    return text.replace("^2", "²").replace("^3", "³").replace("^5", "⁵")


def rounded(values: Float[np.ndarray, " point"]) -> list[float | None]:
    """Round to six digits, enough for a chart; None for values that are not finite.

    Examples
    --------
    >>> rounded(np.array([1.23456789, np.nan]))
    [1.23457, None]
    """
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values.tolist()]
