r"""Maximum-likelihood state-space model of the spectral matrices of a band.

Within a band a structure under random force, or under forces that come all from one place,
with modes beyond the band and noise besides, has the density

.. math:: S(\omega) = \sum_j \left( \frac{\phi_j g_j^H}{i \omega - s_j} +
          \frac{g_j \phi_j^H}{-i \omega - \bar s_j} \right) + R_0 + R_1 \omega ,

that of a state-space model with a background which may slope. Periodograms scatter about it
like :math:`\chi^2` (Whittle), so that the likeliest parameters, found by Fisher scoring, are as
good as any, and the inverse of the information is their covariance.

References
----------
.. [1] P. Whittle, "Estimation and information in stationary time series", Arkiv för Matematik
   2 (1953).
.. [2] T. McKelvey, H. Akçay, L. Ljung, "Subspace-based multivariable system identification from
   frequency response data", IEEE Trans. Automatic Control 41 (1996) for the class of models.
"""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from .evaluation import LikelihoodEvaluation, evaluate, inverse_density
from .evaluation import band_log_likelihood as band_log_likelihood
from .fisher_information import information_and_score, restricted_inverse, surprise_of
from .model import BandData, BandModel, density_of, step_parameters

MOST_STEPS = 25
"""Scoring steps of a full fit, at most."""

SOME_STEPS = 12
"""Scoring steps of a rough fit, at most."""

FEW_STEPS = 8
"""Scoring steps at fixed poles, at most."""

CONVERGED = 0.03
"""Expected gain of log-likelihood at which a full fit stops."""

ROUGHLY = 1.0
"""Expected gain of log-likelihood at which a rough fit stops."""

FREELY = 0.05
"""Damping of a step, relative to the information, below which the step counts as undamped
[1]."""

WARM_UP = 8
"""Rounds of expectation-maximisation before scoring."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class BandFit:
    """Likeliest model, and covariance of (log decay, frequency) of the poles and shapes.

    `covariance` is that of the real parameters: for each mode the logarithm of the decay rate
    and the angular frequency, then real and imaginary parts of the shape components.
    """

    model: BandModel
    log_likelihood: float
    covariance: Float[np.ndarray, "parameter parameter"]
    converged: bool

    def pole_covariance(self, mode: int) -> Float[np.ndarray, "2 2"]:
        """Covariance of log decay rate and angular frequency of a mode."""
        at = slice(2 * mode, 2 * mode + 2)
        return self.covariance[at, at]

    def shape_covariance(self, mode: int) -> Complex[np.ndarray, "direction direction"]:
        """Covariance of the complex shape at fixed length and phase."""
        directions, modes = self.model.shape.shape
        first = 2 * modes + 2 * directions * mode
        block = self.covariance[first : first + 2 * directions, first : first + 2 * directions]
        whole = np.concatenate([np.eye(directions), 1j * np.eye(directions)], axis=1)
        order = np.concatenate(
            [np.arange(0, 2 * directions, 2), np.arange(1, 2 * directions, 2)]
        )
        shape = self.model.shape[:, mode]
        across = np.eye(directions) - np.outer(shape, shape.conj()) / np.vdot(shape, shape).real
        moved = across @ whole @ block[np.ix_(order, order)] @ whole.conj().T @ across.conj().T
        return np.asarray(moved)


def initial_model(
    data: BandData,
    pole: Complex[np.ndarray, " mode"],
    shape: Complex[np.ndarray, "direction mode"],
    held: int = 0,
) -> BandModel:
    """Positive definite model with given poles and shapes.

    The last `held` poles stay.
    """
    none = np.zeros((len(shape), len(shape)), dtype=complex)
    model = BandModel(pole, shape, 0 * shape, none, none, pole, held)
    return expectation_maximisation(
        data, dataclasses.replace(model, length=data.length, turn=data.turn)
    )


def expectation_maximisation(data: BandData, model: BandModel) -> BandModel:
    """Fit forces and background at fixed poles and shapes by expectation-maximisation.

    White forces on the modes and white background are drawn jointly with a covariance W; each
    round replaces W by its mean given data and W, and no round lowers the likelihood.
    """
    pole, shape = model.pole, model.shape
    modes, directions = len(pole), len(shape)
    # What is drawn is seen along constant vectors, times a response at each group.
    base = np.concatenate([shape.T, np.eye(directions)])
    response = np.ones((modes + directions, len(data.omega)), dtype=complex)
    response[:modes] = 1.0 / (1j * data.omega - pole[:, None])
    weight = data.number / data.number.sum()
    power = np.real(np.diagonal(data.density, axis1=1, axis2=2))
    drawn = np.zeros((modes + directions, modes + directions), dtype=complex)
    drawn[modes:, modes:] = np.diag(np.quantile(power, 0.2, axis=0) + 1e-6 * power.mean(axis=0))
    inverse = np.linalg.pinv(shape)
    for j in range(modes):
        nearest = np.argsort(np.abs(data.omega - pole[j].imag))[:3]
        own = inverse[j] @ data.density[nearest].mean(axis=0) @ inverse[j].conj()
        drawn[j, j] = 0.5 * max(own.real, 1e-9) * pole[j].real ** 2
    weighted = dataclasses.replace(data, number=weight)
    for _ in range(WARM_UP):
        density = density_of(shape, *_force_and_level(pole, shape, drawn), response[:modes])
        precision, _ = inverse_density(density)
        if precision is None:
            precision = np.linalg.inv(density)
        surprise = surprise_of(weighted, density, precision)
        drawn = drawn + drawn @ _pull(base, response, surprise) @ drawn
        drawn = (drawn + drawn.conj().T) / 2
    force, level = _force_and_level(pole, shape, drawn)
    return dataclasses.replace(model, force=force, level=level, slope=0 * level)


def _force_and_level(
    pole: np.ndarray, shape: np.ndarray, drawn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of a covariance of white forces on the modes and white noise."""
    modes = len(pole)
    share = -drawn[:modes, :modes] / (pole[:, None] + pole.conj())
    force = (share @ shape.conj().T + drawn[:modes, modes:]).conj().T
    return force, drawn[modes:, modes:]


def _pull(base: np.ndarray, response: np.ndarray, surprise: np.ndarray) -> np.ndarray:
    """Sum over the groups of what the data ask of the covariance of all that is drawn."""
    # `base` is the vector along which each is seen, `response` its response at each group;
    # `surprise` the gap of data and density between inverse densities.
    size, directions = base.shape
    pulled = (base.conj() @ surprise.reshape(directions, -1)).reshape(size, directions, -1)
    pulled = base @ pulled
    pulled *= response
    return np.asarray((pulled @ response.conj()[:, :, None])[:, :, 0])


def fit_band_model(data: BandData, model: BandModel, *, roughly: bool = False) -> BandFit:
    """Maximise the likelihood from a positive definite model by Fisher scoring.

    It stops early with `roughly`, when only dozens of log-likelihood matter.
    """
    enough, most = (ROUGHLY, SOME_STEPS) if roughly else (CONVERGED, MOST_STEPS)
    # Poles stay at first; while forces are far off, they would leave for where one is missing.
    model, here, converged = _climbed(data, fit_forces(data, model), enough, most)
    free = model.free()
    information, _ = _information(data, model, here)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = restricted_inverse(information)
    return BandFit(model, here.log_likelihood, covariance, converged)


def fit_forces(data: BandData, model: BandModel) -> BandModel:
    """Fit forces, shapes and background roughly, at fixed poles."""
    still = dataclasses.replace(model, still=True)
    found, *_ = _climbed(data, still, ROUGHLY, FEW_STEPS)
    return dataclasses.replace(found, still=model.still)


def _climbed(
    data: BandData, model: BandModel, enough: float, most: int
) -> tuple[BandModel, LikelihoodEvaluation, bool]:
    """Fisher scoring, damped where a step would not climb; model, evaluation, whether done."""
    here = evaluate(data, model)
    best = _posterior(model, here)
    damping, converged = 1e-3, False
    free = model.free()
    whole = np.zeros(len(free))
    for _ in range(most):
        information, score = _information(data, model, here)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        scaled, slope = information / scale[:, None] / scale, score / scale
        accepted = False
        for _ in range(12):
            step = np.linalg.solve(scaled + damping * np.eye(len(scaled)), slope)
            promised = float(slope @ step)
            whole[free] = step / scale
            trial = step_parameters(model, whole)
            there = evaluate(data, trial, here if model.still else None)
            likelihood = _posterior(trial, there)
            if likelihood >= best - 1e-10 * abs(best):
                accepted = True
                break
            damping = max(damping, 1e-4) * 6.0
        if not accepted:
            converged = promised < 1.0
            break
        model, here, best = trial, there, likelihood
        # A step kept short by a wall, where no density is left, promises little by itself.
        if promised < enough and damping < FREELY:
            converged = True
            break
        damping /= 8.0
    return model, here, converged


def _information(
    data: BandData, model: BandModel, here: LikelihoodEvaluation
) -> tuple[np.ndarray, np.ndarray]:
    if here.precision is None:
        raise ValueError("A density is not positive definite. Start from `initial_model`.")
    predicted = (here.gain, here.bent, here.density, here.precision)
    return information_and_score(data, model, predicted)


def _posterior(model: BandModel, here: LikelihoodEvaluation) -> float:
    away, wide = model.ties()
    return here.log_likelihood - 0.5 * float(np.sum((away / wide) ** 2))
