"""Weights that whiten residuals line by line of their spectra."""

import dataclasses

import numpy as np
import scipy.fft
import scipy.ndimage
from jaxtyping import Float

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.signals.spectra import transform

TAPER_SHARE = 0.05
"""[share of a record] Over which drift is tapered at every end of what is used. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SpectralWeights:
    r"""Factors that whiten the spectrum of a residual.

    With :math:`z_k = Y_k \sqrt{2 / N_k}`, whose real and imaginary parts have unit variance
    each, :math:`\chi^2 = \sum_k |z_k|^2` over the lines from 0 to half the sampling rate.

    Parameters
    ----------
    use
        1 for valid samples, 0 for others; between 0 and 1 where drift is tapered, so that it
        does not leak over all lines.
    factors
        :math:`\sqrt{2 / N_k}` by line and sensor.
    white
        Standard deviation of each sensor's noise where all of it is white: samples then serve
        instead of lines.
    """

    rate_hz: float
    frequency_hz: Float[np.ndarray, " frequency"]
    use: Float[np.ndarray, "time sensor"]
    factors: Float[np.ndarray, "frequency sensor"]
    white: Float[np.ndarray, " sensor"] | None = None

    @property
    def data(self) -> int:
        """Number of samples that are used."""
        return int((self.use**2).sum())

    def products(
        self,
        left: Float[np.ndarray, "time sensor"],
        slopes: Float[np.ndarray, "time sensor slope"],
    ) -> Float[np.ndarray, "column column"]:
        """Inner products of whitened sensitivities and residual.

        The residual is the last row and column of the matrix.
        """
        count, _, columns = slopes.shape
        inner = np.zeros((columns + 1, columns + 1))
        series = np.empty((columns + 1, count))
        for sensor in range(slopes.shape[1]):
            use = self.use[:, sensor]
            np.multiply(slopes[:, sensor].T, use, out=series[:-1])
            np.multiply(left[:, sensor], use, out=series[-1])
            if self.white is not None:
                inner += series @ series.T / self.white[sensor] ** 2
                continue
            lines = scipy.fft.rfft(series, axis=1)
            lines *= self._per_line(sensor)
            numbers = lines.view(float)
            inner += numbers @ numbers.T
        return inner

    def chi2(self, residual: Float[np.ndarray, "time sensor"]) -> float:
        """Sum of squares of the whitened residual; infinite where it overflows."""
        if self.white is not None:
            with np.errstate(over="ignore"):
                return float(np.sum((residual * self.use / self.white) ** 2))
        return float(np.sum(self.chi2_by_line(residual)))

    def _per_line(self, sensor: int) -> Float[np.ndarray, " frequency"]:
        """Factors that give the plain transform of a sensor's noise unit variance."""
        count = len(self.use)
        scale = np.sqrt(2.0 / (self.rate_hz * count)) * self.factors[:, sensor]
        scale[0] /= np.sqrt(2.0)
        if count % 2 == 0:
            scale[-1] /= np.sqrt(2.0)
        return np.asarray(scale)

    def chi2_by_line(
        self, residual: Float[np.ndarray, "time sensor"]
    ) -> Float[np.ndarray, "frequency sensor"]:
        """Contribution of each line and sensor to chi squared."""
        spectrum = transform(residual * self.use, self.rate_hz)[1]
        return np.asarray(np.abs(spectrum * self.factors) ** 2)


def spectral_weights(
    trial: Trial, noise: Noise, number: int, *, samples: int = 0
) -> SpectralWeights:
    """Weights of a trial's residual.

    Only the first `samples` are used, all for 0.
    """
    count = samples or len(trial.outputs)
    use = trial.used[:count].astype(float)
    frequency = np.asarray(np.fft.rfftfreq(count, 1 / trial.rate_hz), dtype=float)
    density = noise.weighting_density(number, frequency)
    white = noise.drift is None and all(
        colour.coloured == 0 for colour in noise.colours[number]
    )
    if noise.drift is not None:
        use = use * np.stack([_tapered_mask(column) for column in use.T], axis=1)
    elif not white:
        holes = [
            _masked_density(one, column) for one, column in zip(density.T, use.T, strict=True)
        ]
        density = np.stack(holes, axis=1)
    return SpectralWeights(
        rate_hz=trial.rate_hz,
        frequency_hz=frequency,
        use=use,
        factors=np.sqrt(2.0 / (density * np.maximum(np.mean(use**2, axis=0), 1 / count))),
        white=np.sqrt(density[0] * trial.rate_hz / 2) if white else None,
    )


def _masked_density(
    density: Float[np.ndarray, " frequency"], use: Float[np.ndarray, " time"]
) -> Float[np.ndarray, " frequency"]:
    """Density of noise with gaps, through which steep noise leaks to all lines."""
    # The expected squared spectrum of masked noise is the transform of the autocovariance of
    # the noise times that of the mask.
    if use.all() or not use.any():
        return density
    count = len(use)
    alike = scipy.fft.irfft(np.abs(scipy.fft.rfft(use)) ** 2, count)
    cut = scipy.fft.rfft(scipy.fft.irfft(density, count) * alike).real
    return np.asarray(np.maximum(cut / alike[0], np.finfo(float).tiny))


def _tapered_mask(use: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Taper a mask towards its end and towards gaps by a squared sine."""
    # Not at the start: initial states are free, and drift is zero there.
    before = np.full(len(use), use[0] > 0)
    inside = scipy.ndimage.distance_transform_edt(np.concatenate([before, use > 0, [False]]))
    inside = inside[len(use) : -1]
    return np.asarray(
        np.sin(np.pi / 2 * np.minimum(inside / (TAPER_SHARE * len(use)), 1.0)) ** 2
    )
