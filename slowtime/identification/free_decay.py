"""Free decay in, natural frequency and damping by maximum likelihood out."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.signals.spectra import detrended, periodogram

from . import checks
from .combine import modal_series
from .decays import Decays, drift_basis, fit_decays, matrix_pencil
from .detect import Candidate, candidates, leading, strongest
from .identified import Identified, Measured
from .isolate import Isolated, isolate

MOST_MODES = 3
PRICE = 8.0
"""Each further mode must gain so many times ln n in n ln(cost): twice the Bayesian criterion's
four parameters, because noise offers a mode at every frequency to choose from.
"""

THRESHOLD = 12.0
"""Gain in log-likelihood over pure noise below which there is no decay to speak of."""

NEIGHBOUR = 2.0**0.25
"""A fitted mode further from its candidate than this factor is not the candidate's."""

FRONT_SHARE = 0.9
"""Share of the power in the first half of a record from which on it is taken for a blow."""

BLOW_DAMPINGS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)

NEAR_BINS = 12
"""Noise is judged on so many bins on either side of the mode."""


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
    found = candidates(flat, rate_hz, low, high, taper="boxcar")
    chosen = (
        leading(found, len(columns) / rate_hz)
        or [strongest(flat, rate_hz, low, high, taper="boxcar")]
    )[0]
    series = modal_series(columns, rate_hz, chosen)
    rough = fit_stretch(isolate(series - series.mean(), rate_hz, chosen), chosen)
    if len(found) > 1 or band_hz is not None or rough.others:
        return rough.identified
    drift = drift_basis(len(series), 1)
    fit = fit_decays(series, rate_hz, np.array([rough.pole]), drift)
    return describe(fit, 0, rate_hz, 0.0).identified


@dataclasses.dataclass(frozen=True, slots=True)
class Stretch:
    """A mode read off one stretch, its pole [1/s, rad/s], and how well decays explain it."""

    identified: Identified
    pole: complex
    others: int
    explained: float


def fit_stretch(part: Isolated, candidate: Candidate) -> Stretch:
    """Fit as many decays together as the likelihood pays for; give the candidate's."""
    count = len(part.series)
    duration = count / part.rate_hz
    drift = drift_basis(count, 1 + int(2 * duration * part.drift_hz))
    target = part.series - drift @ (drift.T @ part.series)
    fit, worth = _with_modes(1, part, candidate, target, drift)
    for order in range(2, MOST_MODES + 1):
        more, gained = _with_modes(order, part, candidate, target, drift)
        if gained >= worth:
            break
        fit, worth = more, gained
    which = own_mode(fit, duration, candidate)
    if which is None:
        strayed = describe(fit, 0, part.rate_hz, part.start_s)
        return dataclasses.replace(strayed, identified=_strayed(strayed.identified))
    return describe(fit, which, part.rate_hz, part.start_s)


def fit_blow(
    columns: Float[np.ndarray, "time channel"],
    rate_hz: float,
    found: Sequence[Candidate],
) -> Stretch | None:
    """Fit the decay after one blow at the start of a record, all its modes together.

    Nothing is filtered away first, since a filter would cost the first and loudest samples.
    None where the record does not have most of its power in its first half.
    """
    loudness = np.sum(columns**2, axis=1)
    if loudness[: len(loudness) // 2].sum() < FRONT_SHARE * loudness.sum():
        return None
    series = modal_series(columns, rate_hz, found[0])
    drift = drift_basis(len(series), 1)
    omegas = 2 * np.pi * np.array([one.frequency_hz for one in found[:MOST_MODES]])
    starts = [omegas * (1j - damping) for damping in BLOW_DAMPINGS]
    rough = [fit_decays(series, rate_hz, poles, drift, steps=0) for poles in starts]
    best = int(np.argmin([fit.cost for fit in rough]))
    fit = fit_decays(series, rate_hz, starts[best], drift)
    which = own_mode(fit, len(series) / rate_hz, found[0])
    return None if which is None else describe(fit, which, rate_hz, 0.0)


def _with_modes(
    order: int, part: Isolated, candidate: Candidate, target: np.ndarray, drift: np.ndarray
) -> tuple[Decays, float]:
    """Fit of at most `order` modes, and its criterion: the lower, the better."""
    poles = _started(matrix_pencil(target, part.rate_hz, order), part, candidate)
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


def own_mode(fit: Decays, duration: float, candidate: Candidate) -> int | None:
    """Index of the most energetic fitted mode near the candidate, if there is one."""
    decay = np.clip(-fit.poles.real, 1e-9, None)
    energy = np.abs(fit.amplitudes) ** 2 * -np.expm1(-2 * decay * duration) / decay
    ratio = np.abs(fit.poles) / (2 * np.pi * candidate.frequency_hz)
    near = (ratio > 1 / NEIGHBOUR) & (ratio < NEIGHBOUR)
    return int(np.argmax(np.where(near, energy, -1.0))) if near.any() else None


def _started(
    poles: Complex[np.ndarray, " mode"], part: Isolated, candidate: Candidate
) -> Complex[np.ndarray, " started"]:
    """Poles in the band, decaying at least a little; the candidate's own if there are none."""
    hz = poles.imag / (2 * np.pi)
    poles = poles[(hz > part.low_hz) & (hz < part.high_hz)]
    if len(poles) == 0:
        poles = 2 * np.pi * candidate.frequency_hz * np.array([-0.01 + 1j])
    slowest = -0.1 * part.rate_hz / len(part.series)
    return np.asarray(np.clip(poles.real, -0.5 * poles.imag, slowest) + 1j * poles.imag)


def describe(fit: Decays, which: int, rate_hz: float, start_s: float) -> Stretch:
    """One mode of a fit, with errors from the information and the noise next to the mode."""
    pole, modes, count = complex(fit.poles[which]), len(fit.poles), len(fit.residual)
    variance, coloured = _noise(fit, abs(pole.imag), rate_hz)
    pick = np.array([which, modes + which])
    covariance = variance * fit.unit_covariance[np.ix_(pick, pick)]
    natural, damping = abs(pole), -pole.real / abs(pole)
    # Slopes of (|s|, -Re s / |s|) in (Re s, Im s).
    slopes = np.array(
        [
            [pole.real / natural, pole.imag / natural],
            [-(pole.imag**2) / natural**3, pole.real * pole.imag / natural**3],
        ]
    )
    both = slopes @ covariance @ slopes.T
    sd = np.sqrt(np.diag(both))
    amplitude = abs(fit.amplitudes[which])
    wave = amplitude**2 / 2 * _mean_square(-2 * pole.real, count / rate_hz)
    explained = wave / (wave + fit.cost / count)
    flags = ["coloured_residual"] if coloured else []
    if 0.5 * count * np.log1p(wave / (fit.cost / count + 1e-300)) < THRESHOLD:
        flags.append("below_threshold")
    if damping <= 0:
        flags.append("not_decaying")
    if not fit.converged:
        flags.append("not_converged")
    identified = Identified(
        frequency_hz=Measured(natural / (2 * np.pi), float(sd[0]) / (2 * np.pi)),
        damping_ratio=Measured(damping, float(sd[1])),
        correlation=float(both[0, 1] / (sd[0] * sd[1])) if sd.all() else 0.0,
        snr_db=float(10 * np.log10(amplitude**2 / (2 * variance))) if variance else None,
        amplitude=float(amplitude),
        method="free_decay",
        span_s=(start_s, start_s + count / rate_hz),
        flags=tuple(flags),
    )
    return Stretch(identified, pole, modes - 1, float(explained))


def _mean_square(rate: float, duration: float) -> float:
    """Mean of exp(-rate t) over the duration."""
    x = float(np.clip(rate * duration, -50.0, 1e9))
    return 1.0 if abs(x) < 1e-9 else float(-np.expm1(-x) / x)


def _noise(fit: Decays, omega: float, rate_hz: float) -> tuple[float, bool]:
    """Noise variance per sample: its density next to the mode, if not higher by chance."""
    count = len(fit.residual)
    used = 4 * len(fit.poles)
    white = fit.cost / max(count - used, 1)
    density = periodogram(fit.residual[:, None], rate_hz).density[:, 0] * rate_hz / 2
    centre = round(omega / (2 * np.pi) * count / rate_hz)
    near = density[max(centre - NEAR_BINS, 1) : centre + NEAR_BINS + 1]
    free = max(len(near) - used / 2, 1.0)
    local = float(near.sum()) / free
    if local < white * (1 + 2.6 / np.sqrt(free)):
        return white, False
    return local, True
