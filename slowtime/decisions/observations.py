"""Observations that may be ordered: what each would save on the futures of an asset."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from .continuation import Cycle, Follow
from .information import of_a_number, of_detection, of_readings, value_of_information

Kind = Literal["inspection", "detection", "readings"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """Something that would tell more of the damage.

    Parameters
    ----------
    name
        What people call it.
    kind
        A number with an error at one time, a detection or none, or several readings.
    cost
        Of all of it [currency].
    sd
        Error of the number, or of one reading [1].
    half, slope
        Of a detection: the damage that is found in one half of the cases, and the exponent.
    count
        Of readings.
    every
        Time from one reading to the next [time].
    """

    name: str
    kind: Kind = "inspection"
    cost: float = 0.0
    sd: float = 0.0
    half: float = 0.5
    slope: float = 4.0
    count: int = 1
    every: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Worth:
    """What an observation is worth.

    Parameters
    ----------
    observation, at
        Which, and the time from now by which it is made [time].
    value
        VoI among the actions that are left then, at least 0 [currency].
    net
        Expected cost of the best action without it, minus expected cost with it, what it costs
        itself included [currency]: negative where it is not worth its cost, or too late.
    changes
        Probability that it changes the action [1].
    """

    observation: Observation
    at: float
    value: float
    net: float
    changes: float


@dataclasses.dataclass(frozen=True, slots=True)
class Actions:
    """What may be done later: repairs planned at some times, or none, or rules followed.

    Parameters
    ----------
    cycles
        How each future goes under each.
    items
        Discounted items of each in each future.
    follow
        What follows a renewal.
    index
        Index of the time of each planned repair; the count of times for none.
    """

    cycles: tuple[Cycle, ...]
    items: Float[np.ndarray, "path action item"]
    follow: Follow
    index: tuple[int, ...] = ()

    def since(self, index: int) -> "Actions":
        """Planned repairs that are left at the time of `index`."""
        left = [k for k, at in enumerate(self.index) if at >= index]
        cycles = tuple(self.cycles[k] for k in left)
        at = tuple(self.index[k] for k in left)
        return Actions(cycles, self.items[:, left], self.follow, at)


def likelihood_of(
    observation: Observation,
    index: int,
    time: Float[np.ndarray, " time"],
    damage: Float[np.ndarray, "path time"],
    weights: Float[np.ndarray, " path"],
) -> Float[np.ndarray, "path outcome"]:
    """Probability of each outcome of an observation by the time of `index`, in each future.

    Parameters
    ----------
    observation
        Inspection, detection or readings.
    index
        Index of the time at which the outcome is in.
    time
        Times from now [time].
    damage
        Damage of each future [1].
    weights
        Weight of each future; their sum is 1.

    Returns
    -------
    Probabilities; each row sums to 1.
    """
    if observation.kind == "detection":
        return of_detection(damage[:, index], half=observation.half, slope=observation.slope)
    if observation.kind == "inspection" or observation.count == 1:
        return of_a_number(damage[:, index], weights, observation.sd)
    at = np.linspace(0.0, time[index], observation.count + 1)[1:]
    place = at / (time[1] - time[0])
    before = np.minimum(place.astype(int), len(time) - 2)
    share = place - before
    read = damage[:, before] * (1.0 - share) + damage[:, before + 1] * share
    return of_readings(read, at, weights, observation.sd)


def index_of(observation: Observation, time: Float[np.ndarray, " time"]) -> int:
    """Index of the first time by which readings are in; 0 for an inspection.

    Parameters
    ----------
    observation
        Inspection, detection or readings.
    time
        Times from now [time].

    Returns
    -------
    Index of the time; the last one where readings take longer than the horizon.
    """
    if observation.kind != "readings":
        return 0
    asked = observation.count * observation.every
    return min(int(np.searchsorted(time, asked * (1 - 1e-9))), len(time) - 1)


def worth(
    observation: Observation,
    index: int,
    time: Float[np.ndarray, " time"],
    damage: Float[np.ndarray, "path time"],
    weights: Float[np.ndarray, " path"],
    actions: Actions,
    prices: Float[np.ndarray, " item"],
    least: float,
    weight: float,
) -> Worth:
    """Value an observation by the time of `index` before it is made.

    Parameters
    ----------
    observation
        Inspection, detection or readings.
    index
        Index of the time at which the outcome is in.
    time
        Times from now [time].
    damage
        Damage of each future [1].
    weights
        Weight of each future; their sum is 1.
    actions
        What may be done from then on.
    prices
        Mean cost of each item.
    least
        Expected cost of the best option without it [currency].
    weight
        Discount factor of its cost.

    Returns
    -------
    Value of the observation [currency], and what it would change.
    """
    likelihood = likelihood_of(observation, index, time, damage, weights)
    found = value_of_information(actions.items @ prices, weights, likelihood)
    with_it = float(found.prior - found.value) + weight * observation.cost
    at, changes = float(time[index]), float(found.changes)
    return Worth(observation, at, float(found.value), least - with_it, changes)


def most_worth(found: Sequence[Worth]) -> Worth | None:
    """Give the observation of largest net value, where one is worth its cost."""
    best = max(found, key=lambda one: one.net, default=None)
    return best if best is not None and best.net > 0.0 else None
