"""Dry friction laws: Coulomb, Stribeck, and those that build up over a path or with play."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects.kind import Friction, Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, levels

MOST_SPEED, LEAST_RISE = 0.7, 1.1
"""Stribeck speed over the highest seen, from which friction has not fallen by seven eighths;
friction of sticking over that of sliding, below which it has not fallen to speak of."""


def coulomb(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Sliding friction that is the same at every speed (Coulomb).

    `p`: friction of sliding [N].
    """
    return float(p[0])


def stribeck(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Sliding friction that falls as speed grows (Stribeck).

    `p`: friction of sliding [N], friction of sticking [N], Stribeck speed [m/s].
    """
    ratio = v / p[2]
    return float(p[0] + (p[1] - p[0]) * math.exp(-ratio * ratio))


def sliding_with_drag(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of sliding and of drag, which grows with the square of speed [N]."""
    return float(p[0] + p[1] * v * v)


def creeping(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Friction that has no sticking, as its sign turns smoothly with the speed [N]."""
    return float(p[0] * math.tanh(v / p[1]))


def creeping_speeds(motion: Motion) -> list[Shape]:
    """Shares of the highest speed at which friction has three quarters of its level."""
    return [
        {"vs_m_per_s": share * fast}
        for fast in levels(motion.v, 0.99)
        for share in (0.002, 0.01, 0.04, 0.15)
    ]


def drags(motion: Motion) -> list[Shape]:
    """Coefficients of drag that make it a part of, or more than, the friction at high speed."""
    return [
        {"c2_n_s2_per_m2": ratio / fast**2}
        for fast in levels(motion.v, 0.95)
        for ratio in (0.3, 1.0, 3.0, 10.0)
    ]


def presliding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force in proportion to the bristles' deflection [N]."""
    return float(p[0] * z[0])


def dahl_deflection(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the deflection, as a share of that of sliding [1/s]."""
    return float((v - abs(v) * z[0]) / p[1])


def carried(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of the spring in series with the slider [N]."""
    return float(p[0] * min(max(z[0] / p[1], -1.0), 1.0))


def carried_until_sliding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of that spring's elongation, zero where the slider slides [m/s]."""
    # What a step went beyond that elongation is taken back over a tenth of it.
    beyond = abs(z[0]) - p[1]
    if beyond < 0.0 or v * z[0] <= 0.0:
        return float(v)
    return float(-10.0 * beyond / p[1] * v)


def beyond_play(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a slider that is carried along once the play is closed [N]."""
    if z[0] > p[1]:
        return float(p[0] * min((z[0] - p[1]) / p[2], 1.0))
    if z[0] < -p[1]:
        return float(p[0] * max((z[0] + p[1]) / p[2], -1.0))
    return 0.0


def within_play(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the way within the play and the contact, zero where the slider slides [m/s]."""
    # What a step went beyond that way is taken back over a tenth of the contact's.
    beyond = abs(z[0]) - p[1] - p[2]
    if beyond < 0.0 or v * z[0] <= 0.0:
        return float(v)
    return float(-10.0 * beyond / p[2] * v)


def lugre(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of bristles that bend and are damped [N]."""
    ratio = v / p[2]
    limit = 1.0 + (p[1] / p[0] - 1.0) * math.exp(-ratio * ratio)
    rate = v - abs(v) * z[0] / limit
    return float(p[0] * z[0] + p[4] * rate)


def lugre_deflection(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the bristles' deflection, as a share of that of sliding [1/s]."""
    ratio = v / p[2]
    limit = 1.0 + (p[1] / p[0] - 1.0) * math.exp(-ratio * ratio)
    return float((v - abs(v) * z[0] / limit) / p[3])


def presliding_paths(motion: Motion) -> list[Shape]:
    """Parts of the motion over which friction builds up."""
    return each(
        "presliding_m",
        [share * top for top in levels(motion.e, 0.99) for share in (0.02, 0.08, 0.25, 0.6)],
    )


def plays(motion: Motion) -> list[Shape]:
    """Parts of the motion that are play, and a contact that closes within a part of that."""
    return [
        {"play_m": share * top, "presliding_m": part * top}
        for top in levels(motion.e, 0.99)
        for share in (0.03, 0.1, 0.25, 0.5)
        for part in (0.02, 0.1)
    ]


def bristles(motion: Motion) -> list[Shape]:
    """Parts of the motion over which bristles bend, with friction that falls or does not."""
    return [
        {"static_n": ratio, "vs_m_per_s": 0.1 * fast, "presliding_m": share * top,
         "bristle_damping_n_s_per_m": 0.0}
        for top in levels(motion.e, 0.99)
        for fast in levels(motion.v, 0.99)
        for share in (0.02, 0.08, 0.25)
        for ratio in (1.0, 1.5)
    ]  # fmt: skip


def speeds(motion: Motion) -> list[Shape]:
    """List Stribeck speeds, and ratios of sticking to sliding friction."""
    # The speeds are shares of the highest one: a place that sticks most of the time has no
    # meaningful median speed.
    return [
        {"static_n": ratio, "vs_m_per_s": part * highest}
        for highest in levels(motion.v, 0.99)
        for part in (0.02, 0.06, 0.2, 0.5)
        for ratio in (1.3, 2.0)
    ]


def fallen(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell whether friction fell with speed, and most of the way, in a motion."""
    falls = parameters["static_n"] > LEAST_RISE * parameters["friction_n"]
    return falls and parameters["vs_m_per_s"] < MOST_SPEED * float(np.abs(motion.v).max())


_SLIDING = Parameter(name="friction_n", unit="N", meaning="friction of sliding", low=0.0)
_STATIC = Parameter(name="static_n", unit="N", meaning="friction of sticking", low=0.0)
_SPEED = Parameter(
    name="vs_m_per_s", unit="m/s", meaning="Stribeck speed", low=0.0, nonzero=True
)
_PRESLIDING = Parameter(
    name="presliding_m", unit="m", meaning="path over which friction builds up", low=0.0,
    nonzero=True,
)  # fmt: skip

KINDS = (
    Kind(
        name="coulomb",
        title="Dry friction",
        family="friction",
        where="element",
        parameters=(_SLIDING,),
        equation="Fc sign(v), at v = 0 whatever up to Fc it takes to stick",
        source="Coulomb 1785",
        sentence="Dry friction holds the element until its force is overcome.",
        action=Friction(limit=coulomb),
        strength="friction_n",
    ),
    Kind(
        name="stribeck",
        title="Stick-slip friction",
        family="friction",
        where="element",
        parameters=(
            _SLIDING,
            _STATIC,
            _SPEED,
        ),
        equation="(Fc + (Fs − Fc) exp(−(v/vs)²)) sign(v), sticking up to Fs",
        source="Stribeck 1902; form of Bo and Pavelescu 1982",
        sentence="Dry friction that is greater at rest and at low speed.",
        action=Friction(limit=stribeck),
        strength="friction_n",
        scales=("static_n",),
        shapes=speeds,
        shown=fallen,
    ),
    Kind(
        name="friction_with_creep",
        title="Dry friction that creeps",
        family="friction",
        where="element",
        parameters=(
            _SLIDING,
            Parameter(
                name="vs_m_per_s", unit="m/s", meaning="speed of creep", low=0.0, nonzero=True
            ),
        ),
        equation="Fc tanh(v/vs)",
        source="Andersson, Söderberg and Björklund 2007",
        sentence="Dry friction whose sign turns smoothly with the speed, so that the element "
        "creeps where it should stick.",
        action=Law(force=creeping),
        strength="friction_n",
        shapes=creeping_speeds,
        contains=("coulomb",),
    ),
    Kind(
        name="friction_with_drag",
        title="Dry friction with drag",
        family="friction",
        where="element",
        parameters=(
            _SLIDING,
            Parameter(
                name="c2_n_s2_per_m2", unit="N s^2/m^2", meaning="coefficient of drag", low=0.0
            ),
        ),
        equation="(Fc + c2 v²) sign(v), at v = 0 whatever up to Fc it takes to stick",
        source="sum of Coulomb 1785 and quadratic drag, Morison et al. 1950",
        sentence="Dry friction, and beside it damping that grows with the square of speed.",
        action=Friction(limit=sliding_with_drag),
        strength="friction_n",
        scales=("c2_n_s2_per_m2",),
        shapes=drags,
        contains=("coulomb", "quadratic_damping"),
    ),
    Kind(
        name="dahl",
        title="Friction with presliding (Dahl)",
        family="friction",
        where="element",
        parameters=(_SLIDING, _PRESLIDING),
        equation="Fc w, ẇ = (v − |v| w)/x0",
        source="Dahl 1968",
        sentence="Dry friction that builds up smoothly over a short path after each reversal.",
        action=Law(force=presliding, rates=(dahl_deflection,)),
        strength="friction_n",
        shapes=presliding_paths,
        contains=("coulomb",),
    ),
    Kind(
        name="friction_in_series_with_spring",
        title="Friction in series with a spring (Jenkins)",
        family="friction",
        where="element",
        parameters=(_SLIDING, _PRESLIDING),
        equation="Fc z/x0, ż = v, but 0 where |z| = x0 and v z > 0",
        source="Jenkins 1962; Iwan 1966",
        sentence="A spring carries the element until a dry joint in series with it slides.",
        action=Law(force=carried, rates=(carried_until_sliding,)),
        strength="friction_n",
        shapes=presliding_paths,
        contains=("coulomb",),
    ),
    Kind(
        name="friction_with_play",
        title="Dry friction with play",
        family="friction",
        where="element",
        parameters=(
            _SLIDING,
            Parameter(name="play_m", unit="m", meaning="half of the free path", low=0.0),
            _PRESLIDING,
        ),
        equation="Fc clip((|z| − g)/x0, 0, 1) sign(z), ż = v, but 0 where |z| = g + x0 and "
        "v z > 0",
        source="a play operator (Krasnosel'skii and Pokrovskii 1989) in series with a slider",
        sentence="Dry friction acts only once a play has been crossed after each reversal.",
        action=Law(force=beyond_play, rates=(within_play,)),
        strength="friction_n",
        shapes=plays,
        contains=("coulomb", "friction_in_series_with_spring"),
    ),
    Kind(
        name="lugre",
        title="Friction with presliding and Stribeck effect (LuGre)",
        family="friction",
        where="element",
        parameters=(
            _SLIDING,
            _STATIC,
            _SPEED,
            _PRESLIDING,
            Parameter(
                name="bristle_damping_n_s_per_m",
                unit="N s/m",
                meaning="damping of the bristles",
                low=0.0,
            ),
        ),
        equation="Fc w + s1 x0 ẇ, x0 ẇ = v − |v| w/g, g = 1 + (Fs/Fc − 1) exp(−(v/vs)²)",
        source="Canudas de Wit et al. 1995",
        sentence="Dry friction that builds up over a short path and falls with speed.",
        action=Law(force=lugre, rates=(lugre_deflection,)),
        strength="friction_n",
        scales=("static_n", "bristle_damping_n_s_per_m"),
        shapes=bristles,
        contains=("coulomb", "stribeck", "dahl"),
    ),
)
