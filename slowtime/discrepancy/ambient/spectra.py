r"""Fit of a model to the spectra of ambient records, under white forces.

The force is not measured; it is taken to be white and independent on every mass, so that only
its densities are unknown. The spectral matrix of the sensors is then

.. math:: \Sigma(\omega) = \sum_j S_j \, g_j(\omega) g_j(\omega)^H + \mathrm{diag}(N) ,

and the lines of the records are complex normal with it. Constants, densities of forces and
noise are found by Fisher scoring; where the covariance of the lines differs, the model lacks
something in that band. Such records do not determine what and where.

References
----------
.. [1] P. Whittle, "Gaussian estimation in stationary time series", Bull. Int. Stat. Inst. 39
   (1962).
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.special
import scipy.stats
from jaxtyping import Complex, Float

from slowtime.discrepancy.calibration import Prior, prior_of
from slowtime.discrepancy.calibration.model_values import with_values
from slowtime.discrepancy.localization import LinearModel
from slowtime.discrepancy.noise import response_limit_hz
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.plant import Name, Plant
from slowtime.signals.spectra import detrended, transform

MAX_STEPS = 30
"""[steps] Of Fisher scoring at most. Source: judgement; no study is recorded."""
MIN_GAIN = 0.05
"""[nats] Gain of log likelihood below which a step is not worth taking. Source: a tenth of
what one standard deviation is worth (1/2)."""

MAX_STEP = 0.5
"""[1] Largest relative change of a constant, or change of a log density, in one step.
Source: judgement; no study is recorded."""

BAND_MARGIN = 1.5
"""[1] Times the frequency above which the structure is silent up to which lines are used.
Source: judgement; no study is recorded."""

DIFFERENCE_STEP = 1e-4
"""[1] Relative step of central differences. Source: near the cube root of double precision,
with margin."""

Lines = Complex[np.ndarray, "frequency sensor"]
Matrices = Complex[np.ndarray, "frequency sensor sensor"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SpectralBand:
    """A band [Hz], and the p-value of its covariance test."""

    low_hz: float
    high_hz: float
    p_value: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AmbientFit:
    """Result of a fit to the spectra of ambient records.

    Parameters
    ----------
    values, covariance
        Of the constants that were free, in the order of `prior`.
    force_density
        Of the force on each free translation, one-sided [N²/Hz].
    noise_density
        Of each sensor [unit²/Hz].
    bands
        Over which the covariance of the lines was tested.
    p_value
        Probability of a worse fit over all bands if nothing is missing.
    """

    prior: Prior
    values: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]
    force_density: Float[np.ndarray, " dof"]
    noise_density: Float[np.ndarray, " sensor"]
    bands: tuple[SpectralBand, ...]
    p_value: float

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviations of the constants."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def pulls(self) -> dict[Name, float]:
        """Deviation of each constant from its prior mean, in prior standard deviations."""
        moved = (self.values - self.prior.mean) / self.prior.sd
        return dict(zip(self.prior.names, moved.tolist(), strict=True))

    def failed_bands(self, chance: float = 1e-3) -> tuple[tuple[float, float], ...]:
        """Bands [Hz] in which the test fails, at a level with Bonferroni's correction.

        Neighbours that fail are one band.
        """
        level = chance / len(self.bands)
        runs = itertools.groupby(self.bands, lambda one: one.p_value < level)
        failed = [list(run) for fails, run in runs if fails]
        return tuple((run[0].low_hz, run[-1].high_hz) for run in failed)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _SpectralProblem:
    plant: Plant
    prior: Prior
    frequency_hz: Float[np.ndarray, " frequency"]
    lines: Lines

    @property
    def forces(self) -> list[int]:
        """Coordinates on which forces act: translations."""
        influence = LinearModel.of(self.plant.description).structure.influence
        return (
            list(range(self.lines.shape[1]))
            if influence is None
            else np.flatnonzero(influence).tolist()
        )


def fit_ambient_spectra(plant: Plant, trials: Sequence[Trial]) -> AmbientFit:
    """Fit constants, densities of forces and noise to the spectra of ambient records.

    Parameters
    ----------
    plant
        Without inputs and effects; its tolerances are the prior.
    trials
        Records; gaps are taken for zeros, so cut them at long ones.

    Examples
    --------
    See `tests/slowtime/discrepancy/ambient/test_spectra.py`.
    """
    problem = _spectral_problem(plant, tuple(trials))
    at = _initial_unknowns(problem)
    cost, score, sharp = _score_and_information(problem, at)
    damping = 1e-3
    for _ in range(MAX_STEPS):
        step = scipy.linalg.solve(
            sharp + damping * np.diag(np.diag(sharp)), score, assume_a="pos"
        )
        tried = at + np.clip(step, -MAX_STEP, MAX_STEP)
        lower = _negative_log_posterior(problem, tried)
        if not lower < cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain, at, damping = cost - lower, tried, damping / 10
        cost, score, sharp = _score_and_information(problem, at)
        if gain < MIN_GAIN:
            break
    return _make_ambient_fit(problem, at, scipy.linalg.inv(sharp))


def _spectral_problem(plant: Plant, trials: tuple[Trial, ...]) -> _SpectralProblem:
    description = plant.description
    if description.inputs or plant.effects:
        raise ValueError(
            "This model has inputs or effects, which spectra alone cannot be compared with. "
            "Use refit and locate where the input was measured."
        )
    top = BAND_MARGIN * response_limit_hz(description, trials)
    frequencies, lines = [], []
    for trial in trials:
        # Every second line: neighbouring lines of a tapered record are correlated.
        frequency, spectrum = transform(detrended(trial.measured), trial.rate_hz, taper="hann")
        kept = slice(2, int(np.searchsorted(frequency[:-1], top, side="right")), 2)
        frequencies.append(frequency[kept])
        lines.append(spectrum[kept])
    order = np.argsort(np.concatenate(frequencies), kind="stable")
    return _SpectralProblem(
        plant,
        prior_of(plant),
        np.concatenate(frequencies)[order],
        np.concatenate(lines)[order],
    )


def _initial_unknowns(problem: _SpectralProblem) -> Float[np.ndarray, " unknown"]:
    """Start with nominal constants, forces of the measured power, and noise well below."""
    free, forces = len(problem.prior.names), len(problem.forces)
    power = np.abs(problem.lines) ** 2
    at = np.zeros(free + forces + problem.lines.shape[1])
    unit = np.einsum("fss->fs", _spectral_matrices(problem, at)).real - 1.0
    at[free : free + forces] = np.log(np.median(power.mean(axis=0) / unit.mean(axis=0)))
    at[free + forces :] = np.log(np.percentile(power, 20, axis=0) / 2)
    return at


def _spectral_matrices(
    problem: _SpectralProblem, at: Float[np.ndarray, " unknown"]
) -> Matrices:
    """Spectral matrices, given relative changes of constants and logarithms of densities."""
    free, forces = len(problem.prior.names), problem.forces
    values = problem.prior.mean * (1 + at[:free])
    changed = with_values(
        problem.plant.description, dict(zip(problem.prior.names, values.tolist(), strict=True))
    )
    linear = LinearModel.of(changed)
    compliance = linear.compliance(problem.frequency_hz)
    seen = linear.sensor_response(problem.frequency_hz, compliance)[:, :, forces]
    scaled = seen * np.exp(at[free : free + len(forces)] / 2)
    sensors = problem.lines.shape[1]
    noise = np.exp(at[free + len(forces) :]) * np.eye(sensors)
    return np.asarray(scaled @ scaled.conj().swapaxes(1, 2) + noise)


def _negative_log_posterior(
    problem: _SpectralProblem, at: Float[np.ndarray, " unknown"]
) -> float:
    """Minus the log likelihood, plus half the squared deviations of the constants."""
    sigma = _spectral_matrices(problem, at)
    factor = np.linalg.cholesky(sigma)
    white = np.linalg.solve(factor, problem.lines[:, :, None])[:, :, 0]
    logdet = 2 * np.sum(np.log(np.einsum("fss->fs", factor).real))
    cost = float(logdet + np.sum(np.abs(white) ** 2))
    return cost + float(np.sum(_prior_deviations(problem, at) ** 2)) / 2


def _prior_deviations(
    problem: _SpectralProblem, at: Float[np.ndarray, " unknown"]
) -> Float[np.ndarray, " free"]:
    free = len(problem.prior.names)
    return np.asarray(at[:free] * problem.prior.mean / problem.prior.sd)


def _score_and_information(
    problem: _SpectralProblem, at: Float[np.ndarray, " unknown"]
) -> tuple[float, Float[np.ndarray, " unknown"], Float[np.ndarray, "unknown unknown"]]:
    """Cost, score and Fisher information."""
    inverse = np.linalg.inv(_spectral_matrices(problem, at))
    weighted = inverse @ problem.lines[:, :, None]
    turned, score = [], np.zeros(len(at))
    for i in range(len(at)):
        step = DIFFERENCE_STEP * np.eye(len(at))[i]
        slope = (
            _spectral_matrices(problem, at + step) - _spectral_matrices(problem, at - step)
        ) / (2 * DIFFERENCE_STEP)
        turned.append(inverse @ slope)
        fit = (weighted.conj().swapaxes(1, 2) @ slope @ weighted)[:, 0, 0].real
        score[i] = float(fit.sum() - np.einsum("fss->", turned[-1]).real)
    flat = np.array([t.ravel() for t in turned])
    back = np.array([t.swapaxes(1, 2).ravel() for t in turned])
    sharp = (flat @ back.T).real
    free = len(problem.prior.names)
    known = np.arange(free)
    relative = problem.prior.mean / problem.prior.sd
    sharp[known, known] += relative**2
    score[:free] -= _prior_deviations(problem, at) * relative
    return _negative_log_posterior(problem, at), score, np.asarray(sharp)


def _make_ambient_fit(
    problem: _SpectralProblem,
    at: Float[np.ndarray, " unknown"],
    covariance: Float[np.ndarray, "unknown unknown"],
) -> AmbientFit:
    free, forces = len(problem.prior.names), len(problem.forces)
    mean = problem.prior.mean
    bands, deviance, degrees = _covariance_tests(problem, at)
    density = np.zeros(len(LinearModel.of(problem.plant.description).structure.names))
    density[problem.forces] = np.exp(at[free : free + forces])
    return AmbientFit(
        prior=problem.prior,
        values=mean * (1 + at[:free]),
        covariance=covariance[:free, :free] * np.outer(mean, mean),
        force_density=density,
        noise_density=np.exp(at[free + forces :]),
        bands=bands,
        p_value=float(scipy.stats.chi2.sf(deviance, degrees)),
    )


def _covariance_tests(
    problem: _SpectralProblem, at: Float[np.ndarray, " unknown"]
) -> tuple[tuple[SpectralBand, ...], float, int]:
    r"""Test in bands whether the covariance of the whitened lines is the unit matrix.

    For the mean :math:`A` of :math:`n` products :math:`z z^H` of :math:`s` components,
    :math:`2 n (\mathrm{tr} A - \log \det A - s)` is close to chi squared with :math:`s^2`
    degrees; the factor that makes its mean right is known in closed form.
    """
    factor = np.linalg.cholesky(_spectral_matrices(problem, at))
    white = np.linalg.solve(factor, problem.lines[:, :, None])[:, :, 0]
    sensors = white.shape[1]
    count = max(len(white) // max(6 * sensors, 24), 1)
    bands, total = [], 0.0
    for part in np.array_split(np.arange(len(white)), count):
        own = white[part]
        mean = own.T @ own.conj() / len(own)
        trace = float(np.trace(mean).real)
        lines = len(own) * np.ones(sensors) - np.arange(sensors)
        expected = -float(np.sum(scipy.special.digamma(lines) - np.log(len(own))))
        distance = trace - float(np.linalg.slogdet(mean)[1]) - sensors
        deviance = distance * sensors**2 / expected
        total += deviance
        bands.append(
            SpectralBand(
                low_hz=float(problem.frequency_hz[part[0]]),
                high_hz=float(problem.frequency_hz[part[-1]]),
                p_value=float(scipy.stats.chi2.sf(deviance, sensors**2)),
            )
        )
    return tuple(bands), total, count * sensors**2
