r"""Enhanced FDD: frequency and damping from the correlation of one spectral bell.

The bell goes back to time about its own centre,
:math:`R(\tau) = \sum_k I_k e^{2 \pi i (f_k - f_c) \tau} / (1 - \tau / T)`, and rings like
:math:`e^{(s - 2 \pi i f_c) \tau}`: the logarithm is a straight line, whose slope is the pole s.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import nnls

from slowtime.identification.ambient.expected_spectrum import expected_resonance
from slowtime.identification.estimates import Measured

FIRST_LAG = 1.0
"""First lag of the regression [inverse bell widths]."""

LAGS = 2.0
"""Number of lags per inverse bell width."""

LEAST = 0.2
"""Decay of the correlation at which the regression ends, relative to its first value."""

SURE = 3.0
"""Ratio of correlation to its standard deviation at which the regression ends."""

LONGEST = 0.25
"""Largest lag, relative to the record."""

FEWEST_LAGS = 4
"""Least number of lags."""

MOST_LAGS = 60
"""Largest number of lags."""


LEAST_DAMPING, MOST_DAMPING = 1e-6, 0.5
"""Range of the damping ratio [1]."""


GROUPS = 40
"""Groups of ordinates from which resonance and floor are separated."""

ROUNDS = 12
"""Rounds of the bias correction, at most."""

SETTLED = 1e-3
"""Change at which the bias correction stops [standard deviations]."""

NARROW = 4.0
"""Visible half-bandwidths on one side below which a bell is flagged."""


@dataclasses.dataclass(frozen=True, slots=True)
class CorrelationDecay:
    """Pole of a bell."""

    frequency_hz: Measured
    damping_ratio: Measured
    correlation: float
    flags: tuple[str, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Regression:
    """Lags and weights of a straight line through logarithms of correlations."""

    turns: Complex[np.ndarray, "lag bin"]
    weights: Float[np.ndarray, " lag"]

    def slope(self, density: np.ndarray) -> complex:
        return complex(self.weights @ _logarithm(self.turns @ density))

    def influence(self, density: np.ndarray) -> Complex[np.ndarray, " bin"]:
        """Give the derivative of the slope by every ordinate."""
        return np.asarray((self.weights / (self.turns @ density)) @ self.turns)


def fit_correlation_decay(
    frequency_hz: Float[np.ndarray, " bin"],
    density: Float[np.ndarray, " bin"],
    *,
    centre_hz: float,
    rate_hz: float,
    count: int,
    derivatives: int = 2,
) -> CorrelationDecay | None:
    """Frequency and damping from the correlation of a bell; None if it does not decay.

    The ordinates are those of the bell, of a record without a taper: neither averaged nor
    thinned.
    """
    regression = _regression(frequency_hz, density, centre_hz, count / rate_hz)
    if regression is None:
        return None
    centre = 2j * np.pi * centre_hz
    found, influence = centre + regression.slope(density), regression.influence(density)
    parts = np.stack([influence.real, influence.imag])
    covariance = (parts * (0.5 * density**2)) @ parts.T
    pole = found
    for _ in range(ROUNDS):
        frequency, damping = abs(pole) / (2 * np.pi), -pole.real / abs(pole)
        if not (LEAST_DAMPING < damping < MOST_DAMPING and frequency < rate_hz / 2):
            return None
        resonance = expected_resonance(
            frequency_hz,
            natural_hz=frequency,
            damping_ratio=damping,
            rate_hz=rate_hz,
            count=count,
            derivatives=derivatives,
        )
        expected = _expected(resonance, density)
        change = found - (centre + regression.slope(expected))
        pole += change
        if abs(change) ** 2 < SETTLED**2 * np.trace(covariance):
            break
    # The variance of expected ordinates is their square. That of the ordinates found is small
    # where they happen to make the bell narrow, and larger where it is not that of a mode.
    influence = regression.influence(expected)
    parts = np.stack([influence.real, influence.imag])
    both = covariance, (parts * expected**2) @ parts.T
    return _told(pole, max(both, key=np.trace), frequency_hz)


def _regression(
    frequency_hz: np.ndarray, density: np.ndarray, centre_hz: float, duration_s: float
) -> _Regression | None:
    """Lags over which the correlation decays, each weighted by its own power."""
    places = np.round((frequency_hz - frequency_hz[0]) * duration_s).astype(int)
    whole = np.zeros(int(places[-1]) + 1)
    whole[places] = density
    padded = round(LAGS * len(whole))
    lags = np.arange(padded) * duration_s / padded
    size = np.abs(np.fft.ifft(whole, padded)) * padded
    use = np.flatnonzero((lags >= FIRST_LAG * LAGS * lags[1]) & (lags <= LONGEST * duration_s))
    if len(use) < FEWEST_LAGS:
        return None
    enough = max(LEAST * size[use[0]], SURE * np.sqrt(0.5 * density @ density))
    decayed = np.flatnonzero(size[use] < enough)
    use = use[: decayed[0]] if len(decayed) else use
    if len(use) < FEWEST_LAGS:
        return None
    use = use[:: -(-len(use) // MOST_LAGS)]
    chosen = lags[use]
    turns = np.exp(2j * np.pi * np.multiply.outer(chosen, frequency_hz - centre_hz))
    away = chosen - np.average(chosen, weights=size[use] ** 2)
    weight = size[use] ** 2 * away
    return _Regression(turns / (1 - chosen[:, None] / duration_s), weight / (weight @ away))


def _logarithm(correlation: np.ndarray) -> np.ndarray:
    return np.asarray(np.log(np.abs(correlation)) + 1j * np.unwrap(np.angle(correlation)))


def _expected(resonance: np.ndarray, density: np.ndarray) -> Float[np.ndarray, " bin"]:
    """Resonance and floor that explain the ordinates, in groups weighted by their scatter."""
    starts = np.unique(np.linspace(0, len(density), GROUPS + 1).astype(int))[:-1]
    level = np.add.reduceat(density, starts)
    number = np.add.reduceat(np.ones_like(density), starts)
    rows = np.stack([np.add.reduceat(resonance, starts), number], axis=1)
    parts, _ = nnls(rows * (np.sqrt(number) / level)[:, None], np.sqrt(number))
    return np.asarray(parts[0] * resonance + parts[1])


def _told(pole: complex, covariance: np.ndarray, frequency_hz: np.ndarray) -> CorrelationDecay:
    """On frequency and damping, from the covariance of real and imaginary part of the pole."""
    size, turning = abs(pole), pole.imag
    frequency, damping = size / (2 * np.pi), -pole.real / size
    onto = np.array(
        [
            [pole.real / (2 * np.pi * size), turning / (2 * np.pi * size)],
            [-(turning**2) / size**3, pole.real * turning / size**3],
        ]
    )
    both = onto @ covariance @ onto.T
    sd = np.sqrt(np.diag(both))
    seen = min(frequency - frequency_hz[0], frequency_hz[-1] - frequency)
    return CorrelationDecay(
        Measured(float(frequency), float(sd[0])),
        Measured(float(damping), float(sd[1])),
        float(both[0, 1] / (sd[0] * sd[1])),
        ("narrow_bell",) if seen < NARROW * damping * frequency else (),
    )
