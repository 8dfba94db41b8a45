"""Nonlinear springs: hardening, softening, gaps, stops, pendulum.

Several functions share these parameters:

- `e`: elongation [m].
- `v`: its rate [m/s].
- `t`: campaign time [s]; not used.
- `z`: internal states; none.
- `motion`: motion of the place of the effect.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, levels

LEAST_BEND = 0.02
"""Share of the largest elongation at which a spring must level off, or a softer one does."""


def cubic(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a cubic spring (Duffing) [N].

    `p`: cubic stiffness [N/m^3].
    """
    return float(p[0] * e * e * e)


def quadratic(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a quadratic spring; it has the same sign at either elongation [N].

    `p`: quadratic stiffness [N/m^2].
    """
    return float(p[0] * e * e)


def saturating(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a spring that levels off, less its linear force [N].

    `p`: stiffness that levels off [N/m]; elongation at which it does [m].
    """
    return float(p[0] * (p[1] * math.tanh(e / p[1]) - e))


def gap(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of stops on both sides, each beyond a gap.

    `p`: stiffness of the stops [N/m]; gap before them [m].
    """
    if e > p[1]:
        return float(p[0] * (e - p[1]))
    if e < -p[1]:
        return float(p[0] * (e + p[1]))
    return 0.0


def stop(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a stop on one side, beyond a gap.

    `p`: stiffness of the stop [N/m]; gap before it [m]; side of the stop, 1 or -1 [1].
    """
    beyond = p[2] * e - p[1]
    return float(p[0] * p[2] * beyond) if beyond > 0 else 0.0


def pendulum(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Torque of gravity on a pendulum, less its linear part.

    `p`: torsional stiffness of gravity [N m/rad]; `e` is an angle [rad].
    """
    return float(p[0] * (math.sin(e) - e))


def quintic(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a spring with terms of third and fifth degree [N]."""
    square = (e / p[2]) * (e / p[2])
    return float((p[0] * square + p[1] * square * square) * e / p[2])


def two_knees(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of stops of two stiffnesses on both sides [N]."""
    size = abs(e)
    force = p[0] * max(size - p[1], 0.0) + p[2] * max(size - p[1] - p[3], 0.0)
    return float(math.copysign(force, e))


def contact(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a round contact on one side, damped as it is pressed [N]."""
    depth = p[2] * e - p[1]
    if depth <= 0.0:
        return 0.0
    force = p[0] * depth * math.sqrt(depth) * (1.0 + p[3] * p[2] * v)
    return float(p[2] * force) if force > 0.0 else 0.0


def degrees(motion: Motion) -> list[Shape]:
    """Share of the term of fifth degree in that of third, at the largest elongation."""
    return [
        {"k5_n": ratio, "e0_m": top}
        for top in levels(motion.e, 0.99)
        for ratio in (-2.0, -0.7, 0.0, 0.7, 2.0)
    ]


def knees(motion: Motion) -> list[Shape]:
    """Pairs of elongations at which the stiffness changes, and ratios of the changes."""
    first = levels(motion.e, 0.3, 0.5, 0.7)
    last = levels(motion.e, 0.6, 0.8, 0.93)
    return [
        {"gap_m": a, "kg2_n_per_m": ratio, "gap2_m": b - a}
        for a in first
        for b in last
        if b > 1.1 * a
        for ratio in (-0.7, 0.7, 3.0)
    ]


def contacts(motion: Motion) -> list[Shape]:
    """Contacts on either side, with and without damping."""
    fast = levels(motion.v, 0.99)
    return [
        {"gap_m": way, "side": side, "damping_s_per_m": share / fast[0] if fast else 0.0}
        for side in (1.0, -1.0)
        for way in (0.0, *levels(motion.e, 0.3, 0.6, 0.85))
        for share in (0.0, 0.5)
    ]


def saturations(motion: Motion) -> list[Shape]:
    """List elongations at which a spring may level off."""
    top = levels(motion.e, 0.999)
    return each("es_m", [share * level for level in top for share in (0.15, 0.3, 0.6, 1.2)])


def gaps(motion: Motion) -> list[Shape]:
    """List gaps that the motion closes now and then."""
    return each("gap_m", levels(motion.e, 0.25, 0.45, 0.6, 0.75, 0.87, 0.95))


def stops(motion: Motion) -> list[Shape]:
    """List gaps on either side, and none."""
    gaps = [0.0, *levels(motion.e, 0.25, 0.5, 0.7, 0.85, 0.95)]
    return [{"gap_m": gap, "side": side} for side in (1.0, -1.0) for gap in gaps]


def levelled(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell whether a motion shows a spring levelling off, and not only its saturated force."""
    return parameters["es_m"] > LEAST_BEND * float(np.abs(motion.e).max())


_GAP = Parameter(name="gap_m", unit="m", meaning="gap before the stop", low=0.0)
_STOP = Parameter(name="kg_n_per_m", unit="N/m", meaning="stiffness of the stop", low=0.0)

KINDS = (
    Kind(
        name="cubic_hardening",
        title="Cubic hardening",
        family="hardening",
        where="element",
        parameters=(
            Parameter(name="k3_n_per_m3", unit="N/m^3", meaning="cubic stiffness", low=0.0),
        ),
        equation="k3 e³, k3 > 0",
        source="Duffing 1918",
        sentence="The spring grows stiffer with amplitude, alike in both directions.",
        action=Law(force=cubic),
        strength="k3_n_per_m3",
    ),
    Kind(
        name="cubic_softening",
        title="Cubic softening",
        family="softening",
        where="element",
        parameters=(
            Parameter(name="k3_n_per_m3", unit="N/m^3", meaning="cubic stiffness", high=0.0),
        ),
        equation="k3 e³, k3 < 0",
        source="Duffing 1918",
        sentence="The spring grows softer with amplitude, alike in both directions.",
        action=Law(force=cubic),
        strength="k3_n_per_m3",
    ),
    Kind(
        name="quadratic_stiffness",
        title="Quadratic stiffness",
        family="asymmetric stiffness",
        where="element",
        parameters=(
            Parameter(name="k2_n_per_m2", unit="N/m^2", meaning="quadratic stiffness"),
        ),
        equation="k2 e²",
        source="Nayfeh and Mook 1979",
        sentence="The spring is stiffer in one direction than in the other, smoothly.",
        action=Law(force=quadratic),
        strength="k2_n_per_m2",
    ),
    Kind(
        name="saturating_stiffness",
        title="Saturating stiffness",
        family="softening",
        where="element",
        parameters=(
            Parameter(
                name="ks_n_per_m", unit="N/m", meaning="stiffness that levels off", low=0.0
            ),
            Parameter(
                name="es_m",
                unit="m",
                meaning="elongation of levelling off",
                low=0.0,
                nonzero=True,
            ),
        ),
        equation="ks (es tanh(e/es) − e)",
        source="",
        sentence="Part of the spring's force levels off beyond an elongation.",
        action=Law(force=saturating),
        strength="ks_n_per_m",
        shapes=saturations,
        shown=levelled,
    ),
    Kind(
        name="gap_symmetric",
        title="Play with stops on both sides",
        family="hardening",
        where="element",
        parameters=(_STOP, _GAP),
        equation="kg (e ∓ gap) beyond ±gap, 0 within",
        source="Shaw and Holmes 1983",
        sentence="Play in both directions: beyond the gap a stop adds its stiffness.",
        action=Law(force=gap),
        strength="kg_n_per_m",
        shapes=gaps,
    ),
    Kind(
        name="gap_one_sided",
        title="Stop on one side",
        family="asymmetric stiffness",
        where="element",
        parameters=(
            _STOP,
            _GAP,
            Parameter(
                name="side",
                unit="",
                meaning="side of the stop: 1 where the element is long, -1 where it is short",
                choices=(1.0, -1.0),
                default=1.0,
                fitted=False,
            ),
        ),
        equation="kg (e − side·gap) beyond the gap on one side, bilinear for gap 0",
        source="Shaw and Holmes 1983",
        sentence="A stop, or a crack that closes, adds stiffness in one direction only.",
        action=Law(force=stop),
        strength="kg_n_per_m",
        shapes=stops,
    ),
    Kind(
        name="pendulum_sine",
        title="Pendulum",
        family="softening",
        where="element",
        parameters=(
            Parameter(
                name="k",
                unit="N m/rad",
                meaning="torsional stiffness of gravity",
                natural="stiffness",
            ),
        ),
        equation="k (sin e − e), e in rad",
        source="",
        sentence="Gravity pulls with the sine of the angle, as on a pendulum.",
        action=Law(force=pendulum),
        strength="k",
    ),
    Kind(
        name="quintic_stiffness",
        title="Stiffness of third and fifth degree",
        family="polynomial stiffness",
        where="element",
        parameters=(
            Parameter(name="k3_n", unit="N", meaning="cubic force at the elongation e0"),
            Parameter(name="k5_n", unit="N", meaning="quintic force at the elongation e0"),
            Parameter(
                name="e0_m",
                unit="m",
                meaning="elongation that the forces are given at",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
        ),
        equation="F3 (e/e0)³ + F5 (e/e0)⁵",
        source="Nayfeh and Mook 1979",
        sentence="Stiffness changes with amplitude, and may fall first and then rise.",
        action=Law(force=quintic),
        strength="k3_n",
        scales=("k5_n",),
        shapes=degrees,
        contains=("cubic_hardening", "cubic_softening"),
        similar=("pendulum_sine",),
    ),
    Kind(
        name="stiffness_two_knees",
        title="Stops in two steps",
        family="hardening",
        where="element",
        parameters=(
            Parameter(name="kg_n_per_m", unit="N/m", meaning="stiffness of the first stop"),
            _GAP,
            Parameter(name="kg2_n_per_m", unit="N/m", meaning="stiffness of the second stop"),
            Parameter(
                name="gap2_m",
                unit="m",
                meaning="distance from the first stop to the second",
                low=0.0,
            ),
        ),
        equation="kg (|e| − g)₊ + kg2 (|e| − g − g2)₊, with the sign of e",
        source="piecewise-linear springs: Shaw and Holmes 1983",
        sentence="Stops on both sides, with a second pair of another stiffness behind them.",
        action=Law(force=two_knees),
        strength="kg_n_per_m",
        scales=("kg2_n_per_m",),
        shapes=knees,
        contains=("gap_symmetric",),
    ),
    Kind(
        name="impact",
        title="Impact on a round contact",
        family="asymmetric stiffness",
        where="element",
        parameters=(
            Parameter(
                name="kc_n_per_m15", unit="N/m^1.5", meaning="stiffness of the contact", low=0.0
            ),
            _GAP,
            Parameter(
                name="side",
                unit="",
                meaning="side of the stop: 1 where the element is long, -1 where it is short",
                fitted=False,
                choices=(1.0, -1.0),
            ),
            Parameter(
                name="damping_s_per_m",
                unit="s/m",
                meaning="damping factor of the impact (Hunt and Crossley)",
                low=0.0,
            ),
        ),
        equation="kc (s e − g)₊^1.5 (1 + d s v), never pulling",
        source="Hertz 1881; Hunt and Crossley 1975",
        sentence="A round body meets a stop on one side and loses energy as it is pressed.",
        action=Law(force=contact),
        strength="kc_n_per_m15",
        shapes=contacts,
        similar=("gap_one_sided",),
    ),
)
