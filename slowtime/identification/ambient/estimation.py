"""Frequency and damping from ambient response, by the likelihood of its spectrum."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from slowtime.identification import checks
from slowtime.identification.detection.channel_combination import modal_series
from slowtime.identification.detection.resonance_peaks import PeakCandidate, strongest_peak
from slowtime.identification.estimates import Identified, Measured
from slowtime.identification.free_decay.segments import (
    FEWEST_CYCLES,
    may_change,
    widen_for_change,
)
from slowtime.signals.spectra import detrended, periodogram, transform

from .coefficient_likelihood import FourierCoefficients, maximise_posterior
from .damping_posterior import DampingPosterior, damping_posterior
from .fit_band import FitBand, widest_fit_band
from .whittle import (
    COLOUR,
    DAMPING,
    FLOOR,
    FREQUENCY,
    Periodogram,
    PosteriorMaximum,
    ResonanceFit,
    fit_resonance,
    group_ordinates,
    smooth_log_likelihood,
    whittle_log_likelihood,
)

STARTS = np.geomspace(5e-4, 0.15, 12)
"""Damping ratios of the initial grid [1]."""

NEAR = 1.6
"""Initial fit: ratio of the band limits to the candidate's frequency."""

FEWEST = 24
"""Initial fit: least number of ordinates."""

ROUNDS = 2
"""Rounds of band choice: the band is measured in half-bandwidths, which the first round
estimates."""

ACCELERATION = 3.0
"""Prior log-odds that a record is one of acceleration."""

LONG = 100.0
"""Value of 2 pi zeta f T above which ordinates are practically independent, and the Whittle
likelihood is used [1]."""

MOST_SD = 1.0
"""Largest scale of the finite differences [1]."""

OCTAVE = 2.0
"""Ratio of frequency to lower band limit of the coefficient likelihood; below, coefficients are
mainly leakage, part of which detrending has removed."""

UNSEEN = 1.0
"""Standard deviation of ln floor above which the floor is held at its initial value."""

FEW = 50.0
"""Value of 2 pi zeta f T below which `few_cycles` is flagged: errors then exceed the
uncertainty law, and the posterior of the damping is skewed [1]."""

THRESHOLD = 12.0
"""Gain of log-likelihood over a smooth spectrum below which `below_threshold` is flagged."""


LEAST_OF_CURVATURE = 0.5
"""[1] Of the variance of ln f at the top of the posterior, the least that it can be over all
dampings. Source: 0.62 to 1.8 in 160 simulated halves of 1 to 200 memories, above 0.97 in those
of 5 or more."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Posterior:
    """Top of a posterior, and its profile at given dampings."""

    top: PosteriorMaximum
    profile: Callable[[np.ndarray], PosteriorMaximum]

    def of_damping(self) -> DampingPosterior:
        """Posterior of the damping, which costs ten times what the top does."""
        return damping_posterior(self.profile, self.top)


def identify_ambient(
    acceleration: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    derivatives: int | None = None,
) -> Identified:
    r"""Mode behind the strongest resonance of a response to ambient excitation.

    Likelihood of the raw periodogram of the whole record [1]_: natural frequency, damping
    ratio, level, noise floor and colour of the force are all fitted, leakage is in the model
    (`expected_resonance`), over the band in which one mode explains the spectrum
    (`widest_fit_band`). The errors come from the posterior of the damping, and tend to

    .. math:: \mathrm{sd}(f) / f \to \sqrt{\zeta / (2 \pi N_c B_f)}, \quad
              \mathrm{sd}(\ln \zeta) \to 1 / \sqrt{2 \pi \zeta N_c B_\zeta}

    for :math:`N_c` cycles without noise. Several channels become one series first, weighted
    for the best signal to noise at the peak.

    Parameters
    ----------
    acceleration
        Equally spaced samples, any unit.
    rate_hz
        Samples per second [Hz].
    band_hz
        Look only there; by default the whole usable spectrum. The band of the fit is chosen
        within it.
    derivatives
        What was measured: 2 acceleration, 1 velocity, 0 displacement; by default what the
        skirts of the resonance say.

    Returns
    -------
    The mode, with a word on each doubt:

    - `below_threshold`: the record holds no more than smooth noise;
    - `few_cycles`: :math:`2 \pi \zeta f T < 50`, so that damping is hardly known and skewed;
    - `misfit`: not even close to the peak does one mode explain the spectrum;
    - `on_edge`: the peak lies at the edge of its band, which is the skirt of something else.

    References
    ----------
    .. [1] S.-K. Au, "Uncertainty law in ambient modal identification", MSSP 48 (2014).
    """
    columns = detrended(checks.series(acceleration, rate_hz))
    low, high = checks.band(band_hz, rate_hz, len(columns))
    return fit_ambient(
        columns, rate_hz, strongest_peak(columns, rate_hz, low, high), derivatives
    )


def fit_ambient(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    candidate: PeakCandidate,
    derivatives: int | None = None,
) -> Identified:
    """Fit the resonance of a candidate by the likelihood of the spectrum in its band.

    What was measured is given by `derivatives`: 2 acceleration, 1 velocity, 0 displacement; the
    likeliest of them where None.
    """
    series = modal_series(columns, rate_hz, candidate)
    return _identified(series, _extent(series, rate_hz, candidate, derivatives))


def fit_ambient_steady(
    columns: Float[np.ndarray, "time channel"], rate_hz: float, candidate: PeakCandidate
) -> Identified:
    """Fit a whole record, and widen the error by the change between its halves."""
    series = modal_series(columns, rate_hz, candidate)
    extent = _extent(series, rate_hz, candidate, None)
    whole, middle = _identified(series, extent), len(series) // 2
    if middle * candidate.frequency_hz / rate_hz < 2 * FEWEST_CYCLES:
        return whole
    halves = [
        _Half.of(half, rate_hz, extent)
        for half in (series[:middle], series[len(series) - middle :])
    ]
    # Nine records of ten do not change: their posteriors, half of the work, would add nothing.
    if not may_change(*(half.least for half in halves)):
        return whole
    return widen_for_change(whole, *(half.measured() for half in halves))


@dataclasses.dataclass(frozen=True, slots=True)
class _Half:
    """Half of a record in the band of the whole; without a top where the fit did not end."""

    fit: ResonanceFit
    posterior: _Posterior | None

    @classmethod
    def of(cls, half: Float[np.ndarray, " time"], rate_hz: float, extent: FitBand) -> "_Half":
        edges = extent.data.frequency_hz[[0, -1]]
        whole = _ordinates(detrended(half[:, None])[:, 0], rate_hz, extent.data.derivatives)
        start = extent.fit.parameters
        data = group_ordinates(whole.within(*edges), float(np.exp(start[0])))
        fit = fit_resonance(data, start)
        return cls(fit, _posterior(half, data, fit) if fit.converged else None)

    @property
    def least(self) -> Measured:
        """Frequency with the least error that its posterior can have [Hz]."""
        if self.posterior is None:
            return self.measured()
        variance = LEAST_OF_CURVATURE * self.posterior.top.covariance[FREQUENCY, FREQUENCY]
        return self._with(float(variance))

    def measured(self) -> Measured:
        """Frequency with its error over all dampings [Hz]."""
        if self.posterior is None:
            return Measured(float(np.exp(self.fit.parameters[FREQUENCY])), float("inf"))
        return self._with(self.posterior.of_damping().log_frequency_variance)

    def _with(self, log_variance: float) -> Measured:
        assert self.posterior is not None
        frequency = float(np.exp(self.posterior.top.parameters[FREQUENCY]))
        return Measured(frequency, frequency * float(np.sqrt(log_variance)))


def _posterior(
    series: Float[np.ndarray, " time"], data: Periodogram, fit: ResonanceFit
) -> _Posterior:
    """Posterior in a band."""
    # Whittle's likelihood, or the one with all correlations where the record is short.
    frequency, damping = np.exp(fit.parameters[:2])
    if 2 * np.pi * damping * frequency * data.duration_s > LONG:

        def of_ordinates(theta: np.ndarray) -> PosteriorMaximum:
            held = fit_resonance(data, theta, held=(DAMPING,))
            return PosteriorMaximum(held.parameters, held.covariance, held.log_likelihood)

        top = PosteriorMaximum(fit.parameters, fit.covariance, fit.log_likelihood)
        return _Posterior(top, of_ordinates)
    place, value = transform(series[:, None], data.rate_hz)
    low, high = data.frequency_hz[[0, -1]]
    inside = (place >= max(low, frequency / OCTAVE)) & (place <= high)
    coefficients = FourierCoefficients(
        place[inside],
        value[inside, 0],
        data.duration_s,
        data.derivatives,
        float(fit.parameters[FLOOR]),
    )
    sd = np.minimum(np.sqrt(np.diag(fit.covariance)), MOST_SD)
    # A floor far below all else cannot be told, and is no direction to climb in.
    held = (FLOOR,) if np.sqrt(fit.covariance[FLOOR, FLOOR]) > UNSEEN else ()
    top = maximise_posterior(coefficients, fit.parameters, sd, held=held)

    def of_coefficients(theta: np.ndarray) -> PosteriorMaximum:
        return maximise_posterior(coefficients, theta, sd, held=(DAMPING, *held))

    return _Posterior(top, of_coefficients)


def _ordinates(
    series: Float[np.ndarray, " time"], rate_hz: float, derivatives: int
) -> Periodogram:
    spectrum = periodogram(series[:, None], rate_hz)
    return Periodogram(
        frequency_hz=spectrum.frequency_hz,
        density=spectrum.density[:, 0],
        number=np.ones(len(spectrum.frequency_hz)),
        rate_hz=rate_hz,
        count=len(series),
        derivatives=derivatives,
    )


def _extent(
    series: Float[np.ndarray, " time"],
    rate_hz: float,
    candidate: PeakCandidate,
    derivatives: int | None,
) -> FitBand:
    """Band in which one mode explains the spectrum about a candidate, and the fit to it."""
    whole = _ordinates(series, rate_hz, 2 if derivatives is None else derivatives)
    lowest = max(candidate.low_hz, 2 / whole.duration_s)
    whole = whole.within(lowest, candidate.high_hz)
    whole, start = _measured(whole, candidate, derivatives)
    for _ in range(ROUNDS):
        extent = widest_fit_band(whole, start)
        start = extent.fit.parameters
    return extent


def _measured(
    whole: Periodogram, candidate: PeakCandidate, derivatives: int | None
) -> tuple[Periodogram, np.ndarray]:
    """Tell how often a displacement was differentiated; the first guess with it."""
    near = whole.within(candidate.frequency_hz / NEAR, candidate.frequency_hz * NEAR)
    if len(near.frequency_hz) < FEWEST:
        near = whole
    data = group_ordinates(near, candidate.frequency_hz)
    best: tuple[float, Periodogram, np.ndarray] | None = None
    for tried in (2, 1, 0) if derivatives is None else (derivatives,):
        as_tried = dataclasses.replace(data, derivatives=tried)
        fit = fit_resonance(as_tried, _start(as_tried, candidate))
        worth = fit.log_likelihood + (ACCELERATION if tried == 2 else 0.0)
        if best is None or worth > best[0]:
            start = np.append(fit.parameters, 0.0)
            best = worth, dataclasses.replace(whole, derivatives=tried), start
    assert best is not None
    return best[1:]


def _start(data: Periodogram, candidate: PeakCandidate) -> np.ndarray:
    """Best of a grid over damping and a little frequency, levels from moments."""
    floor = max(np.quantile(data.density, 0.1), 1e-9 * data.density.max(), 1e-300)
    bins = data.rate_hz / data.count
    damping = np.repeat(STARTS, 3)
    nearby = np.maximum(bins, 0.5 * damping * candidate.frequency_hz)
    frequency = candidate.frequency_hz + nearby * np.tile([-1.0, 0.0, 1.0], len(STARTS))
    inside = (frequency > data.frequency_hz[0]) & (frequency < data.frequency_hz[-1])
    best: tuple[float, np.ndarray] | None = None
    shapes = data.shapes(np.log(frequency[inside]), np.log(damping[inside]))
    for f, z, row in zip(frequency[inside], damping[inside], shapes, strict=True):
        shape = np.maximum(row, 1e-12)
        peak = max(float(np.mean(data.density / (shape + floor / data.density.max()))), floor)
        likelihood = whittle_log_likelihood(data, peak * shape + floor)
        if best is None or likelihood > best[0]:
            best = likelihood, np.log([f, z, peak, floor])
    if best is None:
        raise ValueError(
            f"No frequency bin near {candidate.frequency_hz:g} Hz lies inside the band. "
            "Widen band_hz, or record longer."
        )
    return best[1]


def _identified(series: Float[np.ndarray, " time"], extent: FitBand) -> Identified:
    data, fit = extent.data, extent.fit
    found = _posterior(series, data, fit)
    top, posterior = found.top, found.of_damping()
    frequency, _, peak, floor = np.exp(top.parameters[:COLOUR])
    damping = posterior.value
    sd_f = float(frequency * np.sqrt(posterior.log_frequency_variance + extent.choice[0]))
    sd_z = float(np.hypot(posterior.sd, damping * np.sqrt(extent.choice[1])))
    memories = 2 * np.pi * damping * frequency * data.duration_s
    if memories < 1.0:
        # Whatever the likelihood says at its edge: a damping whose memory is longer than the
        # record cannot be told from none, nor better than a bin of half-power bandwidth.
        bin_z = 0.5 / (frequency * data.duration_s)
        sd_z = float(np.hypot(sd_z, bin_z))
        share = bin_z / (4 * np.pi * frequency * data.duration_s)
        sd_f = float(np.hypot(sd_f, frequency * np.sqrt(share)))
    flags = []
    if not fit.converged:
        flags.append("not_converged")
    if fit.log_likelihood - smooth_log_likelihood(data) < THRESHOLD:
        flags.append("below_threshold")
    if extent.on_edge:
        flags.append("on_edge")
    if not extent.holds:
        flags.append("misfit")
    if memories < FEW:
        flags.append("few_cycles")
    return Identified(
        frequency_hz=Measured(float(frequency), sd_f),
        damping_ratio=Measured(damping, sd_z),
        correlation=float(
            top.covariance[0, 1] / np.sqrt(top.covariance[0, 0] * top.covariance[1, 1])
        ),
        snr_db=float(10 * np.log10(peak / floor)),
        amplitude=float(np.sqrt(peak * np.pi / 2 * damping * frequency)),
        method="ambient",
        span_s=(0.0, data.duration_s),
        flags=tuple(flags),
    )
