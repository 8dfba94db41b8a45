"""Frequency and damping of a free decay by maximum likelihood."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.detection.channel_combination import modal_series
from slowtime.identification.detection.mode_isolation import IsolatedSeries, isolate_mode
from slowtime.identification.detection.resonance_peaks import (
    PeakCandidate,
    detect_peaks,
    strongest_peak,
    without_companions,
)
from slowtime.identification.estimates import Identified
from slowtime.signals.spectra import detrended

from .decay_errors import SegmentFit, mode_of_fit
from .decay_fit import DecayFit, drift_basis, fit_decays, matrix_pencil, signal_subspace

MOST_MODES = 3
"""Largest number of decays that are fitted together."""

PRICE = 8.0
"""Penalty per mode [ln n]: twice the four parameters of the Bayesian criterion, because noise
offers a mode at every frequency."""


NEIGHBOUR = 2.0**0.25
"""Largest ratio of the frequencies of a fit and of its candidate."""

EARLY = 4
"""Steps after which a fit has nearly explained what it will."""

FRONT_SHARE = 0.9
"""Least share of the power in the first half of the record of an impact."""

IMPACT_DAMPINGS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
"""Initial damping ratios after an impact [1]."""


def identify_free_decay(
    acceleration: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
) -> Identified:
    r"""Lowest mode of a record that starts with the decay and is left alone from there.

    Maximum likelihood of :math:`A e^{-\alpha t} \cos(\omega_d t + \varphi)` plus an offset in
    white noise of unknown variance, whose errors reach the Cramér-Rao bound

    .. math:: \mathrm{var}\, \omega_d = \mathrm{var}\, \alpha
              = \frac{1}{\mathrm{SNR}_0 f_s (J_2 - J_1^2 / J_0)}, \qquad
              J_k = \int_0^T t^k e^{-2 \alpha t} dt, \quad
              \mathrm{SNR}_0 = A^2 / 2 \sigma^2 ,

    above a threshold of signal to noise. A record with several modes, or a given band, is
    band-limited first by filters that leave decays exact, and close modes are fitted together.
    Where the residual is not white, the noise density next to the mode sets the errors.

    Parameters
    ----------
    acceleration
        Equally spaced samples in any unit; displacement and velocity do as well.
    rate_hz
        Samples per second [Hz].
    band_hz
        Look only there; by default the whole usable spectrum.

    Returns
    -------
    The mode; flagged `below_threshold` where noise alone explains the record as well, and
    `not_decaying` where the damping is not positive.
    """
    columns = checks.series(acceleration, rate_hz)
    low, high = checks.band(band_hz, rate_hz, len(columns))
    flat = detrended(columns)
    found = detect_peaks(flat, rate_hz, low, high, taper="boxcar")
    chosen = (
        without_companions(found, len(columns) / rate_hz)
        or [strongest_peak(flat, rate_hz, low, high, taper="boxcar")]
    )[0]
    series = modal_series(columns, rate_hz, chosen)
    rough = fit_segment(isolate_mode(series - series.mean(), rate_hz, chosen), chosen)
    if len(found) > 1 or band_hz is not None or rough.others:
        return rough.identified
    drift = drift_basis(len(series), 1)
    fit = fit_decays(series, rate_hz, np.array([rough.pole]), drift)
    return mode_of_fit(fit, 0, rate_hz).identified


def fit_segment(part: IsolatedSeries, candidate: PeakCandidate) -> SegmentFit:
    """Fit as many decays as the Bayesian criterion allows; return the candidate's.

    It is flagged `strayed` if none is near the candidate.
    """
    return fit_spanned(SpannedSegment.of(part), candidate)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SpannedSegment:
    """A series, its drift and the signal subspace of the rest, from which fits start."""

    part: IsolatedSeries
    drift: Float[np.ndarray, "time term"]
    space: Float[np.ndarray, "lag direction"]

    @classmethod
    def of(cls, part: IsolatedSeries) -> "SpannedSegment":
        """Span a series, which takes as long as a step of a fit."""
        count = len(part.series)
        drift = drift_basis(count, 1 + int(2 * count / part.rate_hz * part.drift_hz))
        space = signal_subspace(part.series - drift @ (drift.T @ part.series))
        return cls(part, drift, space)

    @property
    def duration_s(self) -> float:
        """Of the series [s]."""
        return len(self.part.series) / self.part.rate_hz


def explained_early(spanned: SpannedSegment, candidate: PeakCandidate) -> float:
    """Share of the power that decays explain after a few steps of their fit [1].

    Parameters
    ----------
    spanned
        Series reduced to one mode.
    candidate
        Detected peak, with the band that belongs to it [Hz].
    """
    part = spanned.part
    poles = matrix_pencil(spanned.space, part.rate_hz, MOST_MODES)
    poles = _started(poles, part, candidate)
    fit = fit_decays(part.series, part.rate_hz, poles, spanned.drift, steps=EARLY)
    which = index_of_candidate(fit, spanned.duration_s, candidate, part.shift_hz)
    return mode_of_fit(
        fit, which or 0, part.rate_hz, part.start_s, part.band_hz, part.shift_hz
    ).explained


def fit_spanned(spanned: SpannedSegment, candidate: PeakCandidate) -> SegmentFit:
    """Fit decays as `fit_segment` does.

    Parameters
    ----------
    spanned
        Series reduced to one mode.
    candidate
        Detected peak, with the band that belongs to it [Hz].

    Returns
    -------
    Mode of the candidate, flagged `strayed` if none is near it.
    """
    part, drift, space = spanned.part, spanned.drift, spanned.space
    fit, worth = _with_modes(1, part, candidate, space, drift)
    for order in range(2, MOST_MODES + 1):
        more, gained = _with_modes(order, part, candidate, space, drift)
        if gained >= worth:
            break
        fit, worth = more, gained
    which = index_of_candidate(fit, spanned.duration_s, candidate, part.shift_hz)
    told = mode_of_fit(fit, which or 0, part.rate_hz, part.start_s, part.band_hz, part.shift_hz)
    if which is None:
        return dataclasses.replace(told, identified=_strayed(told.identified))
    return told


def fit_impact_decay(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    found: Sequence[PeakCandidate],
) -> SegmentFit | None:
    """Fit the decay after an impact at the start of a record, all modes together.

    None where the record does not have most of its power in its first half. Modes of all
    candidates are fitted; the first is given.
    """
    loudness = np.sum(columns**2, axis=1)
    if loudness[: len(loudness) // 2].sum() < FRONT_SHARE * loudness.sum():
        return None
    # Nothing is filtered away first, since a filter would cost the first and loudest samples.
    series = modal_series(columns, rate_hz, found[0])
    drift = drift_basis(len(series), 1)
    omegas = 2 * np.pi * np.array([one.frequency_hz for one in found[:MOST_MODES]])
    starts = [omegas * (1j - damping) for damping in IMPACT_DAMPINGS]
    rough = [fit_decays(series, rate_hz, poles, drift, steps=0) for poles in starts]
    best = int(np.argmin([fit.cost for fit in rough]))
    fit = fit_decays(series, rate_hz, starts[best], drift)
    which = index_of_candidate(fit, len(series) / rate_hz, found[0])
    return None if which is None else mode_of_fit(fit, which, rate_hz)


def _with_modes(
    order: int,
    part: IsolatedSeries,
    candidate: PeakCandidate,
    space: np.ndarray,
    drift: np.ndarray,
) -> tuple[DecayFit, float]:
    """Fit of at most `order` modes, and its criterion: the lower, the better."""
    poles = _started(matrix_pencil(space, part.rate_hz, order), part, candidate)
    fit = fit_decays(part.series, part.rate_hz, poles, drift)
    count = len(part.series)
    price = PRICE * len(poles) * np.log(count)
    return fit, float(count * np.log(fit.cost / count + 1e-300) + price)


def _strayed(mode: Identified) -> Identified:
    """Mark a fit that ran away from its candidate and knows nothing of it."""
    return dataclasses.replace(
        mode,
        frequency_hz=dataclasses.replace(mode.frequency_hz, sd=float("inf")),
        flags=(*mode.flags, "strayed"),
    )


def index_of_candidate(
    fit: DecayFit, duration: float, candidate: PeakCandidate, shift_hz: float = 0.0
) -> int | None:
    """Index of the most energetic fitted mode near the candidate, if there is one.

    `shift_hz` was subtracted from all frequencies before.
    """
    decay = np.clip(-fit.poles.real, 1e-9, None)
    energy = np.abs(fit.amplitudes) ** 2 * -np.expm1(-2 * decay * duration) / decay
    poles = fit.poles + 2j * np.pi * shift_hz
    ratio = np.abs(poles) / (2 * np.pi * candidate.frequency_hz)
    near = (ratio > 1 / NEIGHBOUR) & (ratio < NEIGHBOUR)
    return int(np.argmax(np.where(near, energy, -1.0))) if near.any() else None


def _started(
    poles: Complex[np.ndarray, " mode"], part: IsolatedSeries, candidate: PeakCandidate
) -> Complex[np.ndarray, " started"]:
    """Poles in the band, decaying at least a little; the candidate's own if there are none."""
    hz = poles.imag / (2 * np.pi)
    poles = poles[(hz > part.low_hz) & (hz < part.high_hz)]
    if len(poles) == 0:
        own = 2 * np.pi * candidate.frequency_hz * np.array([-0.01 + 1j])
        poles = own - 2j * np.pi * part.shift_hz
    slowest = -0.1 * part.rate_hz / len(part.series)
    return np.asarray(np.clip(poles.real, -0.5 * poles.imag, slowest) + 1j * poles.imag)
