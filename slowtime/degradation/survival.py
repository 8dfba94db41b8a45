r"""A Wiener process that is known to have survived: its state given that no path has crossed.

Readings alone leave paths open that crossed the threshold before now and came back. Paths are
sampled backwards through the filter (Carter and Kohn, 1994), each is weighed by the
probability that its bridges between readings do not touch the threshold, and drawn again.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.evolution.life.threshold_crossing import SampledFutures

from .history import History
from .wiener import WienerLaw, WienerPosterior


def surviving_futures(
    history: History,
    threshold: float,
    horizon: float,
    *,
    toward: Literal["below", "above"] | None = None,
    points: int = 120,
    paths: int = 2000,
    seed: int = 0,
) -> SampledFutures:
    """Draw futures of a Wiener process given its readings and that it has not crossed.

    Parameters
    ----------
    history
        Readings, from the first of which on survival is known; without events.
    threshold
        In the unit of the quantity.
    horizon
        Slow time up to which futures are drawn.
    toward
        The side of failure; None for the one where the first reading is not.
    points, paths, seed
        As for `mixture.Mixture.futures`.

    Returns
    -------
    The futures.

    References
    ----------
    .. [1] C. K. Carter and R. Kohn, "On Gibbs sampling for state space models" (1994).
    """
    if history.events:
        raise ValueError(
            "Survival between readings is only weighed for a history without events. Give the "
            "readings after the last event."
        )
    rng = np.random.default_rng([seed, 79])
    steps = _filtered(history)
    last = steps[-1]
    owners = rng.choice(len(last.sigma), size=4 * paths, p=last.weights)
    factor = np.linalg.cholesky(last.belief.covariance[owners, :2, :2] + 1e-300 * np.eye(2))
    state = last.belief.mean[owners, :2] + np.einsum(
        "pij,pj->pi", factor, rng.standard_normal((len(owners), 2))
    )
    falls = history.value[0] > threshold if toward is None else toward == "below"
    side = 1.0 if falls else -1.0
    drift, variance = state[:, 1], last.sigma[owners] ** 2
    level = state[:, 0]
    log = np.where(side * (level - threshold) > 0.0, 0.0, -np.inf)
    after = level
    for k in range(len(steps) - 2, -1, -1):
        gap = history.time[k + 1] - history.time[k]
        before = _backward(steps[k], owners, drift, after, variance * gap, gap, rng)
        a, b = side * (before - threshold), side * (after - threshold)
        touched = np.exp(
            -2.0 * np.maximum(a, 0.0) * np.maximum(b, 0.0) / (variance * max(gap, 1e-300))
        )
        with np.errstate(divide="ignore"):
            log = log + np.log1p(-np.where((a <= 0.0) | (b <= 0.0), 1.0, touched))
        after = before
    if not np.isfinite(log).any():
        raise ValueError(
            f"No path that the readings allow has stayed on its side of {threshold:g}. Check "
            "whether the threshold has been crossed."
        )
    weight = np.exp(log - log.max())
    kept = rng.choice(len(weight), size=paths, p=weight / weight.sum())
    later = np.linspace(float(history.time[-1]), horizon, points + 1)
    ahead = later - later[0]
    shocks = rng.standard_normal((paths, len(later))) * np.sqrt(np.diff(ahead, prepend=0.0))
    wander = np.sqrt(variance[kept])[:, None] * np.cumsum(shocks, axis=1)
    drawn = level[kept][:, None] + drift[kept][:, None] * ahead + wander
    return SampledFutures(
        later, drawn, np.zeros(paths), variance[kept], rng.random(paths), {"Wiener": 1.0}
    )


def _filtered(history: History) -> list[WienerPosterior]:
    """Give the filter after each reading."""
    found: list[WienerPosterior] = []
    posterior = WienerLaw().begin(history)
    for i in range(len(history.time)):
        one = slice(i, i + 1)
        posterior = posterior.follow(history.time[one], history.value[one], history.sd[one])
        found.append(posterior)
    return found


def _backward(
    step: WienerPosterior,
    owners: np.ndarray,
    drift: np.ndarray,
    after: Float[np.ndarray, " path"],
    noise: np.ndarray,
    gap: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, " path"]:
    """Sample the level at a reading, given the drift and the level at the next one."""
    mean, covariance = step.belief.mean[owners], step.belief.covariance[owners]
    slope = covariance[:, 0, 1] / covariance[:, 1, 1]
    own = mean[:, 0] + slope * (drift - mean[:, 1])
    spread = np.maximum(covariance[:, 0, 0] - slope * covariance[:, 0, 1], 1e-300)
    gain = spread / (spread + noise)
    centre = own + gain * (after - drift * gap - own)
    return np.asarray(centre + np.sqrt(spread * (1.0 - gain)) * rng.standard_normal(len(own)))
