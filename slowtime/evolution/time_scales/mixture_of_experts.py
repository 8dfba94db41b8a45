r"""Mixture of Gaussian-process experts over slow time, fitted by EM.

.. math:: p(y | t_s) = \sum_k \pi_k(t_s) \, N(y; m_k(t_s), v_k(t_s) + s^2), \qquad
          \pi_k(t_s) \propto \pi_k N(t_s; c_k, S_k)

after Chakraborty and Adhikari (2021), who give each scale an expert. Here the noise of each
reading is known, several starts are tried, and responsibilities are taken from what an expert
foretells of a reading without it: with free noise and one start the noise of an expert goes to
zero on the readings it has, and the split is wrong.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering
from slowtime.estimation.processes import Constant, Matern, Sum
from slowtime.evolution.change import Series

_LEAST = 1e-4
"""Responsibility below which a reading is left out of an expert."""

_FACTORS = (0.6, 1.0, 1.7)
"""On length and size, tried in each round."""


@dataclasses.dataclass(frozen=True, slots=True)
class Expert:
    """One expert: its process, and where it is responsible.

    Parameters
    ----------
    process
        Of this expert.
    weight, centre, width
        Of its gate: probability, and mean and standard deviation over slow time.
    """

    process: Sum
    weight: float
    centre: float
    width: float


@dataclasses.dataclass(frozen=True, slots=True)
class ExpertMixture:
    """A mixture fitted to a series.

    Parameters
    ----------
    experts
        Those of the best start.
    slow_time, mean, sd
        Of the mixture where it was read, without the noise of readings.
    responsibility
        Of each expert for each reading [1].
    log_predictive
        Sum over the readings of the logarithm of the density at which the others foretell
        each [1].
    rounds
        Of expectation and maximisation, of the best start.
    """

    experts: tuple[Expert, ...]
    slow_time: Series
    mean: Series
    sd: Series
    responsibility: Float[np.ndarray, "expert time"]
    log_predictive: float
    rounds: int


def fit(
    slow_time: Series,
    value: Series,
    sd: Series,
    *,
    starts: int = 6,
    rounds: int = 12,
    seed: int = 0,
) -> ExpertMixture:
    """Fit a mixture of two experts from several starts, and keep the best.

    Parameters
    ----------
    slow_time, value, sd
        Slow times, ascending, values, and their known standard deviations.
    starts, rounds
        How many, at most.
    seed
        Of the starts.

    Returns
    -------
    The mixture.
    """
    rng = np.random.default_rng(seed)
    found = [
        _climb(slow_time, value, sd, _begin(slow_time, value, rng), rounds)
        for _ in range(starts)
    ]
    return max(found, key=lambda one: one.log_predictive)


def log_density(value: Series, mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Log-density of a Gaussian.

    Parameters
    ----------
    value
        Values.
    mean
        Means.
    sd
        Standard deviations.

    Returns
    -------
    Log-density of each.
    """
    return np.asarray(-0.5 * ((value - mean) / sd) ** 2 - np.log(sd * np.sqrt(2.0 * np.pi)))


def _begin(slow_time: Series, value: Series, rng: np.random.Generator) -> tuple[Expert, ...]:
    span, middle = np.ptp(slow_time), float(slow_time.mean())
    scatter, level = max(float(np.std(value)), 1e-300), float(np.abs(value).max())
    gap = float(np.median(np.diff(slow_time)))
    lengths = (0.4 * span, max(2.0 * gap, 0.02 * span))
    begun = []
    for length in lengths:
        factor = np.exp(0.5 * rng.standard_normal(2))
        level_process = Constant(sd=level + scatter, fixed=("sd",))
        own = Matern(length=float(length * factor[0]), sd=float(scatter * factor[1]))
        centre = middle + 0.3 * span * rng.standard_normal()
        width = span * float(rng.uniform(0.2, 1.0))
        begun.append(Expert(level_process + own, 0.5, float(centre), width))
    return tuple(begun)


def _climb(
    slow_time: Series,
    value: Series,
    sd: Series,
    experts: tuple[Expert, ...],
    rounds: int,
) -> ExpertMixture:
    responsibility = _gates(experts, slow_time)
    best: ExpertMixture | None = None
    for done in range(1, rounds + 1):
        noises = [sd / np.sqrt(np.maximum(own, _LEAST)) for own in responsibility]
        experts = tuple(
            _improved(one, own, slow_time, value, noise)
            for one, own, noise in zip(experts, responsibility, noises, strict=True)
        )
        foretold = [
            filtering.leave_one_out(one.process, slow_time, value, noise)
            for one, noise in zip(experts, noises, strict=True)
        ]
        densities = np.array(
            [log_density(value, mean, np.hypot(spread, sd)) for mean, spread in foretold]
        )
        joint = np.log(np.maximum(_gates(experts, slow_time), 1e-300)) + densities
        each = np.logaddexp.reduce(joint, axis=0)
        now = _mixed(experts, slow_time, value, noises, joint - each, float(each.sum()), done)
        if best is not None and now.log_predictive < best.log_predictive + 1e-3:
            return max(best, now, key=lambda one: one.log_predictive)
        best, responsibility = now, np.exp(joint - each)
    assert best is not None
    return best


def _improved(
    expert: Expert,
    responsibility: np.ndarray,
    slow_time: Series,
    value: Series,
    noise: Series,
) -> Expert:
    """Move gate and process of one expert to what it is responsible for."""
    total = max(float(responsibility.sum()), 1e-12)
    centre = float(responsibility @ slow_time / total)
    spread = float(np.sqrt(responsibility @ (slow_time - centre) ** 2 / total))
    logs = expert.process.logs
    steps = np.log(_FACTORS)
    tried = logs + np.array([(a, b) for a in steps for b in steps])
    likelihood = filtering.log_likelihood(expert.process.at(tried), slow_time, value, noise)
    process = expert.process.at(tried[int(np.argmax(likelihood))])
    assert isinstance(process, Sum)
    gap = float(np.median(np.diff(slow_time)))
    return Expert(process, total / len(slow_time), centre, max(spread, gap))


def _gates(experts: tuple[Expert, ...], slow_time: Series) -> np.ndarray:
    """Probability of each expert at each slow time."""
    logs = np.array(
        [
            np.log(max(one.weight, 1e-12))
            + log_density(slow_time, np.array(one.centre), np.array(one.width))
            for one in experts
        ]
    )
    return np.asarray(np.exp(logs - np.logaddexp.reduce(logs, axis=0)))


def _mixed(
    experts: tuple[Expert, ...],
    slow_time: Series,
    value: Series,
    noises: list[Series],
    log_responsibility: np.ndarray,
    log_predictive: float,
    rounds: int,
) -> ExpertMixture:
    told = [
        filtering.smooth(one.process, slow_time, value, noise)
        for one, noise in zip(experts, noises, strict=True)
    ]
    share = np.exp(log_responsibility)
    means, sds = np.array([one.mean for one in told]), np.array([one.sd for one in told])
    mean = np.sum(share * means, axis=0)
    sd = np.sqrt(np.sum(share * (sds**2 + (means - mean) ** 2), axis=0))
    return ExpertMixture(experts, slow_time, mean, sd, share, log_predictive, rounds)
