"""An effect: a spring whose force gives way as it is stretched, whichever way."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slowtime.dynamics.effects import Kind, Law, Motion, Parameter


def force(e: float, v: float, t: float, z: Any, p: Any) -> Any:
    """Force: straight for small elongations, bounded by k d for large ones."""
    return p[0] * e / (1.0 + abs(e) / p[1])


def shapes(motion: Motion) -> list[Mapping[str, float]]:
    """Lengths d that matter in the motion seen, for a k of 1."""
    largest = max(float(np.max(np.abs(motion.e))), 1e-12)
    return [{"d_m": float(d)} for d in np.geomspace(0.1 * largest, 3 * largest, 8)]


KIND = Kind(
    name="softening_spring",
    family="elasticity",
    where="element",
    parameters=(
        Parameter(name="k_n_per_m", unit="N/m", meaning="its stiffness at rest", low=0.0),
        Parameter(name="d_m", unit="m", meaning="where half is left", low=0.0, nonzero=True),
    ),
    equation="k e / (1 + |e| / d)",
    source="a tutorial",
    sentence="The element gives way as it is stretched.",
    action=Law(force=force, rates=()),
    strength="k_n_per_m",
    scales=("d_m",),
    shapes=shapes,
)
