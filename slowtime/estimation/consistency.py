r"""Does a filter know how wrong it is? Its surprises and its errors against what it claims.

If model and noises are right, squared residuals in units of their covariance (NIS) and squared
errors in units of theirs (NEES) are :math:`\chi^2` with as many degrees of freedom as there are
readings and states (Bar-Shalom, Li and Kirubarajan, 2001, sec. 5.4).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import chdtr, chdtrc, chdtri

from .gaussian import FilterStep, Gaussian
from .hyperparameters import HyperparameterPrior, Objective, climb
from .particle import Particles, ParticleStep


@dataclasses.dataclass(frozen=True, slots=True)
class Consistency:
    """Verdict on a filter, one entry per twin.

    Parameters
    ----------
    ratio
        Mean of the squares over what it should be [1]: above 1 the filter is too sure of
        itself, below 1 too unsure.
    lo, hi
        Between which the ratio of a right model would lie, at the level asked for.
    p_value
        How often a right model would be as far off, on either side.
    consistent
        Whether the ratio lies between.
    """

    ratio: Float[np.ndarray, "*twins"]
    lo: Float[np.ndarray, "*twins"]
    hi: Float[np.ndarray, "*twins"]
    p_value: Float[np.ndarray, "*twins"]
    consistent: np.ndarray


def nis(steps: Sequence[FilterStep | ParticleStep], *, level: float = 0.95) -> Consistency:
    """Test the normalised squared innovations (NIS) of a filter, without rejected readings.

    Parameters
    ----------
    steps
        Of one filter, in any order.
    level
        Probability that a right model passes [1].

    Returns
    -------
    Verdict, one entry per twin.
    """
    used = np.array([step.used for step in steps])
    surprise = np.where(used > 0, np.array([step.surprise for step in steps]), 0.0)
    return _judge(np.asarray(surprise.sum(axis=0)), np.asarray(used.sum(axis=0)), level)


def nees(
    truth: Float[np.ndarray, "run *twins state"],
    beliefs: Sequence[Gaussian | Particles],
    *,
    level: float = 0.95,
) -> Consistency:
    """Test the normalised squared errors (NEES) of beliefs, one from each independent run.

    Errors at successive times of one run are correlated; the interval does not hold for them.

    Parameters
    ----------
    truth
        True state of each run.
    beliefs
        Belief of each run.
    level
        Probability of the interval of a consistent filter [1].

    Returns
    -------
    Verdict, one entry per twin.
    """
    total, count = np.zeros(truth.shape[1:-1]), 0
    for true, belief in zip(truth, beliefs, strict=True):
        error = true - belief.mean
        inverse = np.linalg.pinv(belief.covariance, hermitian=True)
        total = total + np.einsum("...i,...ij,...j->...", error, inverse, error)
        count += truth.shape[-1]
    return _judge(np.asarray(total), np.full(total.shape, count), level)


@dataclasses.dataclass(frozen=True, slots=True)
class NoiseFactors:
    """Factors by which two noises should be multiplied, and how well each is known.

    Parameters
    ----------
    process, reading
        On the covariances [1].
    log_sd
        Standard deviations of their logarithms; near 2 where the readings say nothing.
    """

    process: float
    reading: float
    log_sd: Float[np.ndarray, "2"]


def noise_factors(log_likelihood: Objective) -> NoiseFactors:
    """Learn the size of process and reading noise from the innovations of a filter.

    Parameters
    ----------
    log_likelihood
        From pairs of factors on the covariances of process and reading noise, one pair a row,
        to the sum of `Step.log_likelihood` over a series filtered with them. Filters take
        such a family at once, as twins of different noise.

    Returns
    -------
    Factors on both noises, with their uncertainty.

    Notes
    -----
    Largest likelihood of the innovations, with a weak prior of a factor of about 50 either way.
    """
    prior = HyperparameterPrior(np.zeros(2), np.full(2, 2.0))

    def objective(points: np.ndarray) -> np.ndarray:
        total: np.ndarray = log_likelihood(np.exp(points)) + prior.log_density(points)
        return total

    net = prior.net(32)
    best = climb(objective, net[objective(net).argmax()], prior, iterations=12)
    factors = np.exp(best.point)
    sd = np.sqrt(np.diag(np.linalg.inv(best.curvature)))
    return NoiseFactors(float(factors[0]), float(factors[1]), sd)


def _judge(total: np.ndarray, freedom: np.ndarray, level: float) -> Consistency:
    if not 0.0 < level < 1.0:
        raise ValueError(
            f"{level=} is not a valid probability. Give one between 0 and 1, such as 0.95."
        )
    if not np.all(freedom > 0):
        raise ValueError(
            "Nothing was read, so there is nothing to judge. Give steps with readings."
        )
    tail = 0.5 * (1.0 - level)
    lo, hi = chdtri(freedom, 1.0 - tail) / freedom, chdtri(freedom, tail) / freedom
    ratio = np.asarray(total / freedom)
    p_value = 2.0 * np.minimum(chdtr(freedom, total), chdtrc(freedom, total))
    consistent = np.asarray((lo <= ratio) & (ratio <= hi))
    return Consistency(
        ratio, np.asarray(lo), np.asarray(hi), np.asarray(np.minimum(p_value, 1.0)), consistent
    )
