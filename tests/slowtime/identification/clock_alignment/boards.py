"""One structure under random forces, sampled by several boards with clocks of their own."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float
from scipy.signal import czt

PERIOD_FACTOR = 1.25
"""The motion repeats itself only after that many lengths of the record."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """Modes of unit modal mass."""

    frequency_hz: tuple[float, ...] = (2.1, 5.3, 9.7)
    damping_ratio: float = 0.01
    shapes: Complex[np.ndarray, "place mode"] | Float[np.ndarray, "place mode"]


@dataclasses.dataclass(frozen=True, slots=True)
class Motion:
    """Fourier coefficients of the acceleration of each place, up to `top_hz`."""

    coefficients: Complex[np.ndarray, "line place"]
    spacing_hz: float

    def sampled(
        self, rate_hz: float, start_s: float, count: int
    ) -> Float[np.ndarray, "time place"]:
        """Exact values at instants of any rate and start, by the chirp z transform."""
        lines = np.arange(len(self.coefficients))
        turned = (
            self.coefficients * np.exp(2j * np.pi * self.spacing_hz * start_s * lines)[:, None]
        )
        step = np.exp(-2j * np.pi * self.spacing_hz / rate_hz)
        return np.asarray(czt(turned, m=count, w=1 / step, a=1.0, axis=0).real)


def motion(
    rng: np.random.Generator, structure: Structure, seconds: float, top_hz: float
) -> Motion:
    """Stationary motion under white forces at all places."""
    spacing = 1 / (PERIOD_FACTOR * seconds)
    f = np.arange(int(top_hz / spacing)) * spacing
    places = len(structure.shapes)
    force = rng.normal(size=(len(f), places, 2)) @ np.array([1.0, 1.0j])
    natural = np.array(structure.frequency_hz)
    response = -(f[:, None] ** 2) / (
        natural**2 - f[:, None] ** 2 + 2j * structure.damping_ratio * natural * f[:, None]
    )
    modal = response * (force @ structure.shapes.conj())
    return Motion(modal @ structure.shapes.T, spacing)
