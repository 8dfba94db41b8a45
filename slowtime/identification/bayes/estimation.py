r"""Bayesian FFT modal identification: most probable modes with posterior errors.

Bayesian FFT modal identification: the Fourier coefficients of the whole record in the band of a
mode, or of a few close ones, are independent complex Gaussians with the spectral matrix that
the modes predict; nothing is averaged, windowed or lost, so the errors come close to the
uncertainty laws (`ambient_law`). The posterior is Gaussian about its maximum for all but the
shortest records.

What differs from the literature: the predicted matrices hold the leakage of the finite record
(the debiased Whittle likelihood), the noise is each channel's own, the density of the forces
may slope within a band, the tails of modes outside a band are known from their own bands, and
the top is found by Fisher scoring with worked-out derivatives in place of
expectation-maximisation. Whether the modal forces have anything in common is first asked of the
whole record, by a score test, for what is known of one mode from the tails of others is lost
where their coherence has to be found too.

References
----------
.. [1] S.-K. Au, "Fast Bayesian FFT method for ambient modal identification with separated
   modes", J. Engineering Mechanics 137 (2011); "Fast Bayesian ambient modal identification in
   the frequency domain, part I: posterior most probable value", MSSP 26 (2012) for close modes.
.. [2] S.-K. Au, B. Li, F.-L. Zhang, P. Liu, "Operational Modal Analysis: Modeling, Bayesian
   Inference, Uncertainty Laws", Springer (2017).
.. [3] B. Li, S.-K. Au, "An expectation-maximization algorithm for Bayesian operational modal
   analysis with multiple (possibly close) modes", MSSP 132 (2019).
.. [4] A. M. Sykulski et al., "The debiased Whittle likelihood", Biometrika 106 (2019).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification import checks
from slowtime.identification.estimates import Measured
from slowtime.identification.harmonics.tones import remove_lines
from slowtime.identification.mode_shapes.criteria import normalised
from slowtime.identification.modes import Mode
from slowtime.signals.spectra import detrended, transform

from .band_iteration import fit_record
from .fit import BandPosterior
from .initial_estimates import RecordSpectrum

FAINTEST_SNR = 4.0
"""Ratio of peak density to noise, channels together, below which a mode is flagged [1]."""


def bayesian_modes(
    samples: Float[np.ndarray, "time channel"] | Float[np.ndarray, " time"],
    rate_hz: float,
    frequency_hz: Float[np.ndarray, " mode"],
    *,
    derivatives: int | Sequence[int] = 2,
    lines: tuple[Measured, ...] = (),
) -> tuple[Mode, ...]:
    r"""Most probable modes near candidate frequencies, with posterior standard deviations.

    Parameters
    ----------
    samples, rate_hz
        Record in any unit, channels in columns.
    frequency_hz
        Where modes are, to about a half-bandwidth: peaks, or what another method found [Hz].
        Modes that are near to each other are fitted together.
    derivatives
        What the samples are: 2 for accelerations, 1 velocities, 0 displacements; one number or
        one a channel. Of mixed channels the modes must know, for shapes are taken for real.
    lines
        Lines of machines, which are taken out of the record and left out of the bands; see
        `find_harmonics`.

    Returns
    -------
    One mode a candidate, ascending in frequency. Flags: `not_converged`, `faint` (hardly above
    the noise), `at_band_edge` (there may be no mode here at all), `common_forces` (the forces
    of the modes have something in common, as those of a single shaker; errors, which then hang
    on the exact interference of many tails, are told too small by up to a half).

    Raises
    ------
    ValueError
        If a channel is a copy of others, or a candidate is outside the measured range.

    Examples
    --------
    >>> from slowtime.dynamics.sdof.oscillator import Oscillator
    >>> from slowtime.dynamics.sdof.simulation import ambient_acceleration
    >>> rng = np.random.default_rng(2)
    >>> ringing = ambient_acceleration(Oscillator.from_modal(5.0, 0.01), 20_000, 50.0, rng)
    >>> both = ringing[:, None] * [1.0, -0.5] + 0.1 * rng.standard_normal((20_000, 2))
    >>> mode, = bayesian_modes(both, 50.0, np.array([5.1]))
    >>> low, high = mode.frequency_hz.interval()
    >>> low < 5.0 < high, mode.shape.real.round(2)
    (True, array([ 0.89, -0.45]))
    """
    columns = detrended(checks.series(samples, rate_hz))
    moving = checks.moving(samples[:, None] if samples.ndim == 1 else samples)
    orders = _orders(derivatives, moving)
    candidates = _candidates(frequency_hz, rate_hz, len(columns))
    if lines:
        columns = remove_lines(columns, rate_hz, lines)
    record, scale = _record(columns, rate_hz, orders)
    try:
        with np.errstate(divide="ignore", invalid="ignore"):
            fits = fit_record(record, candidates, lines)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "The likelihood of the modes has no maximum: a channel is a copy or a sum of "
            "others, so that no noise tells them apart. Leave out such channels, or identify "
            "by another method."
        ) from error
    modes = [
        _mode(fit, i, record, scale, moving, orders)
        for fit in fits
        for i in range(fit.modes.number)
    ]
    return tuple(sorted(modes, key=lambda mode: mode.frequency_hz.value))


def _orders(derivatives: int | Sequence[int], moving: np.ndarray) -> np.ndarray:
    given = np.atleast_1d(np.asarray(derivatives))
    if len(given) not in (1, len(moving)) or not np.isin(given, (0, 1, 2)).all():
        raise ValueError(
            f"{derivatives=} was given for {len(moving)} channels. Give 2 (acceleration), "
            "1 (velocity) or 0 (displacement), for all or one a channel."
        )
    return np.asarray(np.broadcast_to(given, len(moving))[moving])


def _candidates(frequency_hz: np.ndarray, rate_hz: float, count: int) -> np.ndarray:
    candidates = np.sort(np.asarray(frequency_hz, dtype=float))
    low, high = 4.0 * rate_hz / count, 0.49 * rate_hz
    if not ((candidates > low) & (candidates < high)).all():
        raise ValueError(
            f"Candidates of {candidates} Hz were given. Allowed are {low:g} to {high:g} Hz for "
            f"{count} samples at {rate_hz:g} Hz; leave out the others."
        )
    return candidates


def _record(
    columns: np.ndarray, rate_hz: float, orders: np.ndarray
) -> tuple[RecordSpectrum, np.ndarray]:
    """Coefficients of one and the same derivative, channels scaled to the same level."""
    frequency, coefficients = transform(columns, rate_hz)
    common = int(orders.max())
    omega = 2j * np.pi * np.maximum(frequency, frequency[1])
    coefficients = coefficients * omega[:, None] ** (common - orders)
    # The level of a channel between its peaks: a scale that many modes do not move.
    scale = np.median(np.abs(coefficients), axis=0) + 1e-9 * np.abs(coefficients).max(axis=0)
    return RecordSpectrum(frequency, coefficients / scale, rate_hz, len(columns), common), scale


def _mode(
    fit: BandPosterior,
    i: int,
    record: RecordSpectrum,
    scale: np.ndarray,
    moving: np.ndarray,
    orders: np.ndarray,
) -> Mode:
    modes, covariance = fit.modes, fit.covariance
    number, channels, own = modes.number, len(scale), modes.guests + i
    f, z = float(np.exp(modes.log_frequency[own])), float(np.exp(modes.log_damping[own]))
    sd_f, sd_z = np.sqrt(covariance[i, i]), np.sqrt(covariance[number + i, number + i])
    at = 2 * number + len(modes.free_mixing) + i * channels
    # What a channel shows is its own derivative of the motion, in its own unit.
    turn = scale * (2j * np.pi * f) ** (orders - record.derivatives)
    block = slice(at, at + channels)
    seen, error = _unit(modes.shapes[:, own], turn, covariance[block, block])
    shape, shape_sd = np.zeros(len(moving), dtype=complex), np.zeros(len(moving))
    shape[moving], shape_sd[moving] = seen, error
    return Mode(
        frequency_hz=Measured(f, f * float(sd_f)),
        damping_ratio=Measured(z, z * float(sd_z)),
        correlation=float(covariance[i, number + i] / (sd_f * sd_z)),
        shape=shape,
        shape_sd=shape_sd,
        flags=_flags(fit, own, f, record.duration_s),
    )


def _unit(
    strength: Float[np.ndarray, " channel"],
    turn: Complex[np.ndarray, " channel"],
    covariance: Float[np.ndarray, "channel channel"],
) -> tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]]:
    """Shape of unit norm in the units of the channels, and its standard deviations."""
    raw = turn * strength
    norm = np.linalg.norm(raw)
    direction = raw / norm
    slope = np.diag(turn) - np.outer(direction, (direction.conj() * turn).real)
    spread = slope @ covariance @ slope.conj().T / norm**2
    return normalised(raw), np.sqrt(np.maximum(np.diag(spread).real, 0.0))


def _flags(
    fit: BandPosterior, i: int, frequency_hz: float, duration_s: float
) -> tuple[str, ...]:
    modes = fit.modes
    flags = [] if fit.converged else ["not_converged"]
    if modes.coherent and len(modes.log_frequency) > 1:
        flags.append("common_forces")
    power = modes.shapes[:, i] ** 2 * modes.coherence[i, i].real
    if np.sum(power / np.exp(modes.log_noise)) < FAINTEST_SNR:
        flags.append("faint")
    edges = fit.band_hz
    if min(frequency_hz - edges[0], edges[1] - frequency_hz) < 2.0 / duration_s:
        flags.append("at_band_edge")
    return tuple(flags)
