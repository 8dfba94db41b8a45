"""Residuals weighed by their noise, line by line of the spectrum: colour is no matter."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.floor import Noise
from slowtime.discrepancy.records import Trial
from slowtime.signals.spectra import transform


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Weights:
    r"""Factors that turn the spectrum of a residual into numbers of unit variance.

    With :math:`z_k = Y_k \sqrt{2 / N_k}`, whose real and imaginary parts have unit variance
    each, :math:`\chi^2 = \sum_k |z_k|^2` over the lines from 0 to half the sampling rate.

    Parameters
    ----------
    use
        1 for samples to be believed; 0 otherwise.
    factors
        By line and sensor.
    white
        Standard deviation of each sensor's noise where all of it is white: then samples do as
        well as lines.
    """

    rate_hz: float
    frequency_hz: Float[np.ndarray, " frequency"]
    use: Float[np.ndarray, "time sensor"]
    factors: Float[np.ndarray, "frequency sensor"]
    white: Float[np.ndarray, " sensor"] | None = None

    @property
    def data(self) -> int:
        """How many samples count."""
        return int(self.use.sum())

    def whitened(
        self, series: Float[np.ndarray, "time sensor *more"]
    ) -> Float[np.ndarray, "number ..."]:
        """Real numbers of unit variance, from samples of every sensor."""
        more = series.shape[2:]
        used = series * self.use.reshape(self.use.shape + (1,) * len(more))
        if self.white is not None:
            scaled = used / self.white.reshape((-1,) + (1,) * len(more))
            return np.asarray(scaled.reshape((-1, *more)))
        flat = used.reshape(len(used), -1)
        spectrum = transform(flat, self.rate_hz)[1].reshape((-1, *used.shape[1:]))
        scaled = spectrum * self.factors.reshape(self.factors.shape + (1,) * len(more))
        both = np.stack([scaled.real, scaled.imag])
        return np.asarray(both.reshape((-1, *more)))

    def by_line(
        self, residual: Float[np.ndarray, "time sensor"]
    ) -> Float[np.ndarray, "frequency sensor"]:
        """Contribution of each line to chi squared."""
        spectrum = transform(residual * self.use, self.rate_hz)[1]
        return np.asarray(np.abs(spectrum * self.factors) ** 2)


def weights_of(trial: Trial, noise: Noise, number: int, *, samples: int = 0) -> Weights:
    """Weights of a trial's residual.

    Parameters
    ----------
    number
        Of the trial, for its noise.
    samples
        How many of the first samples count; all for 0.
    """
    count = samples or len(trial.outputs)
    use = trial.used[:count].astype(float)
    frequency = np.asarray(np.fft.rfftfreq(count, 1 / trial.rate_hz), dtype=float)
    share = np.maximum(use.mean(axis=0), 1 / count)
    density = noise.density(number, frequency)
    white = all(colour.low == 0 for colour in noise.colours[number])
    return Weights(
        rate_hz=trial.rate_hz,
        frequency_hz=frequency,
        use=use,
        factors=np.sqrt(2.0 / (density * share)),
        white=np.sqrt(density[0] * trial.rate_hz / 2) if white else None,
    )
