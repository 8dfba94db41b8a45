"""Forecasts by one who knows the family of the law, and the prior of its parameters."""

import dataclasses

import numpy as np
from scipy.special import ndtr

from .histories import CURVES, FINE, JUMPS, InstantCase, between_logs

WALKERS, STEPS, BURNT, EVERY = 48, 360, 160, 5
"""Of the ensemble sampler: 1,920 samples of each posterior."""

PATHS, PARTICLES = 2000, 600
NODES = 9
"""Values of each parameter of a walk."""


@dataclasses.dataclass(frozen=True, slots=True)
class Futures:
    """Sampled futures, from the last reading to the end of the history.

    Parameters
    ----------
    time, paths
        Times, and the change of each path there.
    roughness
        Of each path, the variance of its diffusion over a unit of time.
    """

    time: np.ndarray
    paths: np.ndarray
    roughness: np.ndarray

    def probability(self, threshold: float) -> float:
        """Probability that the change is below the threshold at any time up to the end."""
        above = self.paths - threshold
        step = np.diff(self.time)
        with np.errstate(divide="ignore", over="ignore"):
            product = above[:, 1:] * above[:, :-1]
            rough = np.maximum(self.roughness[:, None] * step, 1e-300)
            bridged = -np.expm1(-2.0 * np.maximum(product, 0.0) / rough)
        bridged = np.where(self.roughness[:, None] > 0.0, bridged, 1.0)
        survives = np.where((above > 0.0).all(axis=1), np.prod(bridged, axis=1), 0.0)
        return float(1.0 - survives.mean())

    def band(self, times: np.ndarray) -> np.ndarray:
        """Compute the ends of the central 95 % at some times [time, end]."""
        after = np.clip(np.searchsorted(self.time, times), 1, len(self.time) - 1)
        part = (times - self.time[after - 1]) / (self.time[after] - self.time[after - 1])
        there = self.paths[:, after - 1] * (1.0 - part) + self.paths[:, after] * part
        return np.asarray(np.quantile(there, [0.025, 0.975], axis=0).T)


def futures(case: InstantCase, readings: int, rng: np.random.Generator) -> Futures:
    """Sample what may follow the first so many readings of a history."""
    if case.law in CURVES:
        return _curves(case, readings, rng)
    if case.law == JUMPS:
        return _jumps(case, readings, rng)
    return _walks(case, readings, rng)


def _later(case: InstantCase, readings: int) -> np.ndarray:
    return np.asarray(case.fine[case.fine >= case.time[readings - 1] - 1e-12])


def _curves(case: InstantCase, readings: int, rng: np.random.Generator) -> Futures:
    """Affine-invariant ensemble sampler, begun at the true parameters.

    References
    ----------
    .. [1] J. Goodman and J. Weare, "Ensemble samplers with affine invariance" (2010).
    """
    kind = CURVES[case.law]
    time, value = case.time[:readings], case.value[:readings]
    size = kind.parameters

    def log_density(u: np.ndarray) -> np.ndarray:
        away = (value - kind.curve(u, time)) / case.sd
        return np.asarray(-0.5 * np.sum(away**2, axis=1) - 0.5 * np.sum(u**2, axis=1))

    walkers = case.parameters + 0.02 * rng.standard_normal((WALKERS, size))
    log, half, kept = log_density(walkers), WALKERS // 2, []
    for step in range(STEPS):
        for own, others in (
            (slice(None, half), slice(half, None)),
            (slice(half, None), slice(None, half)),
        ):
            stretch = (1.0 + rng.random(half)) ** 2 / 2.0
            partner = walkers[others][rng.integers(0, half, half)]
            moved = partner + stretch[:, None] * (walkers[own] - partner)
            there = log_density(moved)
            accept = np.log(rng.random(half)) < (size - 1) * np.log(stretch) + there - log[own]
            walkers[own] = np.where(accept[:, None], moved, walkers[own])
            log[own] = np.where(accept, there, log[own])
        if step >= BURNT and step % EVERY == 0:
            kept.append(walkers.copy())
    later = _later(case, readings)[::5]
    later = later if later[-1] == 1.0 else np.append(later, 1.0)
    sample = np.concatenate(kept)
    return Futures(later, kind.curve(sample, later), np.zeros(len(sample)))


def _walks(case: InstantCase, readings: int, rng: np.random.Generator) -> Futures:
    """Kalman filters of wander, level and slope over a net of scatter and memory."""
    q = np.array([-1.9, -1.3, -0.85, -0.4, 0.0, 0.4, 0.85, 1.3, 1.9])
    edges = np.concatenate([[-9.0], 0.5 * (q[1:] + q[:-1]), [9.0]])
    share = np.diff(ndtr(edges))
    if case.law == "random walk":
        sd, memory, log = between_logs(q, 0.05, 0.25), np.full(NODES, np.inf), np.log(share)
    else:
        sd = np.repeat(between_logs(q, 0.02, 0.08), NODES)
        memory = np.tile(between_logs(q, 0.02, 0.2), NODES)
        log = np.add.outer(np.log(share), np.log(share)).ravel()
    rough = np.isinf(memory)
    mean = np.zeros((len(sd), 3))
    mean[:, 2] = -0.1
    spread = np.zeros((len(sd), 3, 3))
    spread[:, 0, 0], spread[:, 1, 1], spread[:, 2, 2] = np.where(rough, 0.0, sd**2), 1e-4, 1e-2
    step = case.time[1]
    keep, shock = _transition(sd, memory, step)
    for i in range(readings):
        if i:
            mean[:, 0] *= keep
            spread[:, 0, :] *= keep[:, None]
            spread[:, :, 0] *= keep[:, None]
            spread[:, 0, 0] += shock
        row = np.array([1.0, 1.0, case.time[i]])
        reach = spread @ row
        total = reach @ row + case.sd**2
        residual = case.value[i] - mean @ row
        log = log - 0.5 * (residual**2 / total + np.log(total))
        mean = mean + reach * (residual / total)[:, None]
        spread = spread - reach[:, :, None] * reach[:, None, :] / total[:, None, None]
    weight = np.exp(log - log.max())
    owner = rng.choice(len(sd), size=PATHS, p=weight / weight.sum())
    values, vectors = np.linalg.eigh(spread[owner])
    start = mean[owner] + np.einsum(
        "pij,pj->pi",
        vectors,
        np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal((PATHS, 3)),
    )
    later = _later(case, readings)[::FINE]
    keep, shock = _transition(sd[owner], memory[owner], step)
    wander = np.empty((PATHS, len(later)))
    wander[:, 0] = start[:, 0]
    for i in range(1, len(later)):
        wander[:, i] = keep * wander[:, i - 1] + np.sqrt(shock) * rng.standard_normal(PATHS)
    paths = wander + start[:, 1:2] + start[:, 2:3] * later
    return Futures(later, paths, shock / step)


def _transition(
    sd: np.ndarray, memory: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    keep = np.exp(-step / memory)
    return keep, np.where(np.isinf(memory), sd**2 * step, sd**2 * (1.0 - keep**2))


def _jumps(case: InstantCase, readings: int, rng: np.random.Generator) -> Futures:
    """Rao-Blackwellized particle filter over the places of jumps, whose law is known."""
    assert case.jumps is not None
    jumps, step = case.jumps, case.time[1]
    chance = -np.expm1(-jumps.rate * step)
    # The slope is minus the magnitude of a normal number: here its mean and variance.
    slope, slope_sd = -0.05 * np.sqrt(2.0 / np.pi), 0.05 * np.sqrt(1.0 - 2.0 / np.pi)
    mean = np.tile([0.0, slope], (PARTICLES, 1))
    spread = np.tile(np.diag([1e-4, slope_sd**2]), (PARTICLES, 1, 1))
    log = np.full(PARTICLES, -np.log(PARTICLES))
    for i in range(readings):
        if i:
            mean[:, 0] += step * mean[:, 1]
            spread[:, 0, :] += step * spread[:, 1, :]
            spread[:, :, 0] += step * spread[:, :, 1]
            jumped, wider = mean.copy(), spread.copy()
            jumped[:, 0] += jumps.mean
            wider[:, 0, 0] += jumps.sd**2
            mean, spread = np.concatenate([mean, jumped]), np.concatenate([spread, wider])
            log = np.concatenate([log + np.log1p(-chance), log + np.log(chance)])
        total = spread[:, 0, 0] + case.sd**2
        residual = case.value[i] - mean[:, 0]
        log = log - 0.5 * (residual**2 / total + np.log(total))
        reach = spread[:, :, 0]
        mean = mean + reach * (residual / total)[:, None]
        spread = spread - reach[:, :, None] * reach[:, None, :] / total[:, None, None]
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        if len(weight) > PARTICLES:
            at = (rng.random() + np.arange(PARTICLES)) / PARTICLES
            chosen = np.minimum(np.searchsorted(np.cumsum(weight), at), len(weight) - 1)
            mean, spread = mean[chosen], spread[chosen]
            log = np.full(PARTICLES, -np.log(PARTICLES))
    weight = np.exp(log - log.max())
    owner = rng.choice(len(mean), size=PATHS, p=weight / weight.sum())
    factor = np.linalg.cholesky(spread[owner] + 1e-14 * np.eye(2))
    start = mean[owner] + np.einsum("pij,pj->pi", factor, rng.standard_normal((PATHS, 2)))
    later = _later(case, readings)[::FINE]
    count = rng.poisson(jumps.rate * step, (PATHS, len(later) - 1))
    size = count * jumps.mean + np.sqrt(count) * jumps.sd * rng.standard_normal(count.shape)
    jumped = np.concatenate([np.zeros((PATHS, 1)), np.cumsum(size, axis=1)], axis=1)
    paths = start[:, :1] + start[:, 1:] * (later - later[0]) + jumped
    return Futures(later, paths, np.zeros(PATHS))
