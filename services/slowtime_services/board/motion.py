"""Simulated readings of an ADXL355 on a vibrating structure."""

import dataclasses
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Int

COUNT_M_PER_S2 = 3.9e-6 * 9.80665
"""Acceleration of one count at +-2 g: 3.9 ug, as the data sheet of the ADXL355 states."""

NOISE_COUNTS = 60.0
"""25 ug/sqrt(Hz), of the same sheet, over 62.5 Hz, in counts and rounded up."""

MODE_RMS_COUNTS = 3_000.0
UPPER_MODE = 2.7
"""Second mode over the first, with a tenth of its motion."""

GRAVITY_COUNTS = round(1 / 3.9e-6)
SHARES = np.array([1.0, 0.6, 0.15])
"""Of the axes in the motion."""


class Burst(NamedTuple):
    """Consecutive samples and the number of the first."""

    counter: int
    counts: Int[np.ndarray, "time 3"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A board with three axes on a structure of two modes under white forces.

    Parameters
    ----------
    rate_hz
        Samples per second.
    frequency_hz, damping_ratio
        Of the first mode.
    """

    rate_hz: float = 125.0
    frequency_hz: float = 3.2
    damping_ratio: float = 0.01

    def __post_init__(self) -> None:
        """Refuse a motion that the board would alias."""
        if UPPER_MODE * self.frequency_hz >= self.rate_hz / 2:
            raise ValueError(
                f"frequency_hz={self.frequency_hz} has a second mode at "
                f"{UPPER_MODE * self.frequency_hz:g} Hz, not below half of {self.rate_hz:g} "
                "Hz. Lower it, or raise rate_hz."
            )

    def readings(self, samples: int, rng: np.random.Generator) -> Iterator[Burst]:
        """Yield readings of so many samples each, without end."""
        modes = [
            (self._filter(ratio * self.frequency_hz), share, np.zeros(2))
            for ratio, share in ((1.0, 1.0), (UPPER_MODE, 0.1))
        ]
        counter = 0
        while True:
            motion = np.zeros(samples)
            for n, ((b, a), share, state) in enumerate(modes):
                moved, after = scipy.signal.lfilter(
                    b, a, rng.standard_normal(samples), zi=state
                )
                motion += share * MODE_RMS_COUNTS * moved
                modes[n] = ((b, a), share, after)
            noise = rng.normal(0.0, NOISE_COUNTS, (samples, 3))
            counts = np.rint(motion[:, None] * SHARES + noise).astype(np.int64)
            counts[:, 2] += GRAVITY_COUNTS
            yield Burst(counter, counts)
            counter += samples

    def _filter(self, frequency_hz: float) -> tuple[np.ndarray, np.ndarray]:
        """Second-order resonance of unit standard deviation under unit white noise."""
        omega = 2 * math.pi * frequency_hz / self.rate_hz
        radius = math.exp(-self.damping_ratio * omega)
        angle = omega * math.sqrt(1 - self.damping_ratio**2)
        a1, a2 = -2 * radius * math.cos(angle), radius**2
        # Variance of an AR(2) process, e.g. Box, Jenkins, "Time Series Analysis", sec. 3.2.4.
        variance = (1 + a2) / ((1 - a2) * ((1 + a2) ** 2 - a1**2))
        return np.array([1 / math.sqrt(variance)]), np.array([1.0, a1, a2])
