"""Futures of an asset, as decisions need them: damage, failure times, and what repairs do."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from .lead_times import Access

NEVER = np.inf


@dataclasses.dataclass(frozen=True, slots=True)
class Ensemble:
    """Weighted futures of one asset from now on, with the futures after a repair.

    Any model of degradation may make one: drawn paths of a Gaussian process, or of the
    posterior of a degradation law.

    Parameters
    ----------
    time
        Times from now: 0, and equal steps up to the horizon [time].
    damage
        Of each future at each time; 0 as built, 1 where it counts as failed [1].
    failure_time
        Of each future, infinite where it does not fail before the horizon [time].
    weights
        Of each future; their sum is 1.
    renewed
        Gives the futures of an asset that starts at a given damage: 0 as new, more after a
        repair that does not restore all; by default the increments of these futures from that
        damage on.
    access
        Lead time of a repair, and the windows in which it may take effect.

    Raises
    ------
    ValueError
        Where times are not equally spaced from 0, or weights are negative or do not sum to 1.
    """

    time: Float[np.ndarray, " time"]
    damage: Float[np.ndarray, "path time"]
    failure_time: Float[np.ndarray, " path"]
    weights: Float[np.ndarray, " path"]
    renewed: Callable[[float], "Ensemble"] | None = None
    access: Access = dataclasses.field(default_factory=Access)

    def __post_init__(self) -> None:
        steps = np.diff(self.time)
        if len(steps) < 1 or self.time[0] != 0.0 or not np.allclose(steps, steps[0], rtol=1e-6):
            raise ValueError(
                f"Times {self.time[:3]} … of an ensemble are not 0 and equal steps. Give "
                "np.linspace(0, horizon, count)."
            )
        if not steps[0] > 0:
            raise ValueError(f"The horizon {self.time[-1]:g} is not after now. Give more.")
        total = float(self.weights.sum())
        if np.any(self.weights < 0) or not abs(total - 1.0) < 1e-6:
            raise ValueError(
                f"Weights of futures sum to {total:g}. Give weights of at least 0 with sum 1."
            )

    @property
    def horizon(self) -> float:
        """Last time [time]."""
        return float(self.time[-1])

    def failure_index(self) -> Int[np.ndarray, " path"]:
        """Index of the first time at or after each failure; the count of times for none."""
        return np.searchsorted(self.time, self.failure_time * (1 - 1e-12), side="left")

    def failure_cdf(self) -> Float[np.ndarray, "path time"]:
        """1 from the failure of each future on, 0 before."""
        return (self.failure_time[:, None] <= self.time).astype(float)

    def failure_probability(self) -> Float[np.ndarray, " time"]:
        """Probability of a failure by each time."""
        found: Float[np.ndarray, " time"] = self.weights @ self.failure_cdf()
        return found

    def after_repair(self, start: float) -> "Ensemble":
        """Futures of an asset that has just been repaired.

        Parameters
        ----------
        start
            Damage that the repair leaves [1].

        Returns
        -------
        The futures.
        """
        if self.renewed is not None:
            return self.renewed(start)
        return from_paths(self.time, self.damage - self.damage[:, :1] + start, self.weights)


def from_paths(
    time: Float[np.ndarray, " time"],
    damage: Float[np.ndarray, "path time"],
    weights: Float[np.ndarray, " path"] | None = None,
    renewed: Callable[[float], Ensemble] | None = None,
) -> Ensemble:
    """Make an ensemble of paths of damage, which fail where they first reach 1.

    Parameters
    ----------
    time, damage, weights, renewed
        As of `Ensemble`; equal weights by default. Between times a path is straight.

    Returns
    -------
    The ensemble.

    Examples
    --------
    >>> from_paths(np.array([0.0, 1.0, 2.0]), np.array([[0.0, 0.8, 1.2]])).failure_time
    array([1.5])
    """
    failed = damage >= 1.0
    first = np.where(failed.any(axis=1), failed.argmax(axis=1), len(time))
    row, after = np.arange(len(damage)), np.minimum(first, len(time) - 1)
    before = np.maximum(after - 1, 0)
    low, high = damage[row, before], damage[row, after]
    share = np.where(first > 0, (1.0 - low) / np.where(high > low, high - low, 1.0), 0.0)
    at = time[before] + share * (time[after] - time[before])
    times = np.where(first == len(time), NEVER, np.where(first == 0, 0.0, at))
    if weights is None:
        weights = np.full(len(damage), 1.0 / len(damage))
    return Ensemble(time, damage, times, weights, renewed)
