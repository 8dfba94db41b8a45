r"""Cross-entropy method: adaptive importance sampling, level by level.

Each level takes the tenth of the points that do worst and fits the mixture of `polar` to them,
weighted back to the standard normal distribution. The last density, beside a share of the
standard normal one widened to the failures' radius, draws the points that are counted.
"""

import numpy as np
from scipy.special import logsumexp

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, sampled

from .polar_mixture import PolarMixture, fit

SHARE = 0.1
LEVELS = 30
DEFENSIVE = 0.2
"""Share of points from a widened normal density, which bounds the weights."""

CAUTION = 1.3
"""Factor on the size planned: a spread is more often under- than overestimated."""

HEAVY = 0.05
LEAST_FAILED = 200


def cross_entropy(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    samples: int = 1000,
    components: int = 4,
) -> Result:
    """Cross-entropy method with von Mises–Fisher–Nakagami mixtures.

    Parameters
    ----------
    problem
        Inputs and limit state.
    rng
        Generator of the samples.
    stopping
        Targets of the sampling.
    samples
        Of each level.
    components
        Of the mixture; those without failures vanish.

    Returns
    -------
    Probability of failure, with its interval.

    References
    ----------
    .. [1] I. Papaioannou, S. Geyer and D. Straub, "Improved cross entropy-based importance
       sampling with a flexible mixture model", Reliab. Eng. Syst. Saf. 191 (2019) 106564.
    """
    g = Evaluator(problem)
    density, reached = _levels(g, rng, samples, components, stopping)
    scale = float(np.sqrt(density.share @ density.spread / problem.size))
    wide = max(scale, 1.1)
    u = np.empty((0, problem.size))
    failed = np.empty(0, dtype=bool)
    weight = np.empty(0)
    count = _planned(g, density, wide, samples, stopping, rng)
    while True:
        new = _draw(density, wide, count, rng)
        hit = g(new) <= 0.0
        ratio = np.zeros(len(new))
        ratio[hit] = np.exp(_log_ratio(density, wide, new[hit]))
        u, failed = np.concatenate([u, new]), np.concatenate([failed, hit])
        weight = np.concatenate([weight, ratio])
        value = float(weight.mean())
        variation = (
            float(weight.std(ddof=1) / np.sqrt(len(weight)) / value) if value > 0.0 else np.inf
        )
        enough = variation <= stopping.variation and failed.sum() >= LEAST_FAILED
        if enough or g.calls >= stopping.calls or (value == 0.0 and len(weight) > 20 * samples):
            break
        left = max(stopping.calls - g.calls, 1)
        count = min(_more(variation, len(weight), stopping), left)
    return sampled(
        "cross-entropy",
        value,
        variation,
        g.calls,
        stopping,
        warnings=_doubts(weight, reached, problem.size),
    )


def _planned(
    g: Evaluator,
    density: PolarMixture,
    wide: float,
    samples: int,
    stopping: Stopping,
    rng: np.random.Generator,
) -> int:
    """Size of the sample, from points that are not counted."""
    # Sampling that ends as soon as it has met few heavy points underestimates.
    u = _draw(density, wide, max(min(samples, stopping.calls - g.calls), 1), rng)
    hit = g(u) <= 0.0
    weight = np.zeros(len(u))
    weight[hit] = np.exp(_log_ratio(density, wide, u[hit]))
    if not hit.any():
        return samples
    spread = float(weight.var() / weight.mean() ** 2)
    planned = CAUTION * spread / stopping.variation**2
    return int(min(max(planned, samples), max(stopping.calls - g.calls, 1)))


def _levels(
    g: Evaluator,
    rng: np.random.Generator,
    samples: int,
    components: int,
    stopping: Stopping,
) -> tuple[PolarMixture, bool]:
    u = rng.standard_normal((samples, g.problem.size))
    log_weight = np.zeros(samples)
    values = g(u)
    for _ in range(LEVELS):
        # A value of those that are there: what counts as failed may be minus infinity.
        threshold = max(float(np.quantile(values, SHARE, method="higher")), 0.0)
        chosen = values <= threshold
        log_w = log_weight[chosen]
        density = fit(u[chosen], np.exp(log_w - log_w.max()), components, rng)
        if threshold == 0.0 or g.calls + samples > stopping.calls:
            return density, threshold == 0.0
        u = density.draw(rng, samples)
        log_weight = _log_normal(u) - density.log_density(u)
        values = g(u)
    return density, False


def _draw(
    density: PolarMixture, wide: float, count: int, rng: np.random.Generator
) -> np.ndarray:
    defensive = round(DEFENSIVE * count)
    broad = wide * rng.standard_normal((defensive, density.mean.shape[1]))
    return np.concatenate([density.draw(rng, count - defensive), broad])


def _log_ratio(density: PolarMixture, wide: float, u: np.ndarray) -> np.ndarray:
    broad = _log_normal(u / wide) - u.shape[1] * np.log(wide)
    both = np.stack([np.log1p(-DEFENSIVE) + density.log_density(u), np.log(DEFENSIVE) + broad])
    return np.asarray(_log_normal(u) - logsumexp(both, axis=0))


def _log_normal(u: np.ndarray) -> np.ndarray:
    return np.asarray(-0.5 * np.sum(u**2, axis=1) - 0.5 * u.shape[1] * np.log(2.0 * np.pi))


def _more(variation: float, drawn: int, stopping: Stopping) -> int:
    if not np.isfinite(variation):
        return drawn
    needed = drawn * ((variation / stopping.variation) ** 2 - 1.0)
    return int(np.clip(1.05 * needed, 100, drawn))


def _doubts(weight: np.ndarray, reached: bool, inputs: int) -> tuple[str, ...]:
    warnings = []
    if not reached:
        warnings.append(
            "The levels did not reach failure: the density is not learnt. Give more samples."
        )
    if weight.sum() > 0.0 and weight.max() > HEAVY * weight.sum():
        warnings.append(
            f"One point of {len(weight)} carries {100 * weight.max() / weight.sum():.0f} % of "
            "the probability: a failure mode lies outside the density. Use subset simulation."
        )
    return tuple(warnings)
