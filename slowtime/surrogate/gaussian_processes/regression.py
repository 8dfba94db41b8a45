r"""Gaussian-process regression by maximum likelihood, with a trend.

.. math:: y = F b + Z + \epsilon, \quad Z \sim N(0, K), \quad
          \epsilon_i \sim N(0, v_i + \nu^2)

with known noise :math:`v_i` per point, a nugget :math:`\nu` that may be learnt, and a trend
:math:`b` on which nothing is believed beforehand. The restricted likelihood (Patterson and
Thompson 1971) does not reward a trend for eating degrees of freedom, as the plain one does.
"""

import dataclasses
import re
import warnings

import numpy as np
import scipy.linalg
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.special import ndtri
from scipy.stats import qmc

from slowtime.surrogate.surrogate_warnings import IllConditionedWarning

from .covariances import Covariance

NUGGET = (-14.0, 0.5)
"""Bounds of the logarithm of the learnt nugget's standard deviation, of unit outputs."""

JITTERS = (0.0, *(10.0**power for power in range(-13, -1)))
WORST_JITTER = 1e-7
ITERATIONS = 120
PERIODS = 100
"""Tried before a search, where there is one: the likelihood has a peak for every alias."""

BLUR = 0.3
"""Noise with which they are tried: without, only the very period would stand out."""


@dataclasses.dataclass(frozen=True, slots=True)
class RegressionData:
    """What is regressed on: scaled inputs, trend columns, outputs, their known variances."""

    x: Float[np.ndarray, "sample input"]
    trend: Float[np.ndarray, "sample column"]
    y: Float[np.ndarray, " sample"]
    variance: Float[np.ndarray, " sample"]


@dataclasses.dataclass(frozen=True, slots=True)
class TrainedProcess:
    """A process with its parameters, and all that prediction needs of the design."""

    covariance: Covariance
    theta: Float[np.ndarray, " parameter"]
    nugget: float
    readings: RegressionData
    factor: Float[np.ndarray, "sample sample"]
    """Lower Cholesky factor of the covariance of the readings."""

    weights: Float[np.ndarray, " sample"]
    trend: Float[np.ndarray, " column"]
    trend_factor: Float[np.ndarray, "column column"]
    log_likelihood: float
    projected: Float[np.ndarray, "sample sample"]
    jitter: float

    def predict(
        self, x: Float[np.ndarray, "point input"], trend: Float[np.ndarray, "point column"]
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        r"""Mean and variance of the function at points, without the noise of a reading.

        .. math:: \sigma^2 = k_{**} - k^T K^{-1} k + u^T (F^T K^{-1} F)^{-1} u, \quad
                  u = f - F^T K^{-1} k

        Parameters
        ----------
        x
            Scaled points.
        trend
            Trend columns at the points.

        Returns
        -------
        Mean [unit of the outputs], and variance [its square].
        """
        cross = self.covariance.between(self.theta, self.readings.x, x)
        mean = trend @ self.trend + cross.T @ self.weights
        whitened = scipy.linalg.solve_triangular(self.factor, cross, lower=True)
        variance = self.covariance.variance(self.theta, x) - np.sum(whitened**2, axis=0)
        if trend.shape[1]:
            columns = scipy.linalg.solve_triangular(
                self.factor, self.readings.trend, lower=True
            )
            unexplained = trend.T - columns.T @ whitened
            part = scipy.linalg.solve_triangular(self.trend_factor, unexplained, lower=True)
            variance = variance + np.sum(part**2, axis=0)
        return mean, np.maximum(variance, 0.0)

    def left_out(self) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
        """Error and standard deviation of each reading as the others foretell it."""
        precision = np.maximum(np.diag(self.projected), 1e-300)
        return self.weights / precision, 1.0 / np.sqrt(precision)


def _factor(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    size = float(np.mean(np.diag(matrix)))
    for jitter in JITTERS:
        try:
            shifted = matrix + jitter * size * np.eye(len(matrix))
            return np.asarray(scipy.linalg.cholesky(shifted, lower=True)), jitter
        except scipy.linalg.LinAlgError:
            continue
    raise ValueError(
        "The covariance of the points is not positive, whatever is added to its diagonal. "
        "Remove duplicate points, or give the noise of the outputs."
    )


def condition(
    covariance: Covariance, theta: np.ndarray, nugget: float, readings: RegressionData
) -> TrainedProcess:
    """Solve for the weights and the trend with given parameters.

    Parameters
    ----------
    covariance
        Covariance function.
    theta
        Its parameters, in the order of its `ranges`.
    nugget
        Standard deviation of the noise that is added to the known one [unit of the outputs].
    readings
        Points, trend columns, outputs and their known variances.

    Returns
    -------
    The process, with the logarithm of its restricted likelihood.
    """
    count, columns = readings.trend.shape
    matrix = covariance.between(theta, readings.x, readings.x)
    matrix = matrix + np.diag(readings.variance + nugget**2)
    factor, jitter = _factor(matrix)
    inverse = scipy.linalg.cho_solve((factor, True), np.eye(count))
    log_determinant = 2.0 * np.sum(np.log(np.diag(factor)))
    trend, trend_factor = np.zeros(columns), np.zeros((columns, columns))
    projected = inverse
    if columns:
        carried = inverse @ readings.trend
        whitened = scipy.linalg.solve_triangular(factor, readings.trend, lower=True)
        trend_factor, _ = _factor(whitened.T @ whitened)
        part = scipy.linalg.solve_triangular(trend_factor, carried.T, lower=True)
        projected = inverse - part.T @ part
        trend = scipy.linalg.cho_solve((trend_factor, True), carried.T @ readings.y)
        log_determinant += 2.0 * np.sum(np.log(np.diag(trend_factor)))
    weights = scipy.linalg.cho_solve((factor, True), readings.y - readings.trend @ trend)
    value = -0.5 * (
        readings.y @ weights + log_determinant + (count - columns) * np.log(2.0 * np.pi)
    )
    return TrainedProcess(
        covariance=covariance,
        theta=theta,
        nugget=nugget,
        readings=readings,
        factor=factor,
        weights=weights,
        trend=trend,
        trend_factor=trend_factor,
        log_likelihood=float(value),
        projected=projected,
        jitter=jitter,
    )


def learn(
    covariance: Covariance,
    readings: RegressionData,
    *,
    nugget: float | None = None,
    starts: int = 2,
    like: TrainedProcess | None = None,
) -> TrainedProcess:
    """Fit a process by the parameters of largest posterior density, from several starts.

    Parameters
    ----------
    covariance
        Covariance function, with bounds and priors of its parameters.
    readings
        Points, trend columns, outputs and their known variances.
    nugget
        Standard deviation of the added noise [unit of the outputs]; learnt where None.
    starts
        Number of starts of the search.
    like
        Process at whose parameters the search starts instead.

    Returns
    -------
    The process with the best parameters found.

    Warns
    -----
    IllConditionedWarning
        Where points nearly coincide, so that their covariance is nearly singular.
    """
    ranges = covariance.ranges(readings.x.shape[1])
    lo = np.array([one.lo for one in ranges] + [NUGGET[0]])
    hi = np.array([one.hi for one in ranges] + [NUGGET[1]])
    centre = np.array([one.centre for one in ranges] + [-8.0])
    spread = np.array([one.sd for one in ranges] + [6.0])
    if nugget is not None:
        lo, hi, centre, spread = lo[:-1], hi[:-1], centre[:-1], spread[:-1]

    def split(point: np.ndarray) -> tuple[np.ndarray, float]:
        if nugget is not None:
            return point, nugget
        return point[:-1], float(np.exp(point[-1]))

    def objective(point: np.ndarray) -> tuple[float, np.ndarray]:
        theta, own = split(point)
        state = condition(covariance, theta, own, readings)
        weight = 0.5 * (np.outer(state.weights, state.weights) - state.projected)
        slope = covariance.slopes(theta, readings.x, weight)
        if nugget is None:
            slope = np.append(slope, 2.0 * own**2 * np.trace(weight))
        away = (point - centre) / spread
        return -state.log_likelihood + 0.5 * float(away @ away), away / spread - slope

    names = [one.name for one in ranges] + ["log_nugget"]
    best: tuple[float, np.ndarray] | None = None
    if like is not None:
        begins = [np.append(like.theta, np.log(max(like.nugget, 1e-300)))[: len(lo)]]
    else:
        begins = _begins(names[: len(lo)], centre, spread, starts)
        begins += _with_periods(covariance, readings, centre, names[: len(lo)], starts)
    for begin in begins:
        found = minimize(
            objective,
            np.clip(begin, lo, hi),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(lo, hi, strict=True)),
            options={"maxiter": ITERATIONS},
        )
        if best is None or found.fun < best[0]:
            best = float(found.fun), found.x
    assert best is not None
    state = condition(covariance, *split(best[1]), readings)
    if state.jitter > WORST_JITTER:
        warnings.warn(
            f"The covariance of the points had to be widened by {state.jitter:.0e} of its "
            "diagonal to be solved. Remove points that nearly coincide, or give the noise.",
            IllConditionedWarning,
            stacklevel=4,
        )
    return state


def _begins(
    names: list[str], centre: np.ndarray, spread: np.ndarray, count: int
) -> list[np.ndarray]:
    """Where searches start: spread over the belief, alike in all inputs."""
    kinds = [re.sub(r"_\d+$", "", name) for name in names]
    each = sorted(set(kinds))
    net = qmc.Halton(len(each), scramble=False).random(1 + count)[1:]
    columns = [each.index(kind) for kind in kinds]
    return [centre + ndtri(point[columns]) * np.minimum(spread, 2.0) for point in net]


def _with_periods(
    covariance: Covariance,
    readings: RegressionData,
    centre: np.ndarray,
    names: list[str],
    count: int,
) -> list[np.ndarray]:
    """Start at the likeliest periods, one for all inputs; nowhere if nothing is periodic."""
    periodic = np.array([name.startswith("log_period") for name in names])
    if not periodic.any():
        return []
    ranges = covariance.ranges(readings.x.shape[1])
    one = next(one for one in ranges if one.name.startswith("log_period"))
    tried = [
        np.where(periodic, value, centre) for value in np.linspace(one.lo, one.hi, PERIODS)
    ]
    worth = [
        condition(covariance, start[: len(ranges)], BLUR, readings).log_likelihood
        for start in tried
    ]
    return [tried[k] for k in np.argsort(worth)[::-1][:count]]


def trust(
    learnt: TrainedProcess, *, learn_nugget: bool, folds: int, rng: np.random.Generator
) -> float:
    """Errors over the deviations foretold for them, root mean square, each part left out once.

    Parameters are learnt anew without it: that they fit the readings they were learnt from
    says too little of others, and their own uncertainty counts in no deviation.
    """
    readings = learnt.readings
    order = rng.permutation(len(readings.y))
    ratios = []
    for k in range(folds):
        rest, seen = order[k::folds], np.delete(order, np.s_[k::folds])
        part = learn(
            learnt.covariance,
            RegressionData(
                readings.x[seen],
                readings.trend[seen],
                readings.y[seen],
                readings.variance[seen],
            ),
            nugget=None if learn_nugget else learnt.nugget,
            like=learnt,
        )
        mean, variance = part.predict(readings.x[rest], readings.trend[rest])
        total = variance + readings.variance[rest] + part.nugget**2
        ratios.append((readings.y[rest] - mean) ** 2 / np.maximum(total, 1e-300))
    return float(np.sqrt(np.mean(np.concatenate(ratios))))
