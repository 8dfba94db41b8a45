"""A Maxwell branch: a spring and a damper in a row, beside an element."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects import Kind, Law, Motion, Parameter

Shape = Mapping[str, float]


def force(e: float, v: float, t: float, z: Any, p: Any) -> Any:
    """Force of the branch: that of its spring, which is the state z[0]."""
    return z[0]


def rate(e: float, v: float, t: float, z: Any, p: Any) -> Any:
    """How it changes: the damper gives way to it."""
    return p[0] * v - p[0] / p[1] * z[0]


def shapes(motion: Motion) -> list[Shape]:
    """Relaxation times c/k that matter in the motion seen, for a k of 1."""
    fastest = 4 * (motion.times[1] - motion.times[0])
    slowest = 20 * np.std(motion.e) / max(np.std(motion.v), 1e-300)
    return [{"c_n_s_per_m": float(t)} for t in np.geomspace(fastest, max(slowest, fastest), 16)]


KIND = Kind(
    name="maxwell_branch",
    family="viscoelasticity",
    where="element",
    parameters=(
        Parameter(name="k_n_per_m", unit="N/m", meaning="its stiffness", low=0.0),
        Parameter(
            name="c_n_s_per_m", unit="N s/m", meaning="its damping", low=0.0, nonzero=True
        ),
    ),
    equation="z with dz/dt = k (v - z/c)",
    source="Maxwell 1867",
    sentence="The element relaxes: it is stiffer in fast motion than in slow.",
    action=Law(force=force, rates=(rate,)),
    strength="k_n_per_m",
    scales=("c_n_s_per_m",),
    shapes=shapes,
)
