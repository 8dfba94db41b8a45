r"""Maximum a posteriori parameters of a structure from measured modes.

With parameters whitened by their prior, :math:`\theta = \sigma \circ \varphi`, residual
r and slope J in standard deviations, a step of Gauss and Newton solves

.. math:: (I + \tilde J^T \tilde J) \, \delta = \tilde J^T r - \varphi,
          \qquad \tilde J = J \, \mathrm{diag}(\sigma)

and the posterior covariance is :math:`\sigma (I + \tilde J^T \tilde J)^{-1} \sigma`. A
parameter with :math:`\sigma = 0` stays nominal.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from slowtime.estimation import hyperparameters
from slowtime.evolution.change import check_level

from .measured_modes import MeasuredModes, ModeMisfit, mode_misfit
from .updatable_models import UpdatableModel

_ITERATIONS = 40
_CLOSE = 1e-6  # step in prior standard deviations at which the search has arrived
_SAME = 0.5  # posterior standard deviations between two ends of searches that are one optimum
_NEGLIGIBLE = 1e-3
_LONGEST = 1.0  # prior standard deviations that one step may go


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """One place where the posterior is greatest around.

    Parameters
    ----------
    theta, covariance
        Logarithms of the factors on the parts, and their joint covariance.
    log_evidence
        Of the data with the prior, by Laplace's method about this optimum.
    misfit
        Sum of squared residuals in standard deviations.
    rows
        How many numbers were compared.
    whitened
        Slope of the data in standard deviations by parameters in prior standard deviations.
    """

    theta: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    log_evidence: float
    misfit: float
    rows: int
    whitened: Float[np.ndarray, "row parameter"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StructurePosterior:
    """What is known of the parameters, most probable optimum first.

    Parameters
    ----------
    names
        Of the parameters.
    optima, weights
        Places where the posterior is greatest around, and their probabilities.
    prior_sd
        Of each parameter.
    """

    names: tuple[str, ...]
    optima: tuple[Optimum, ...]
    weights: Float[np.ndarray, " optimum"]
    prior_sd: Float[np.ndarray, " parameter"]

    @property
    def theta(self) -> Float[np.ndarray, " parameter"]:
        """Most probable parameters."""
        return self.optima[0].theta

    @property
    def covariance(self) -> Float[np.ndarray, "parameter parameter"]:
        """Joint covariance about the most probable parameters."""
        return self.optima[0].covariance

    @property
    def sd(self) -> Float[np.ndarray, " parameter"]:
        """Standard deviations of the parameters over all optima together."""
        thetas = np.array([o.theta for o in self.optima])
        mean = self.weights @ thetas
        own = np.array([np.diag(o.covariance) for o in self.optima])
        return np.asarray(np.sqrt(self.weights @ (own + (thetas - mean) ** 2)))

    @property
    def ratio(self) -> Float[np.ndarray, " parameter"]:
        """Posterior over prior standard deviation: 1 where nothing was learnt, 0 if certain."""
        free = self.prior_sd > 0.0
        return np.where(free, self.sd / np.where(free, self.prior_sd, 1.0), 0.0)

    @property
    def change(self) -> Float[np.ndarray, " parameter"]:
        """Relative changes at the most probable parameters [1]."""
        return np.asarray(np.expm1(self.theta))

    def interval(
        self, level: float = 0.95
    ) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
        """Compute the ends of intervals of the changes about the most probable ones.

        Parameters
        ----------
        level
            Probability of each interval [1].

        Returns
        -------
        Lower and upper ends, as relative changes [1].
        """
        half = check_level(level) * np.sqrt(np.diag(self.covariance))
        return np.expm1(self.theta - half), np.expm1(self.theta + half)

    @property
    def p_value(self) -> float:
        """Probability of data as far from the best model, were it right; low: it is wrong."""
        best = self.optima[0]
        learnt = np.trace(np.eye(len(best.theta)) - _inverse(best.whitened))
        return float(chdtrc(max(best.rows - float(learnt), 1.0), best.misfit))


def estimate(
    structure: UpdatableModel,
    measured: MeasuredModes | Sequence[MeasuredModes],
    prior_sd: Float[np.ndarray, " parameter"] | float = 0.3,
    *,
    starts: int = 8,
) -> StructurePosterior:
    """Find the changes of the parameters that explain measured modes.

    Parameters
    ----------
    structure
        With the nominal state as its matrices.
    measured
        Modes of the state to be explained; several sets when it was also measured with known
        masses on it, or by other sensors.
    prior_sd
        Standard deviations of the logarithms of the factors, about 0; 0 for a parameter that
        cannot have changed.
    starts
        Points spread over the prior from which the search begins besides the nominal one. A
        posterior with several peaks shows itself by searches that end apart.

    Returns
    -------
    Posterior of the parameters.

    Examples
    --------
    >>> from slowtime.evolution.structures import ParametricStructure
    >>> k = np.array([[[2.0, 0], [0, 0]], [[2.0, -2.0], [-2.0, 2.0]]])
    >>> two = ParametricStructure(mass=np.eye(2), stiffness=k.sum(axis=0), stiffness_parts=k)
    >>> weak = two.modes(np.log([0.9, 1.0])).frequency_hz
    >>> found = estimate(two, MeasuredModes(frequency_hz=weak, frequency_sd_hz=1e-5 * weak))
    >>> found.change.round(3) + 0
    array([-0.1,  0. ])
    """
    sets = (measured,) if isinstance(measured, MeasuredModes) else tuple(measured)
    sd = check_prior(structure, prior_sd)
    ends: list[Optimum] = []
    for start in [
        np.zeros(len(sd)),
        *(sd * hyperparameters.quasi_random_points(starts, len(sd))),
    ]:
        end = optimise_from(structure, sets, sd, start)
        if not any(_one_place(end, other) for other in ends):
            ends.append(end)
    ends.sort(key=lambda end: -end.log_evidence)
    weights = np.exp([end.log_evidence - ends[0].log_evidence for end in ends])
    kept = weights > _NEGLIGIBLE
    return StructurePosterior(
        structure.names,
        tuple(end for end, keep in zip(ends, kept, strict=True) if keep),
        weights[kept] / weights[kept].sum(),
        sd,
    )


def optimise_from(
    structure: UpdatableModel,
    sets: Sequence[MeasuredModes],
    prior_sd: Float[np.ndarray, " parameter"],
    start: Float[np.ndarray, " parameter"],
) -> Optimum:
    """Search from one start to the optimum that it leads to; modes are paired at each step.

    Parameters
    ----------
    structure
        Nominal structure and its variable parts.
    sets
        Measured modes, one set for each state of the structure.
    prior_sd
        Prior standard deviation of each parameter [1]; 0 for one that stays nominal.
    start
        Parameters to start from, as logarithms of factors [1].
    """
    whitening = np.where(prior_sd > 0.0, prior_sd, 1.0)
    point = np.where(prior_sd > 0.0, start / whitening, 0.0)
    here = total_misfit(structure, sets, prior_sd * point, prior_sd)
    damping = 1e-6
    for _ in range(_ITERATIONS):
        slope = here.slope * prior_sd
        pull = slope.T @ here.residual - point
        step = _damped_step(slope, pull, damping)
        step *= min(1.0, _LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        there = total_misfit(structure, sets, prior_sd * (point + step), prior_sd)
        if _height(there, point + step) <= _height(here, point):
            point, here = point + step, there
            damping *= 0.1
            if np.abs(step).max(initial=0.0) < _CLOSE:
                break
        elif np.abs(step).max(initial=0.0) < _CLOSE:
            break
        else:
            damping = max(10.0 * damping, 1e-3)
    return _optimum(here, point, prior_sd)


def total_misfit(
    structure: UpdatableModel,
    sets: Sequence[MeasuredModes],
    theta: Float[np.ndarray, " parameter"],
    spread: Float[np.ndarray, " parameter"],
) -> ModeMisfit:
    """Misfit of all sets of measured modes together.

    Parameters
    ----------
    structure
        Nominal structure and its variable parts.
    sets
        Measured modes, one set for each state of the structure.
    theta
        Parameters, as logarithms of factors [1].
    spread
        Standard deviation of each parameter [1].

    Returns
    -------
    Residuals in standard deviations, their slopes, and the pairs of modes.
    """
    gaps = [mode_misfit(structure, measured, theta, spread) for measured in sets]
    return ModeMisfit(
        np.concatenate([one.residual for one in gaps]),
        np.concatenate([one.slope for one in gaps]),
        np.concatenate([one.pairs for one in gaps]),
    )


def check_prior(
    structure: UpdatableModel, prior_sd: Float[np.ndarray, " parameter"] | float
) -> Float[np.ndarray, " parameter"]:
    """Check the prior standard deviations, and make one for each parameter [1].

    Parameters
    ----------
    structure
        Nominal structure and its variable parts.
    prior_sd
        Standard deviation of the logarithm of a factor [1], one for all or one each.

    Raises
    ------
    ValueError
        Where their number is wrong, or one is negative or not finite.
    """
    sd = np.asarray(prior_sd, dtype=np.float64)
    count = len(structure.names)
    if sd.shape not in ((), (count,)) or not ((sd >= 0.0) & np.isfinite(sd)).all():
        raise ValueError(
            f"prior_sd={prior_sd} for {count} parameters. Give one standard deviation of a "
            "logarithm for all, such as 0.3, or one each; 0 for what cannot have changed."
        )
    return np.broadcast_to(sd, (count,)).copy()


def _optimum(
    here: ModeMisfit,
    point: Float[np.ndarray, " parameter"],
    prior_sd: Float[np.ndarray, " parameter"],
) -> Optimum:
    slope = here.slope * prior_sd
    small = slope @ slope.T if len(slope) < len(point) else slope.T @ slope
    return Optimum(
        prior_sd * point,
        prior_sd[:, None] * _inverse(slope) * prior_sd,
        -_height(here, point) - 0.5 * float(np.linalg.slogdet(np.eye(len(small)) + small)[1]),
        float(here.residual @ here.residual),
        len(here.residual),
        slope,
    )


def _height(here: ModeMisfit, point: Float[np.ndarray, " parameter"]) -> float:
    """Minus the logarithm of the posterior, up to a constant."""
    return 0.5 * float(here.residual @ here.residual + point @ point)


def _damped_step(slope: np.ndarray, pull: np.ndarray, damping: float) -> np.ndarray:
    """Solve (N + damping diag N) step = pull for N = I + J^T J, over the smaller side of J."""
    rows, count = slope.shape
    scale = 1.0 + damping * (1.0 + np.sum(slope**2, axis=0))
    if rows >= count:
        return np.asarray(np.linalg.solve(np.diag(scale) + slope.T @ slope, pull))
    light = slope / scale
    inner = np.eye(rows) + light @ slope.T
    return np.asarray(pull / scale - light.T @ np.linalg.solve(inner, light @ pull))


def _inverse(slope: Float[np.ndarray, "row parameter"]) -> np.ndarray:
    """Posterior covariance in prior standard deviations."""
    rows, count = slope.shape
    if rows < count:
        inner = np.linalg.solve(np.eye(rows) + slope @ slope.T, slope)
        return np.asarray(np.eye(count) - slope.T @ inner)
    inverse = np.linalg.inv(np.eye(slope.shape[1]) + slope.T @ slope)
    return np.asarray(0.5 * (inverse + inverse.T))


def _one_place(one: Optimum, other: Optimum) -> bool:
    apart = one.theta - other.theta
    sd = np.sqrt(np.diag(one.covariance))
    return bool(np.all(np.abs(apart) <= _SAME * sd + 1e-12))
