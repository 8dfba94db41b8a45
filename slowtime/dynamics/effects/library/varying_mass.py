"""Mass that varies with time: jump, drift.

A law sees elongation and speed. Its acceleration is the speed's rate behind a lag, which is so
short that no structure notices: an internal state follows the speed.
"""

import math
from typing import Any

import numpy as np

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Series, Values

from .varying_stiffness import instants, spans

LAG_S = 1e-5
"""Lag of the acceleration [s]: at 100 Hz a phase of 0.4 degrees, as if 0.6 % of the inertia of
the changing mass were damping."""


def lagged(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the state that follows the speed, which is the acceleration [m/s^2].

    `z`: the speed a lag ago [m/s].
    """
    return float((v - z[0]) / LAG_S)


def jump(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Inertia of a mass that is there from one instant on.

    `p`: mass added [kg]; campaign time of the jump [s]. `z`: the speed a lag ago [m/s].
    """
    return float(-p[0] * (v - z[0]) / LAG_S) if t >= p[1] else 0.0


def drift(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Inertia of a mass that grows linearly in time.

    `p`: mass added in the end [kg]; campaign time at which all of it is there [s]. `z`: the
    speed a lag ago [m/s].
    """
    return float(-p[0] * (v - z[0]) / LAG_S * t / p[1])


def along_jump(motion: Motion, p: Values) -> Series:
    """Force of `jump` along a known motion, without the lag."""
    return np.asarray(-p[0] * motion.a * (motion.times >= p[1]))


def along_drift(motion: Motion, p: Values) -> Series:
    """Force of `drift` along a known motion, without the lag."""
    return np.asarray(-p[0] * motion.a * motion.times / p[1])


_MORE = Parameter(name="dm_kg", unit="kg", meaning="mass added in the end")

KINDS = (
    Kind(
        name="mass_jump",
        title="Jump of mass",
        family="time-varying mass",
        where="node",
        parameters=(
            _MORE,
            Parameter(name="t_jump_s", unit="s", meaning="campaign time of the jump"),
        ),
        equation="mass + Δm from t_jump on",
        source="",
        sentence="The node gained mass at one instant, or lost it, where it is negative.",
        action=Law(force=jump, rates=(lagged,), switches=("t_jump_s",), along=along_jump),
        strength="dm_kg",
        shapes=instants,
    ),
    Kind(
        name="mass_drift",
        title="Drift of mass",
        family="time-varying mass",
        where="node",
        parameters=(
            _MORE,
            Parameter(
                name="span_s",
                unit="s",
                meaning="campaign time at which all of it is there; the end of the record "
                "where not given",
                low=0.0,
                nonzero=True,
                default=math.nan,
                fitted=False,
            ),
        ),
        equation="mass + Δm t / span",
        source="",
        sentence="The node gains mass steadily over the campaign; it loses it, where it is "
        "negative.",
        action=Law(force=drift, rates=(lagged,), along=along_drift),
        strength="dm_kg",
        shapes=spans,
    ),
)
