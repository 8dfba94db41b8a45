r"""Length scales and spreads from the readings themselves, by maximum likelihood.

The likelihood of a whole family of processes costs little more than that of one, so the search
asks in families: first a net over what the priors allow, then Newton's method whose
derivatives are differences within one family.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from . import filtering
from .matern import SlowProcess

Objective = Callable[[np.ndarray], np.ndarray]

_DIFFERENCE = 0.04  # of a prior's width: steps over rounding, narrow for a Gaussian
_LONGEST = 1.4
_STEPS = np.array([1.0, 0.5, 0.25, 0.1, 0.02, 2.0])


@dataclasses.dataclass(frozen=True, slots=True)
class HyperparameterPrior:
    """Weak belief about logarithms of parameters: independent Gaussians."""

    centre: Float[np.ndarray, " parameter"]
    sd: Float[np.ndarray, " parameter"]

    def log_density(
        self, points: Float[np.ndarray, "family parameter"]
    ) -> Float[np.ndarray, " family"]:
        """Logarithm of the prior density, up to a constant.

        Parameters
        ----------
        points
            Logarithms of parameters.

        Returns
        -------
        Logarithm of the density of each point.
        """
        density: Float[np.ndarray, " family"] = -0.5 * np.sum(
            ((points - self.centre) / self.sd) ** 2, axis=1
        )
        return density

    def net(self, count: int) -> Float[np.ndarray, "family parameter"]:
        """Points spread evenly over the prior, the same at every call."""
        normal = quasi_random_points(count, len(self.centre))
        return np.asarray(self.centre + self.sd * normal)


@dataclasses.dataclass(frozen=True, slots=True)
class ObjectiveOptimum:
    """Where the objective is greatest, how great, and minus its second derivatives there."""

    point: Float[np.ndarray, " parameter"]
    value: float
    curvature: Float[np.ndarray, "parameter parameter"]


@dataclasses.dataclass(frozen=True, slots=True)
class Fitted:
    """A process fitted to readings, and the logarithm of their likelihood under it."""

    process: SlowProcess
    log_likelihood: float


def quasi_random_points(count: int, dimensions: int) -> Float[np.ndarray, "family parameter"]:
    """Quasi-random standard normal points, by the generalised golden ratio."""
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (dimensions + 1))
    multiples = np.outer(np.arange(count), golden ** -np.arange(1.0, dimensions + 1))
    points: Float[np.ndarray, "family parameter"] = ndtri((0.5 + multiples) % 1.0)
    return points


def climb(
    objective: Objective,
    start: Float[np.ndarray, " parameter"],
    prior: HyperparameterPrior,
    *,
    iterations: int = 8,
    difference: float = _DIFFERENCE,
) -> ObjectiveOptimum:
    """Maximise `objective` by Newton's method.

    All is measured in widths of the prior, which may be narrow for some parameters and wide for
    others. Directions in which the objective does not curve down are given the curvature of the
    prior; of several step lengths the best is taken, and none if none is better.

    Parameters
    ----------
    objective
        Function from points, one per row, to values.
    start
        Point to start from, as logarithms of parameters.
    prior
        Prior, whose widths scale the steps.
    iterations
        Largest number of steps.
    difference
        Step of the differences from which derivatives follow, in widths of the prior [1].

    Returns
    -------
    The maximum found, and minus the second derivatives there.
    """

    def scaled(points: np.ndarray) -> np.ndarray:
        return objective(prior.centre + prior.sd * points)

    point, value = (start - prior.centre) / prior.sd, -np.inf
    for _ in range(iterations):
        value, slope, curvature = _derivatives(scaled, point, difference)
        curvature = _at_least(curvature, 0.25)
        step = np.linalg.solve(curvature, slope)
        # Shortened as a whole: length and spread lie on a ridge, and off it all is worse.
        step *= min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
        tried = point + _STEPS[:, None] * step
        values = scaled(tried)
        best = int(values.argmax())
        if not values[best] > value + 1e-6:
            break
        point, value = tried[best], float(values[best])
    widths = np.outer(prior.sd, prior.sd)
    return ObjectiveOptimum(prior.centre + prior.sd * point, value, curvature / widths)


def fit(
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
    *,
    smoothness: float = 1.5,
    straight: bool = False,
) -> Fitted:
    """Length scale and spread of a Matérn process about a constant or a straight mean.

    Parameters
    ----------
    time, value, sd
        Ascending times, readings, and their known standard deviations; NaN values missing.
    smoothness
        Of the process.
    straight
        Whether the mean may slope.

    Returns
    -------
    The process, and its log-likelihood.

    Notes
    -----
    Maximum of the likelihood with a weak prior (a factor of about four either way) on the
    length scale about a tenth of the span, never much below the typical gap between readings,
    and on the spread about the scatter of the readings: enough to keep both finite where the
    readings say nothing.
    """
    prior, base = weak_prior(time, value, straight=straight)
    sd = np.maximum(sd, 1e-6 * base.sd)

    def objective(points: np.ndarray) -> np.ndarray:
        family = dataclasses.replace(
            base, smoothness=smoothness, length=np.exp(points[:, 0]), sd=np.exp(points[:, 1])
        )
        likelihood = filtering.log_likelihood(family, time, value, sd)
        total: np.ndarray = likelihood + prior.log_density(points)
        return total

    net = prior.net(32)
    best = climb(objective, net[objective(net).argmax()], prior)
    process = dataclasses.replace(
        base,
        smoothness=smoothness,
        length=float(np.exp(best.point[0])),
        sd=float(np.exp(best.point[1])),
    )
    return Fitted(process, float(filtering.log_likelihood(process, time, value, sd)))


def weak_prior(
    time: Float[np.ndarray, " time"], value: Float[np.ndarray, " time"], *, straight: bool
) -> tuple[HyperparameterPrior, SlowProcess]:
    """Make a prior on the logarithms of length and spread, and a process with a vague mean.

    Parameters
    ----------
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    straight
        Whether the mean may have a slope.

    Raises
    ------
    ValueError
        With fewer than three readings, or all at one time.
    """
    known = np.isfinite(value)
    if known.sum() < 3 or not time[known][-1] > time[known][0]:
        raise ValueError(
            f"{int(known.sum())} readings, or all at one time, are too few to learn a process "
            "from. Give at least 3 readings at different times."
        )
    span = time[known][-1] - time[known][0]
    scatter = max(float(np.std(value[known])), 1e-12 * (1e-300 + np.abs(value[known]).max()))
    gap = float(np.median(np.diff(time[known])))
    length = max(0.1 * span, 2.0 * gap)
    base = SlowProcess(
        length=length,
        sd=scatter,
        centre=float(np.mean(value[known])),
        level_sd=10.0 * scatter,
        slope_sd=10.0 * scatter / span if straight else 0.0,
    )
    return HyperparameterPrior(np.log([length, 0.7 * scatter]), np.array([1.4, 1.4])), base


def _derivatives(
    objective: Objective, point: Float[np.ndarray, " parameter"], difference: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Value, slope, and minus the second derivatives, by differences within one family."""
    count = len(point)
    steps = difference * np.eye(count)
    pairs = [(i, j) for i in range(count) for j in range(i)]
    mixed = [steps[i] + sign * steps[j] for i, j in pairs for sign in (1.0, -1.0)]
    moves = np.array([np.zeros(count), *steps, *(-steps), *mixed, *(-m for m in mixed)])
    values = objective(point + moves)
    centre, up, down = values[0], values[1 : count + 1], values[count + 1 : 2 * count + 1]
    slope = (up - down) / (2.0 * difference)
    curvature = np.diag((2.0 * centre - up - down) / difference**2)
    rest = values[2 * count + 1 :].reshape(2, len(pairs), 2).sum(axis=0)
    for (i, j), (same, opposite) in zip(pairs, rest, strict=True):
        curvature[i, j] = curvature[j, i] = -(same - opposite) / (4.0 * difference**2)
    return float(centre), slope, curvature


def _at_least(curvature: np.ndarray, least: float) -> np.ndarray:
    values, vectors = np.linalg.eigh(curvature)
    raised: np.ndarray = (vectors * np.maximum(values, least)) @ vectors.T
    return raised
