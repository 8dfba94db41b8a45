"""Where a change is heading: a drifting trend plus a Matérn process, continued with its doubt.

What is learnt is a handful of processes with weights, spread over what the history allows, not
the single likeliest one: a band that takes its own length scale for certain is too narrow.
"""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.estimation import hyperparameters, kernels, matern
from slowtime.estimation.hyperparameters import Optimum, Prior
from slowtime.estimation.matern import SlowProcess

from .change import Series, check_level

Usable: TypeAlias = Float[np.ndarray, " usable"]

_NET = 32  # processes tried per smoothness, and again about the optimum
_WIDER = 1.3  # proposal over Laplace width, so that weights stay bounded
_NEGLIGIBLE = 1e-3


@dataclasses.dataclass(frozen=True, slots=True)
class Outlook:
    """Processes that the history allows, and the weight of each.

    Parameters
    ----------
    family
        A `SlowProcess` whose parameters are arrays, one entry per member.
    weights
        Posterior probability of each member; they sum to one.
    """

    family: SlowProcess
    weights: Float[np.ndarray, " family"]


@dataclasses.dataclass(frozen=True, slots=True)
class Forecast:
    """What is expected at future slow times, without the noise of readings.

    Parameters
    ----------
    mean, sd, lo, hi
        Of the quantity itself, at each time asked for.
    horizon
        Slow time beyond which the forecast only repeats its trend: one length scale of the
        Matérn process after the last reading, less where the readings say little of that
        process. The bands hold beyond it too, as long as the trend goes on as it has.
    """

    mean: Float[np.ndarray, " later"]
    sd: Float[np.ndarray, " later"]
    lo: Float[np.ndarray, " later"]
    hi: Float[np.ndarray, " later"]
    horizon: float


def forecast(
    slow_time: Series,
    value: Series,
    sd: Series,
    horizon_times: Float[np.ndarray, " later"],
    *,
    level: float = 0.95,
) -> Forecast:
    """`fit`, then `predict`. Keep what `fit` gives if you ask again soon: it costs the most.

    Examples
    --------
    >>> t = np.arange(40.0)
    >>> ahead = forecast(t, -0.002 * t, np.full(40, 0.001), np.array([45.0]))
    >>> bool(ahead.lo[0] < -0.09 < ahead.hi[0])
    True
    """
    outlook = fit(slow_time, value, sd)
    return predict(outlook, slow_time, value, sd, horizon_times, level=level)


def fit(slow_time: Series, value: Series, sd: Series) -> Outlook:
    """Learn from a history which processes could have made it.

    Parameters
    ----------
    slow_time, value, sd
        The history in any order: slow times, values, and their known standard deviations;
        entries that are not finite are passed over.

    Notes
    -----
    The smoothness is the one whose best member of a net over the prior is likeliest. Length
    scale, spread, and drift of the trend then follow by Newton's method, and their posterior
    by importance sampling from fixed points about the optimum and of the net together: the
    same history gives the same outlook, to the last bit.
    """
    time, values, sds = _history(slow_time, value, sd)
    prior, base = _prior(time, values)
    sds = np.maximum(sds, 1e-6 * base.sd)

    def objective(points: np.ndarray, smoothness: float) -> np.ndarray:
        family = _members(base, smoothness, points)
        likelihood = matern.log_likelihood(family, time, values, sds)
        total: np.ndarray = likelihood + prior.log_density(points)
        return total

    net = prior.net(_NET)
    scores = {s: objective(net, s) for s in kernels.SMOOTHNESSES}
    smoothness = max(scores, key=lambda s: float(scores[s].max()))
    start = net[scores[smoothness].argmax()]
    best = hyperparameters.climb(lambda points: objective(points, smoothness), start, prior)
    near = _about(best)
    points = np.concatenate([near, net])
    values = np.concatenate([objective(near, smoothness), scores[smoothness]])
    log_weights = values - _log_proposal(points, best, prior)
    weights = np.exp(log_weights - log_weights.max())
    kept = weights > _NEGLIGIBLE * weights.sum()
    weights = weights[kept] / weights[kept].sum()
    return Outlook(_members(base, smoothness, points[kept]), weights)


def predict(
    outlook: Outlook,
    slow_time: Series,
    value: Series,
    sd: Series,
    horizon_times: Float[np.ndarray, " later"],
    *,
    level: float = 0.95,
) -> Forecast:
    """Continue a history; `outlook` may come from an earlier part of it.

    Parameters
    ----------
    outlook
        What `fit` has learnt.
    slow_time, value, sd
        The history, as for `fit`.
    horizon_times
        Future slow times, ascending or not, none before the last reading.
    level
        Probability of the bands [1].
    """
    quantile = check_level(level)
    time, values, sds = _history(slow_time, value, sd)
    if horizon_times.size and not horizon_times.min() >= time[-1]:
        raise ValueError(
            f"A forecast was asked for slow time {horizon_times.min():g}, before the last "
            f"reading at {time[-1]:g}. Ask for later times; for the past there is "
            "slowtime.estimation.matern.smooth."
        )
    sds = np.maximum(sds, 1e-6 * np.min(outlook.family.sd))
    belief, _ = matern.run(outlook.family, time, values, sds)
    means, spreads = matern.predict(outlook.family, belief, horizon_times)
    mean = outlook.weights @ means
    spread = np.sqrt(outlook.weights @ (spreads**2 + (means - mean) ** 2))
    return Forecast(
        mean,
        spread,
        mean - quantile * spread,
        mean + quantile * spread,
        float(time[-1] + _memory(outlook, belief)),
    )


def _memory(outlook: Outlook, belief: matern.Belief) -> float:
    """Length scale, times the share of the Matérn process that the readings determine."""
    family = outlook.family
    share = 1.0 - belief.covariance[..., 2, 2] / np.square(family.sd)
    return float(outlook.weights @ (np.clip(share, 0.0, 1.0) * family.length))


def _history(slow_time: Series, value: Series, sd: Series) -> tuple[Usable, Usable, Usable]:
    usable = np.isfinite(slow_time) & np.isfinite(value) & np.isfinite(sd) & (sd >= 0.0)
    order = np.argsort(slow_time[usable], kind="stable")
    return slow_time[usable][order], value[usable][order], sd[usable][order]


def _prior(time: Series, values: Series) -> tuple[Prior, SlowProcess]:
    """Prior on the logarithms of length, spread and drift; a process with a vague trend."""
    prior, base = hyperparameters.weak_prior(time, values, straight=True)
    span = time[-1] - time[0]
    # The drift that would move the level by a third of the scatter over the whole history.
    drift = np.log(0.3 * np.sqrt(3.0) * base.sd / span**1.5)
    return Prior(np.append(prior.centre, drift), np.append(prior.sd, 1.5)), base


def _members(
    base: SlowProcess, smoothness: float, points: Float[np.ndarray, "family parameter"]
) -> SlowProcess:
    length, spread, drift = np.exp(points.T)
    return dataclasses.replace(
        base, smoothness=smoothness, length=length, sd=spread, slope_drift=drift
    )


def _about(best: Optimum) -> Float[np.ndarray, "family parameter"]:
    """Spread points about the optimum, somewhat wider than its curvature asks for."""
    factor = np.linalg.cholesky(np.linalg.inv(best.curvature))
    normal = hyperparameters.spread(_NET, len(best.point))
    points: Float[np.ndarray, "family parameter"] = best.point + _WIDER * normal @ factor.T
    return points


def _log_proposal(
    points: Float[np.ndarray, "family parameter"], best: Optimum, prior: Prior
) -> Float[np.ndarray, " family"]:
    """Logarithm of the density that points about the optimum and of the net have together.

    The net reaches where the posterior has a tail that the optimum does not see, as when the
    readings allow that there is no Matérn process at all.
    """
    precision = best.curvature / _WIDER**2
    away = points - best.point
    near = 0.5 * np.linalg.slogdet(precision)[1] - 0.5 * np.einsum(
        "fi,ij,fj->f", away, precision, away
    )
    wide = prior.log_density(points) - np.log(prior.sd).sum()
    together: Float[np.ndarray, " family"] = np.logaddexp(near, wide)
    return together
