"""Standing maintenance policies, each as a rule that ends a cycle of an asset."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .continuation import Cycle
from .ensemble import Ensemble

BINS = 40
"""Levels of the estimate [1] at which P_f is read off the futures: 1/40 of the damage at
failure, finer than most estimates."""


@dataclasses.dataclass(frozen=True, slots=True)
class EstimateError:
    """Error of the estimate of the damage by which a condition-based rule acts.

    Parameters
    ----------
    sd
        Standard deviation [1].
    memory
        Time over which errors forget, exp(-t / memory) [time]; 0 for independent ones.
    seed
        Of the errors: the same at every call.
    """

    sd: float = 0.0
    memory: float = 0.0
    seed: int = 0

    def of(self, futures: Ensemble) -> Float[np.ndarray, "path time"]:
        """Estimates of the damage of each future at each time."""
        if self.sd == 0.0:
            return futures.damage
        step = futures.time[1] - futures.time[0]
        kept = float(np.exp(-step / self.memory)) if self.memory > 0 else 0.0
        rng = np.random.default_rng(self.seed)
        errors = rng.standard_normal(futures.damage.shape)
        if kept > 0.0:
            fresh = np.sqrt(1.0 - kept**2)
            for k in range(1, errors.shape[1]):
                errors[:, k] = kept * errors[:, k - 1] + fresh * errors[:, k]
        return futures.damage + self.sd * errors


def run_to_failure(futures: Ensemble) -> Cycle:
    """Repair nothing before it fails."""
    end = futures.failure_index()
    return Cycle(end, end < len(futures.time))


def at_age(futures: Ensemble, index: int) -> Cycle:
    """Repair at the time of `index`, or once it can be done, unless it fails before.

    The repair is ordered as late as its lead time allows.
    """
    time, access = futures.time, futures.access
    effect = int(access.planned_index(time)[index])
    ordered = np.flatnonzero(access.effect_index(time)[:-1] <= effect)
    order = int(ordered[-1]) if effect < len(time) and len(ordered) else len(time)
    return _first(futures, *(np.full(len(futures.weights), at) for at in (effect, order)))


def at_estimate(
    futures: Ensemble, threshold: float, estimates: Float[np.ndarray, "path time"]
) -> Cycle:
    """Order a repair as soon as the estimate of the damage reaches a threshold.

    Parameters
    ----------
    futures
        Futures of the asset.
    threshold
        Damage at which to order a repair [1].
    estimates
        Estimate of the damage in each future [1].

    Returns
    -------
    Cycle of the asset in each future.
    """
    return _ordered(futures, _reached(estimates >= threshold))


def by_inspection(
    futures: Ensemble, every: int, threshold: float, measured: Float[np.ndarray, "path time"]
) -> Cycle:
    """Inspect at equal intervals, and order a repair where the damage reaches a threshold.

    Parameters
    ----------
    futures
        Futures of the asset.
    every
        Number of steps between two inspections.
    threshold
        Damage at which to repair [1].
    measured
        Damage that an inspection would measure at each time [1].

    Returns
    -------
    Cycle of the asset in each future, with its inspections.
    """
    count = len(futures.time)
    due = (np.arange(count) % every == 0) & (np.arange(count) > 0)
    order = _reached((measured >= threshold) & due)
    found = _ordered(futures, order)
    # Nothing is inspected any more between the order and the repair.
    before = (np.arange(count) < found.end[:, None] + ~found.failed[:, None]) & (
        np.arange(count) <= order[:, None]
    )
    return dataclasses.replace(found, inspected=(due & before).astype(float))


def threshold_of_probability(
    futures: Ensemble,
    estimates: Float[np.ndarray, "path time"],
    probability: float,
    window: int,
) -> float:
    """Level of the estimate from which a failure within `window` steps is that probable.

    Read off the futures: of all times of all futures that have not failed, the share that fails
    within the window, by level of the estimate and made monotone.

    Parameters
    ----------
    futures
        Futures of the asset.
    estimates
        Estimate of the damage in each future [1].
    probability
        P_f that calls for a repair [1].
    window
        Steps within which a failure counts.

    Returns
    -------
    The damage [1]; infinite where no level is that dangerous.
    """
    steps = np.arange(len(futures.time))
    fails = futures.failure_index()[:, None]
    alive = (fails > steps) & (steps + window < len(futures.time))
    level = np.clip((estimates * BINS).astype(int), 0, 2 * BINS)
    weight = np.broadcast_to(futures.weights[:, None], alive.shape)[alive]
    soon = (fails <= steps + window)[alive]
    seen = np.bincount(level[alive], weight, 2 * BINS + 1)
    failed = np.bincount(level[alive], weight * soon, 2 * BINS + 1)
    share = np.maximum.accumulate(failed / np.where(seen > 0, seen, 1.0))
    dangerous = share >= probability
    return float(dangerous.argmax() / BINS) if dangerous.any() else np.inf


def _reached(where: Bool[np.ndarray, "path time"]) -> Int[np.ndarray, " path"]:
    return np.asarray(np.where(where.any(axis=1), where.argmax(axis=1), where.shape[1]))


def _ordered(futures: Ensemble, order: Int[np.ndarray, " path"]) -> Cycle:
    """Repair when an order takes effect that is placed at an index of each future."""
    return _first(futures, futures.access.effect_index(futures.time)[order], order)


def _first(
    futures: Ensemble, repair: Int[np.ndarray, " path"], order: Int[np.ndarray, " path"]
) -> Cycle:
    """End each cycle by what comes first; a failure before the time of a repair does."""
    fails = futures.failure_index()
    failed = (fails <= repair) & (fails < len(futures.time))
    return Cycle(np.minimum(fails, repair), failed, ordered=order)
