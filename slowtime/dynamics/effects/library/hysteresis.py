"""Hysteretic forces (Bouc–Wen)."""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import levels


def bouc_wen(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a Bouc-Wen spring, less its initial linear force.

    `p`: stiffness that yields [N/m], elongation of yield [m], sharpness of the yield [1]; `z`:
    elongation of the yielding spring itself [m].
    """
    return float(p[0] * (z[0] - e))


def yielding_force(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a Bouc-Wen spring that the model lacks as a whole [N]."""
    return float(p[0] * z[0])


def yielding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the internal elongation of a Bouc-Wen spring [m/s]."""
    if v * z[0] <= 0.0:
        return float(v)
    return float(v * (1.0 - abs(z[0] / p[1]) ** p[2]))


def general_yielding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the hysteretic elongation with shape factors of either sign [m/s]."""
    size = abs(z[0]) ** p[3]
    return float(v - p[1] * abs(v) * z[0] * abs(z[0]) ** (p[3] - 1.0) - p[2] * v * size)


def degrading(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a spring that wears as it dissipates, less its straight line [N]."""
    return float(p[0] * (z[0] - e))


def degrading_yielding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of its own elongation: stiffness falls with the path that was dissipated [m/s]."""
    wear = 1.0 + p[3] * z[1]
    if v * z[0] <= 0.0:
        return float(v / wear)
    return float(v * (1.0 - (abs(z[0]) / p[1]) ** p[2]) / wear)


def dissipated(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the dissipated path, in elongations of yield [1/s]."""
    return float(max(z[0] * v, 0.0) / (p[1] * p[1]))


def pinching(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a yielding spring that is slack about its middle, less its straight line [N]."""
    slack = p[3] * math.exp(-((z[0] / (p[4] * p[1])) ** 2))
    return float(p[0] * ((1.0 - slack) * z[0] - e))


def signed_shapes(motion: Motion) -> list[Shape]:
    """Shape factors whose hysteretic elongation levels off, or opens, within the motion."""
    return [
        {"beta_per_mn": a / top, "gamma_per_mn": b / top, "n": 1.0}
        for top in levels(motion.e, 0.99)
        for scale in (0.4, 1.2, 3.5)
        for a, b in (
            (scale, 0.0), (scale, -0.7 * scale), (scale, -1.5 * scale), (0.4 * scale, -scale),
            (scale, scale), (scale, 2.0 * scale),
        )
    ]  # fmt: skip


def wears(motion: Motion) -> list[Shape]:
    """Elongations of yield, and wear by a tenth or by half over the motion."""
    return [
        {"zy_m": share * top, "n": 1.0, "wear": wear}
        for top in levels(motion.e, 0.99)
        for share in (0.15, 0.3, 0.6)
        for wear in (0.003, 0.03)
    ]


def pinches(motion: Motion) -> list[Shape]:
    """Elongations of yield, and a slackness of a half."""
    return [
        {"zy_m": share * top, "n": 1.0, "slackness": 0.5, "width": width}
        for top in levels(motion.e, 0.99)
        for share in (0.15, 0.3, 0.6)
        for width in (0.2, 0.6)
    ]


def yields(motion: Motion) -> list[Shape]:
    """List elongations at which the spring may yield, and how sharply."""
    return [
        {"zy_m": share * top, "n": n}
        for top in levels(motion.e, 0.99)
        for share in (0.15, 0.3, 0.6)
        for n in (1.0, 2.0)
    ]


_YIELDING = Parameter(name="kh_n_per_m", unit="N/m", meaning="stiffness that yields", low=0.0)
_YIELD = Parameter(name="zy_m", unit="m", meaning="elongation of yield", low=0.0, nonzero=True)
_SHARPNESS = Parameter(name="n", unit="", meaning="sharpness of the yield", low=0.5, high=20.0)

KINDS = (
    Kind(
        name="bouc_wen",
        title="Hysteresis",
        family="hysteresis",
        where="element",
        parameters=(
            _YIELDING,
            _YIELD,
            _SHARPNESS,
        ),
        equation="kh (z − e), ż = v (1 − |z/zy|ⁿ (1 + sign(v z))/2)",
        source="Bouc 1967; Wen 1976",
        sentence="Hysteresis: the spring yields and comes back on another path.",
        action=Law(force=bouc_wen, rates=(yielding,)),
        strength="kh_n_per_m",
        shapes=yields,
        joins=False,
    ),
    Kind(
        name="yielding_link",
        title="Yielding link",
        family="hysteresis",
        where="element",
        parameters=(_YIELDING, _YIELD, _SHARPNESS),
        equation="kh z, ż = v (1 − |z/zy|ⁿ (1 + sign(v z))/2)",
        source="Bouc 1967; Wen 1976",
        sentence="A spring that yields joins two points that the model does not join.",
        action=Law(force=yielding_force, rates=(yielding,)),
        strength="kh_n_per_m",
        shapes=yields,
        similar=("dahl", "friction_in_series_with_spring"),
        joins=True,
    ),
    Kind(
        name="bouc_wen_general",
        title="Hysteresis of general form",
        family="hysteresis",
        where="element",
        parameters=(
            _YIELDING,
            Parameter(name="beta_per_mn", unit="1/m^n", meaning="shape factor of dissipation"),
            Parameter(
                name="gamma_per_mn", unit="1/m^n", meaning="shape factor of the direction"
            ),
            Parameter(
                name="n",
                unit="",
                meaning="sharpness of the yield",
                low=1.0,
                high=20.0,
                natural=1.0,
            ),
        ),
        equation="kh (z − e), ż = v − β |v| |z|ⁿ⁻¹ z − γ v |z|ⁿ",
        source="Bouc 1967; Wen 1976; both signs: Ikhouane and Rodellar 2007",
        sentence="Hysteresis whose loops may bulge, thin out or stiffen towards their ends.",
        action=Law(force=bouc_wen, rates=(general_yielding,)),
        strength="kh_n_per_m",
        shapes=signed_shapes,
        contains=("bouc_wen", "dahl"),
        similar=("friction_in_series_with_spring",),
    ),
    Kind(
        name="bouc_wen_degrading",
        title="Hysteresis that degrades",
        family="hysteresis",
        where="element",
        parameters=(
            _YIELDING,
            _YIELD,
            _SHARPNESS,
            Parameter(
                name="wear", unit="", meaning="loss of stiffness per yield path", low=0.0
            ),
        ),
        equation="kh (z − e), ż = v (1 − |z/zy|ⁿ (1 + sign(v z))/2) / (1 + w ε), "
        "ε = ∫ max(z v, 0)/zy² dt",
        source="Baber and Wen 1981",
        sentence="The spring yields, and grows softer with the energy that it has dissipated.",
        action=Law(force=degrading, rates=(degrading_yielding, dissipated)),
        strength="kh_n_per_m",
        shapes=wears,
        contains=("bouc_wen",),
    ),
    Kind(
        name="bouc_wen_pinching",
        title="Hysteresis with pinching",
        family="hysteresis",
        where="element",
        parameters=(
            _YIELDING,
            _YIELD,
            _SHARPNESS,
            Parameter(
                name="slackness",
                unit="",
                meaning="share of the force lost in the middle",
                low=0.0,
                high=1.0,
            ),
            Parameter(
                name="width",
                unit="",
                meaning="width of the slack part over the yield",
                low=0.0,
                nonzero=True,
            ),
        ),
        equation="kh ((1 − s exp(−(z/(w zy))²)) z − e), ż as of bouc_wen",
        source="pinching as by Baber and Noori 1985, in the form of a slack middle",
        sentence="The spring yields, and slips with little force about its middle.",
        action=Law(force=pinching, rates=(yielding,)),
        strength="kh_n_per_m",
        shapes=pinches,
        contains=("bouc_wen",),
    ),
)
