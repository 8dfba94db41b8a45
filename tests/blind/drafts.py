"""Drafts: the parameters of an effect up to its strength, and what they are drawn for.

A draft gives all parameters for a strength s: 1 is a natural size, and the caller turns s until
the effect stands as far above the noise as was asked.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

Parameters = dict[str, float]


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """What is known at a place before the effect is there."""

    stiffness: float
    """Of the element, or to the ground of the first element for other places [N/m]."""
    damping: float
    elongation: float
    """Root mean square at the middle level [m]."""
    speed: float
    mass: float
    """Of the node."""
    force: float
    """Root mean square of the excitation at the middle level [N]."""
    signal: float
    """Standard deviation of the sensor's channel at the middle level, in its unit."""
    frequencies_hz: tuple[float, ...]
    rate_hz: float
    campaign_s: float
    inside_s: tuple[tuple[float, float], ...]
    """Spans of the campaign that the records cover."""
    tolerance: tuple[float, float]
    """Of stiffness and damping."""
    off: tuple[float, float] = (0.0, 0.0)
    """How far stiffness and damping are above what the model says of them, as a share."""
    weighs: bool = True
    """Whether a mass does anything that a spring and a damper could not do."""


@dataclasses.dataclass(frozen=True)
class Draft:
    """Parameters as a function of the strength, and the strengths that make sense."""

    at: Callable[[float], Parameters]
    low: float = 1e-3
    high: float = 1e3


Drawer = Callable[[np.random.Generator, Surroundings], Draft]


def draw_sign(rng: np.random.Generator, minus: float = 0.5) -> float:
    return -1.0 if rng.random() < minus else 1.0


def scaled(
    name: str, size: Callable[[Surroundings], float], **fixed: tuple[float, float]
) -> Drawer:
    """One coefficient of natural size, beside exponents drawn between two ends."""

    def drawer(rng: np.random.Generator, here: Surroundings) -> Draft:
        others = {key: float(rng.uniform(*ends)) for key, ends in fixed.items()}
        return Draft(lambda s: {name: s * size(here)} | others, 1e-3, 30.0)

    return drawer
