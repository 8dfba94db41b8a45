"""Ambient response in, natural frequency and damping by the likelihood of its spectrum out."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.signals.spectra import detrended, periodogram

from . import checks
from .combine import modal_series
from .detect import Candidate, strongest
from .identified import Identified, Measured
from .whittle import Ordinates, Resonance, fit_resonance, fit_smooth, grouped, log_likelihood

REACH = 60.0
"""The band is f (1 ± REACH zeta), where nothing else limits it; a wide one fixes the floor."""

STARTS = np.geomspace(5e-4, 0.15, 12)
THRESHOLD = 12.0
"""Gain in log-likelihood over a smooth spectrum below which there is no mode to speak of."""


def identify_ambient(
    acceleration: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    band_hz: tuple[float, float] | None = None,
    derivatives: int = 2,
) -> Identified:
    r"""Mode behind the strongest resonance of a response to ambient excitation.

    Maximum likelihood of the raw periodogram of the whole record [1]_: natural frequency,
    damping ratio, level and noise floor are all fitted, leakage is in the model
    (`expected_resonance`), and the errors come from the information in the ordinates:

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
        Look only there; by default the whole usable spectrum.
    derivatives
        What was measured: 2 acceleration, 1 velocity, 0 displacement.

    Returns
    -------
    The mode; flagged `below_threshold` where the record holds no more than smooth noise, and
    `few_cycles` where the errors stand on fewer than 20 half-bandwidths.

    References
    ----------
    .. [1] S.-K. Au, "Uncertainty law in ambient modal identification", MSSP 48 (2014).
    """
    columns = detrended(checks.series(acceleration, rate_hz))
    low, high = checks.band(band_hz, rate_hz, len(columns))
    return fit_ambient(columns, rate_hz, strongest(columns, rate_hz, low, high), derivatives)


def fit_ambient(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    candidate: Candidate,
    derivatives: int = 2,
) -> Identified:
    """Whittle fit of the resonance that `candidate` points at, within its band."""
    series = modal_series(columns, rate_hz, candidate)
    spectrum = periodogram(series[:, None], rate_hz)
    whole = Ordinates(
        frequency_hz=spectrum.frequency_hz,
        density=spectrum.density[:, 0],
        number=np.ones(len(spectrum.frequency_hz)),
        rate_hz=rate_hz,
        count=len(series),
        derivatives=derivatives,
    )
    whole = _within(whole, max(candidate.low_hz, 2 * spectrum.spacing_hz), candidate.high_hz)
    start = _start(grouped(whole, candidate.frequency_hz), candidate)
    for _ in range(2):
        data = grouped(_around(whole, start), float(np.exp(start[0])))
        fit = fit_resonance(data, start)
        start = fit.parameters
    return _identified(data, fit)


def _within(data: Ordinates, low: float, high: float) -> Ordinates:
    inside = (data.frequency_hz >= low) & (data.frequency_hz <= high)
    return dataclasses.replace(
        data,
        frequency_hz=data.frequency_hz[inside],
        density=data.density[inside],
        number=data.number[inside],
    )


def _around(data: Ordinates, theta: np.ndarray) -> Ordinates:
    """Keep the ordinates within reach of a resonance, 24 at least where there are as many."""
    centre, damping = np.exp(theta[:2])
    reach = max(REACH * damping * centre, 12.0 * data.rate_hz / data.count)
    return _within(data, centre - reach, centre + reach)


def _start(data: Ordinates, candidate: Candidate) -> np.ndarray:
    """Best of a grid over damping and a little frequency, levels from moments."""
    floor = max(np.quantile(data.density, 0.1), 1e-9 * data.density.max(), 1e-300)
    bins = data.rate_hz / data.count
    best: tuple[float, np.ndarray] | None = None
    for damping in STARTS:
        nearby = max(bins, 0.5 * damping * candidate.frequency_hz)
        for offset in (-nearby, 0.0, nearby):
            frequency = candidate.frequency_hz + offset
            if not data.frequency_hz[0] < frequency < data.frequency_hz[-1]:
                continue
            shape = data.shape(float(np.log(frequency)), float(np.log(damping)))
            shape = np.maximum(shape, 1e-12)
            peak = max(
                float(np.mean(data.density / (shape + floor / data.density.max()))), floor
            )
            expected = peak * shape + floor
            likelihood = log_likelihood(data, expected)
            if best is None or likelihood > best[0]:
                best = likelihood, np.log([frequency, damping, peak, floor])
    if best is None:
        raise ValueError(
            f"No frequency bin near {candidate.frequency_hz:g} Hz lies inside the band. "
            "Widen band_hz, or record longer."
        )
    return best[1]


def _identified(data: Ordinates, fit: Resonance) -> Identified:
    frequency, damping, peak, floor = np.exp(fit.parameters)
    # The error bar rests on an estimated bandwidth, whose own scatter makes the tails heavier.
    sd = np.sqrt(np.diag(fit.covariance) * (1.0 + min(fit.covariance[1, 1], 1.0)))
    flags = []
    if not fit.converged:
        flags.append("not_converged")
    if fit.log_likelihood - fit_smooth(data) < THRESHOLD:
        flags.append("below_threshold")
    duration = data.count / data.rate_hz
    if damping * frequency * duration < 3.0:
        flags.append("few_cycles")
    return Identified(
        frequency_hz=Measured(float(frequency), float(frequency * sd[0])),
        damping_ratio=Measured(float(damping), float(damping * sd[1])),
        correlation=float(
            fit.covariance[0, 1] / np.sqrt(fit.covariance[0, 0] * fit.covariance[1, 1])
        ),
        snr_db=float(10 * np.log10(peak / floor)),
        amplitude=float(np.sqrt(peak * np.pi / 2 * damping * frequency)),
        method="ambient",
        span_s=(0.0, duration),
        flags=tuple(flags),
    )
