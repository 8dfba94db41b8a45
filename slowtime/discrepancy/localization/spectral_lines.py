"""Spectra of a trial: residual, noise, and the motion of the reference."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.units import unit_factor
from slowtime.signals.spectra import transform

from .linear_response import LinearModel

BAND_RATIO = 1.12
"""[1] Last frequency of a band over its first, unless that has too few lines. Source:
docs/what_decides.md: half and double change no answer."""

MIN_BAND_LINES = 10
"""[lines] Of a band at least. Source: docs/what_decides.md: half and double change no
answer."""

Lines = Complex[np.ndarray, "frequency sensor"]
MotionSpectra = Complex[np.ndarray, "order frequency dof"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class OuterMotion:
    """Motion that inputs impose in one trial."""

    base: Float[np.ndarray, " time"]
    supports: Float[np.ndarray, "order time moved"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrialLines:
    r"""Spectra of a trial, scaled so that noise of density :math:`N` gives :math:`E|Y|^2 = N`.

    Parameters
    ----------
    weight
        1 for a line, 1/2 for those at 0 and at half the rate, which are real.
    band
        Number of the band of each line; that at 0 has one of its own.
    noise
        Density times the share of samples that are used [unit²/Hz].
    supports
        Motion of supports and driven nodes as that of the coordinates; None where there are
        none.
    gaps
        Mask of the samples that are not used and are filled by estimates; None without any.
    """

    samples: int
    rate_hz: float
    frequency_hz: Float[np.ndarray, " frequency"]
    weight: Float[np.ndarray, " frequency"]
    band: Int[np.ndarray, " frequency"]
    noise: Float[np.ndarray, "frequency sensor"]
    residual: Lines
    motion: MotionSpectra
    base: Complex[np.ndarray, " frequency"]
    supports: Complex[np.ndarray, "order frequency moved"] | None = None
    gaps: Bool[np.ndarray, "time sensor"] | None = None

    def gap_spectrum(self, explained: Lines) -> Lines:
        """Spectrum of an estimate at the samples that are not used, with zeros elsewhere."""
        if self.gaps is None:
            return np.zeros_like(self.residual)
        standing = np.where(self.gaps, self.series(explained), 0.0)
        return np.asarray(transform(standing, self.rate_hz)[1][: len(self.frequency_hz)])

    @property
    def bands(self) -> int:
        """Number of bands."""
        return int(self.band.max()) + 1

    def series(
        self, spectrum: Complex[np.ndarray, "frequency channel"]
    ) -> Float[np.ndarray, "time channel"]:
        """Transform a spectrum, zero beyond the last line, to samples (time, channel)."""
        whole = np.zeros((self.samples // 2 + 1, spectrum.shape[1]), dtype=complex)
        whole[: len(spectrum)] = spectrum / np.sqrt(2.0 / (self.rate_hz * self.samples))
        whole[0] *= np.sqrt(2.0)
        if self.samples % 2 == 0:
            whole[-1] *= np.sqrt(2.0)
        return np.asarray(np.fft.irfft(whole, self.samples, axis=0))


def trial_lines(
    linear: LinearModel,
    trial: Trial,
    residual: Float[np.ndarray, "time sensor"],
    motion: Float[np.ndarray, "order time dof"],
    noise: Noise,
    number: int,
    top_hz: float,
    outer: OuterMotion | None = None,
) -> TrialLines:
    """Transform a trial.

    Lines up to `top_hz` are kept. The residual is that of the reference, and zero where a
    sample is not used; base accelerations alone move what stands still where `outer` is not
    given.
    """
    count = len(residual)
    frequency, spectrum = transform(residual, trial.rate_hz)
    kept = int(np.searchsorted(frequency, top_hz, side="right"))
    weight = np.ones(kept)
    weight[0] = 0.5
    if kept == len(frequency) and count % 2 == 0:
        weight[-1] = 0.5
    share = np.maximum(trial.used.mean(axis=0), 1 / count)

    shaken = _base_acceleration(linear, trial) if outer is None else outer.base

    def lines(series: np.ndarray) -> np.ndarray:
        flat = transform(series.reshape(count, -1), trial.rate_hz)[1][:kept]
        return flat.reshape((kept, *series.shape[1:]))

    return TrialLines(
        samples=count,
        rate_hz=trial.rate_hz,
        frequency_hz=frequency[:kept],
        weight=weight,
        band=band_numbers(frequency[:kept]),
        noise=noise.weighting_density(number, frequency[:kept]) * share,
        residual=spectrum[:kept],
        motion=np.stack([lines(one) for one in motion]),
        base=lines(shaken[:, None])[:, 0],
        supports=(
            None
            if outer is None or not outer.supports.shape[2]
            else np.stack([lines(one) for one in outer.supports])
        ),
        gaps=None if trial.used.all() else ~trial.used,
    )


def band_numbers(
    frequency_hz: Float[np.ndarray, " frequency"],
) -> Int[np.ndarray, " frequency"]:
    """Give each line the number of its band: that at 0, then of constant relative width.

    Examples
    --------
    >>> np.bincount(band_numbers(np.linspace(0.0, 10.0, 41))).tolist()
    [1, 10, 10, 10, 10]
    """
    edges = [0, 1]
    while edges[-1] < len(frequency_hz):
        first = edges[-1]
        wide = int(np.searchsorted(frequency_hz, frequency_hz[first] * BAND_RATIO)) - first
        edges.append(first + max(wide, MIN_BAND_LINES))
    if len(edges) > 3 and len(frequency_hz) - edges[-2] < MIN_BAND_LINES:
        del edges[-2]
    edges[-1] = len(frequency_hz)
    return np.repeat(np.arange(len(edges) - 1), np.diff(edges))


def _base_acceleration(linear: LinearModel, trial: Trial) -> Float[np.ndarray, " time"]:
    total = np.zeros(len(trial.outputs))
    coordinate = linear.description.unit_of_coordinate
    for series, entry in zip(trial.inputs.T, linear.description.inputs, strict=True):
        if entry.kind == "base_acceleration":
            total += series * unit_factor(entry.unit, "acceleration", coordinate)
    return total
