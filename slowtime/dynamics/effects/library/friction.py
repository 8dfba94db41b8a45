"""Dry friction laws: Coulomb and Stribeck."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects.kind import Friction, Kind, Motion, Parameter, Shape

from .parameter_grids import levels

MOST_SPEED, LEAST_RISE = 0.7, 1.1
"""Stribeck speed over the highest seen, from which friction has not fallen by seven eighths;
friction of sticking over that of sliding, below which it has not fallen to speak of."""


def coulomb(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Sliding friction that is the same at every speed (Coulomb).

    Parameters
    ----------
    e
        Elongation [m].
    v
        Speed [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Friction of sliding [N].

    Returns
    -------
    Force [N].
    """
    return float(p[0])


def stribeck(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Sliding friction that falls as speed grows (Stribeck).

    Parameters
    ----------
    e
        Elongation [m].
    v
        Speed [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Friction of sliding [N], friction of sticking [N], Stribeck speed [m/s].

    Returns
    -------
    Force [N].
    """
    ratio = v / p[2]
    return float(p[0] + (p[1] - p[0]) * math.exp(-ratio * ratio))


def speeds(motion: Motion) -> list[Shape]:
    """List Stribeck speeds, and ratios of sticking to sliding friction.

    The speeds are shares of the highest one: a place that sticks most of the time has no
    meaningful median speed.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
    return [
        {"static_n": ratio, "vs_m_per_s": part * highest}
        for highest in levels(motion.v, 0.99)
        for part in (0.02, 0.06, 0.2, 0.5)
        for ratio in (1.3, 2.0)
    ]


def fallen(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell whether friction fell with speed, and most of the way, in a motion.

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
    falls = parameters["static_n"] > LEAST_RISE * parameters["friction_n"]
    return falls and parameters["vs_m_per_s"] < MOST_SPEED * float(np.abs(motion.v).max())


_SLIDING = Parameter(name="friction_n", unit="N", meaning="friction of sliding", low=0.0)

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
            Parameter(name="static_n", unit="N", meaning="friction of sticking", low=0.0),
            Parameter(
                name="vs_m_per_s", unit="m/s", meaning="Stribeck speed", low=0.0, nonzero=True
            ),
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
)
