"""Nonlinear springs: hardening, softening, gaps, stops, pendulum."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, levels

LEAST_BEND = 0.02
"""Share of the largest elongation at which a spring must level off, or a softer one does."""


def cubic(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a cubic spring (Duffing).

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Cubic stiffness [N/m^3].

    Returns
    -------
    Force [N].
    """
    return float(p[0] * e * e * e)


def quadratic(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a quadratic spring; it has the same sign at either elongation.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Quadratic stiffness [N/m^2].

    Returns
    -------
    Force [N].
    """
    return float(p[0] * e * e)


def saturating(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a spring that levels off, less its linear force.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Stiffness that levels off [N/m]; elongation at which it does [m].

    Returns
    -------
    Force [N].
    """
    return float(p[0] * (p[1] * math.tanh(e / p[1]) - e))


def gap(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of stops on both sides, each beyond a gap.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Stiffness of the stops [N/m]; gap before them [m].

    Returns
    -------
    Force [N].
    """
    if e > p[1]:
        return float(p[0] * (e - p[1]))
    if e < -p[1]:
        return float(p[0] * (e + p[1]))
    return 0.0


def stop(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a stop on one side, beyond a gap.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Stiffness of the stop [N/m]; gap before it [m]; side of the stop, 1 or -1 [1].

    Returns
    -------
    Force [N].
    """
    beyond = p[2] * e - p[1]
    return float(p[0] * p[2] * beyond) if beyond > 0 else 0.0


def pendulum(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Torque of gravity on a pendulum, less its linear part.

    Parameters
    ----------
    e
        Angle [rad].
    v
        Its rate [rad/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Torsional stiffness of gravity [N m/rad].

    Returns
    -------
    Torque [N m].
    """
    return float(p[0] * (math.sin(e) - e))


def saturations(motion: Motion) -> list[Shape]:
    """List elongations at which a spring may level off.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
    top = levels(motion.e, 0.999)
    return each("es_m", [share * level for level in top for share in (0.15, 0.3, 0.6, 1.2)])


def gaps(motion: Motion) -> list[Shape]:
    """List gaps that the motion closes now and then.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
    return each("gap_m", levels(motion.e, 0.25, 0.45, 0.6, 0.75, 0.87, 0.95))


def stops(motion: Motion) -> list[Shape]:
    """List gaps on either side, and none.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
    gaps = [0.0, *levels(motion.e, 0.25, 0.5, 0.7, 0.85, 0.95)]
    return [{"gap_m": gap, "side": side} for side in (1.0, -1.0) for gap in gaps]


def levelled(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell whether a motion shows a spring levelling off, and not only its saturated force.

    Parameters
    ----------
    parameters
        Parameters of the effect, by name, in their units.
    motion
        Motion of the place of the effect.

    Returns
    -------
    Whether the motion shows the effect.
    """
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
            Parameter(name="k", unit="N m/rad", meaning="torsional stiffness of gravity"),
        ),
        equation="k (sin e − e), e in rad",
        source="",
        sentence="Gravity pulls with the sine of the angle, as on a pendulum.",
        action=Law(force=pendulum),
        strength="k",
    ),
)
