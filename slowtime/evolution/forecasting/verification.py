r"""Verification of past forecasts: reliability, coverage, and the spread that they need.

A statement made at :math:`a` about the time until :math:`b` is decided once :math:`b` has
passed. Windows of statements overlap, so that one surprise falls into many of them. The errors
of two statements are taken to be correlated as increments of a Wiener process over the windows,

.. math:: \rho_{ij} = \frac{|[a_i, b_i] \cap [a_j, b_j]|}{\sqrt{(b_i - a_i)(b_j - a_j)}},
   \qquad n_\text{eff} = \frac{n^2}{\sum_{ij} \rho_{ij}},

which is the number of independent statements whose mean has the variance of the mean of all.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import betaincinv, ndtri

LEVELS = np.array([0.025, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.975])
"""Probabilities whose quantiles a statement keeps [1]: the ends of four central intervals."""

_NORMAL = ndtri(LEVELS)

FARTHEST = 3.0
"""Normal score at which a truth far off its forecast is clipped for the widening [1]. Source:
2,000 futures resolve none beyond 3.3; and of 29 histories of `benchmarks.methods.calibration`,
a limit of 5 widened those with one sudden repair by 2.7, at 0.018 of Brier score."""

_OFF_SCALE = 1e3

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Limits of the classes of stated probabilities [1]. Source: fifths, with the sure ends apart,
since decisions hang on them (Broecker and Smith, 2007, discuss the choice)."""

CALIBRATED = 0.5
"""Prior probability that the spread of forecasts is right as it is [1]: no preference."""

LOG_SD = float(np.log(2.0))
"""Otherwise, standard deviation of the logarithm of the factor that it lacks [1]: a factor of
two either way. Source: among the laws of docs/remaining_life.md, which bands hold by 75 to
100 % where 95 % are stated, that is factors of 0.6 to 1.7."""

_LOG_FACTORS = np.linspace(-3.0 * LOG_SD, 3.0 * LOG_SD, 121)

_RATES = np.logspace(-6.0, 1.0, 15)
"""Variance that a level gains between two readings, over that of a reading [1]."""


@dataclasses.dataclass(frozen=True, slots=True)
class Widening:
    """Factor by which the spread of forecasts has to grow.

    Parameters
    ----------
    factor
        At least 1 [1]; forecasts that have been too wide stay as they are.
    probability
        Posterior probability that the spread is not right as it is [1].
    effective
        Independent statements that it follows from [1].
    """

    factor: float = 1.0
    probability: float = 1.0 - CALIBRATED
    effective: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class StatementClass:
    """Statements whose probabilities lie between two limits.

    Parameters
    ----------
    low, high
        Limits [1].
    stated
        Mean stated probability [1].
    count, came_true
        Decided statements, and those that came true.
    effective
        How many independent statements they are worth [1].
    lo, hi
        95 % interval of the probability with which they come true [1].
    """

    low: float
    high: float
    stated: float
    count: int
    came_true: int
    effective: float
    lo: float
    hi: float


def smoothed_level(
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    r"""Estimate a level that moves, from all readings before and after each.

    The level is a Wiener process, :math:`dx = \sigma \, dW`, read with known errors. Its
    :math:`\sigma` is averaged over a grid, weighed by the likelihood.

    Parameters
    ----------
    time
        Ascending slow times.
    value, sd
        Readings, and their independent standard deviations.

    Returns
    -------
    Mean and standard deviation at each time.

    References
    ----------
    .. [1] H. E. Rauch, F. Tung and C. T. Striebel, "Maximum likelihood estimates of linear
       dynamic systems" (1965).
    """
    n = len(time)
    step = np.diff(time, prepend=time[0])
    pace = float(np.median(step[1:])) if n > 1 else 1.0
    rate = _RATES * float(np.median(sd)) ** 2 / (pace or 1.0)
    mean, variance = np.empty((n, len(rate))), np.empty((n, len(rate)))
    at, spread = np.full(len(rate), value[0]), np.full(len(rate), sd[0] ** 2)
    mean[0], variance[0] = at, spread
    log = np.zeros(len(rate))
    for i in range(1, n):
        before = spread + rate * step[i]
        total = before + sd[i] ** 2
        away = value[i] - at
        log = log - 0.5 * (away**2 / total + np.log(total))
        at, spread = at + before / total * away, before * sd[i] ** 2 / total
        mean[i], variance[i] = at, spread
    for i in range(n - 2, -1, -1):
        ahead = variance[i] + rate * step[i + 1]
        gain = variance[i] / ahead
        mean[i] += gain * (mean[i + 1] - mean[i])
        variance[i] += gain**2 * (variance[i + 1] - ahead)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    level = mean @ weight
    between = ((mean - level[:, None]) ** 2) @ weight
    return level, np.sqrt(variance @ weight + between)


def normal_score(quantiles: Float[np.ndarray, " level"], truth: float) -> float:
    """Place of a truth in the distribution that was stated: that of a standard normal variable.

    Parameters
    ----------
    quantiles
        Of the statement, at `LEVELS`.
    truth
        What came.

    Returns
    -------
    Standard normal quantile of its place; beyond the outermost quantiles as their spread goes
    on.
    """
    quantiles = np.maximum.accumulate(quantiles)
    slope = spread_of(quantiles)
    if slope == 0.0:
        return float(np.sign(truth - quantiles[4]) * _OFF_SCALE)
    if truth < quantiles[0]:
        score = _NORMAL[0] + (truth - quantiles[0]) / slope
    elif truth > quantiles[-1]:
        score = _NORMAL[-1] + (truth - quantiles[-1]) / slope
    else:
        score = float(np.interp(truth, quantiles, _NORMAL))
    return float(np.clip(score, -_OFF_SCALE, _OFF_SCALE))


def spread_of(quantiles: Float[np.ndarray, " level"]) -> float:
    """Return the standard deviation of a normal distribution with the outermost quantiles."""
    return float((quantiles[-1] - quantiles[0]) / (_NORMAL[-1] - _NORMAL[0]))


def effective_number(
    begin: Float[np.ndarray, " statement"], end: Float[np.ndarray, " statement"]
) -> float:
    """Count how many independent statements some that overlap are worth.

    Parameters
    ----------
    begin, end
        Windows of the statements, in slow time.

    Returns
    -------
    From 1 to their number; 0 of none.

    Examples
    --------
    >>> effective_number(np.arange(3.0), np.arange(3.0) + 1.0)
    3.0
    >>> effective_number(np.zeros(2), np.ones(2))
    1.0
    """
    if not len(begin):
        return 0.0
    shared = np.minimum.outer(end, end) - np.maximum.outer(begin, begin)
    length = np.maximum(end - begin, 1e-300)
    alike = np.maximum(shared, 0.0) / np.sqrt(np.outer(length, length))
    return float(len(begin) ** 2 / alike.sum())


def widening_of(
    score: Float[np.ndarray, " statement"],
    error: Float[np.ndarray, " statement"],
    effective: float,
) -> Widening:
    r"""Estimate the factor that the spread of forecasts lacks.

    A forecast whose spread is too small by a factor :math:`f` has scores
    :math:`z \sim N(0, f^2 + r^2)`, where :math:`r` is the error with which the truth is known,
    over the spread. The factor is 1 with probability `CALIBRATED`, and
    :math:`\ln f \sim N(0, \ln^2 2)` otherwise. Statements that overlap count together as
    `effective` ones: their likelihood is raised to the power of that share. The factor that is
    used is :math:`\exp \operatorname{E}[\ln f]`, and not below 1.

    Parameters
    ----------
    score
        Normal scores of what came, under the forecasts without widening.
    error
        Standard deviation of each score, as the truth is only read [1].
    effective
        Independent statements that they are worth.

    Returns
    -------
    The factor, and how probable it is that one is needed.

    References
    ----------
    .. [1] T. J. Mitchell and J. J. Beauchamp, "Bayesian variable selection in linear
       regression" (1988): a prior with a share at one point.
    .. [2] C. C. Holmes and S. G. Walker, "Assigning a value to a power likelihood in a general
       Bayesian model" (2017).
    """
    if not len(score):
        return Widening()
    share = effective / len(score)
    near = np.clip(score, -FARTHEST, FARTHEST)
    variance = np.exp(2.0 * _LOG_FACTORS)[:, None] + error**2
    log = share * np.sum(-0.5 * (np.log(variance) + near**2 / variance), axis=1)
    prior = np.exp(-0.5 * (_LOG_FACTORS / LOG_SD) ** 2)
    prior /= prior.sum()
    calm = log[len(log) // 2]
    slab = prior * np.exp(log - log.max())
    lacking = (1.0 - CALIBRATED) * slab.sum()
    probability = float(lacking / (lacking + CALIBRATED * np.exp(calm - log.max())))
    mean = probability * float(slab @ _LOG_FACTORS / slab.sum())
    return Widening(float(np.exp(max(mean, 0.0))), probability, effective)


def reliability(
    stated: Float[np.ndarray, " statement"],
    came_true: Bool[np.ndarray, " statement"],
    begin: Float[np.ndarray, " statement"],
    end: Float[np.ndarray, " statement"],
) -> list[StatementClass]:
    """Compare stated probabilities with how often such statements came true.

    Parameters
    ----------
    stated
        Probabilities.
    came_true
        What came of each.
    begin, end
        Windows of the statements, in slow time.

    Returns
    -------
    The classes of `EDGES` that have statements.

    References
    ----------
    .. [1] A. H. Murphy and R. L. Winkler, "Reliability of subjective probability forecasts of
       precipitation and temperature" (1977).
    """
    place = np.clip(np.searchsorted(EDGES, stated, side="right") - 1, 0, len(EDGES) - 2)
    found = []
    for k in range(len(EDGES) - 1):
        mine = place == k
        count, hits = int(mine.sum()), int(came_true[mine].sum())
        if not count:
            continue
        effective = effective_number(begin[mine], end[mine])
        lo, hi = binomial_interval(hits / count, effective)
        mean = float(stated[mine].mean())
        found.append(
            StatementClass(EDGES[k], EDGES[k + 1], mean, count, hits, effective, lo, hi)
        )
    return found


def binomial_interval(share: float, number: float, level: float = 0.95) -> tuple[float, float]:
    """Interval of a probability of which a share of some independent trials was seen.

    Parameters
    ----------
    share
        Share that came true.
    number
        Number of independent trials; not necessarily whole.
    level
        Probability that the interval holds.

    Returns
    -------
    Lower and upper limit: equal-tailed, under the prior of Jeffreys.

    References
    ----------
    .. [1] L. D. Brown, T. T. Cai and A. DasGupta, "Interval estimation for a binomial
       proportion" (2001).
    """
    hits, misses = share * number + 0.5, (1.0 - share) * number + 0.5
    tail = 0.5 * (1.0 - level)
    lo = 0.0 if share == 0.0 else float(betaincinv(hits, misses, tail))
    hi = 1.0 if share == 1.0 else float(betaincinv(hits, misses, 1.0 - tail))
    return lo, hi


def half_width(level: float) -> float:
    """Half of a central interval of a standard normal variable that has some probability."""
    return float(ndtri(0.5 * (1.0 + level)))
