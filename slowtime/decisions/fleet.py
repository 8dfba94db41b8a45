"""Decisions for a fleet: which assets to repair or to inspect now, and where teams go first."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from . import drift
from .continuation import Follow
from .costs import INSPECTION, Costs, discount
from .ensemble import Ensemble, from_paths
from .lookahead import Lookahead, Monitored, look_ahead, never_items, repair_items
from .rules import EstimateError
from .standing import Starts, threshold_policy

AHEAD = np.array([0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 24, 30, 36, 48, 60])
"""Epochs after which a repair may be planned: every one at first, where decisions are near."""

RATES = (0.4, 0.7, 1.0, 1.4, 2.0, 3.0)
"""Rates [of the fleet's mean] for which V is computed; between them it is interpolated."""

WAITS = (1, 2, 4, 8)
"""Epochs of waiting after which it is decided by the readings that came meanwhile."""

OUTCOMES = 32
"""Intervals of what is read: of 15 states, more tell no more."""

PATHS = 300
"""Futures of a new asset at each rate: the error of V is then below that of the rates."""


@dataclasses.dataclass(frozen=True, slots=True)
class Continuations:
    """V after a renewal by the rate of an asset.

    Parameters
    ----------
    rate
        Ascending [1/time].
    value
        V for every remaining number of epochs.
    """

    rate: Float[np.ndarray, " rate"]
    value: Float[np.ndarray, "rate epoch item"]

    def at(
        self, rate: Float[np.ndarray, " asset"], remaining: Int[np.ndarray, " time"]
    ) -> Float[np.ndarray, "asset time item"]:
        """V of each asset with so many epochs remaining, interpolated linearly between rates.

        Parameters
        ----------
        rate
            Rate of each asset [1/time].
        remaining
            Numbers of epochs that remain.

        Returns
        -------
        Expected discounted items.
        """
        place = np.clip(np.searchsorted(self.rate, rate) - 1, 0, len(self.rate) - 2)
        low, high = self.rate[place], self.rate[place + 1]
        share = np.clip((rate - low) / (high - low), 0.0, 1.0)[:, None, None]
        found = self.value[:, remaining]
        return np.asarray((1.0 - share) * found[place] + share * found[place + 1])


def continuations(
    costs: Costs,
    *,
    mean_rate: float,
    variance: float,
    acceleration: float = 0.0,
    epochs: int,
    step: float,
    error: EstimateError,
    seed: int = 0,
) -> Continuations:
    """Compute V of new assets of several rates, each under its best threshold on the estimate.

    Parameters
    ----------
    costs
        Costs of all items.
    mean_rate, variance, acceleration
        M and q [1/time], and c [1], of the fleet.
    epochs, step
        Until the end of the horizon, and from one to the next [time].
    error
        Of the estimate by which thresholds act.
    seed
        Seed of the simulated futures.

    Returns
    -------
    V by rate and remaining number of epochs.
    """
    time = step * np.arange(epochs + 1)
    rng = np.random.default_rng(seed)
    scale = variance / mean_rate
    values = []
    for rate in mean_rate * np.array(RATES):
        grown = rng.gamma(rate * step / scale, scale, (PATHS, epochs))
        place = np.concatenate([np.zeros((PATHS, 1)), np.cumsum(grown, axis=1)], axis=1)
        damage = drift.damage_at(np.minimum(place, 2.0), np.array(acceleration))
        futures = from_paths(time, damage)
        values.append(_value_of(futures, costs, error).new)
    return Continuations(mean_rate * np.array(RATES), np.stack(values))


def _value_of(futures: Ensemble, costs: Costs, error: EstimateError) -> Follow:
    return threshold_policy(Starts(futures, futures, None), costs, error).follow


def decide(
    pooled: drift.Pooled,
    costs: Costs,
    follow: Continuations,
    *,
    epochs: int,
    step: float,
    reading_sd: float | None = None,
    inspection_sd: float | None = None,
) -> Lookahead:
    """Choose for each asset whether to repair, to inspect first, or to wait.

    Parameters
    ----------
    pooled
        What is believed of each asset.
    costs
        Costs of all items.
    follow
        V after a renewal.
    epochs, step
        Until the end of the horizon, and from one to the next [time].
    reading_sd
        Error of the reading of each epoch [1]; None where none come.
    inspection_sd
        Error of an inspection [1]; None where none can be ordered.

    Returns
    -------
    Choice for each asset, with its net values.
    """
    ahead = AHEAD[epochs >= AHEAD]
    place, rate = drift.states_of(pooled)
    cdf = drift.failure_cdf(pooled, place, rate, step * ahead)
    damage = drift.damage_at(place, pooled.acceleration)
    after = follow.at(pooled.rate, epochs - ahead)[:, None]
    prices = costs.prices()
    cost = repair_items(step * ahead, cdf, costs, after, after) @ prices
    if epochs <= AHEAD[-1]:
        never = never_items(step * ahead, cdf, costs, after) @ prices
        cost = np.concatenate([cost, never[..., None]], axis=-1)
    weights = np.full(place.shape, 1.0 / place.shape[-1])
    monitored: list[Monitored] = []
    if reading_sd is not None:
        monitored += _monitored(pooled, ahead, step, reading_sd)
    if inspection_sd is not None:
        monitored += _postponed(pooled, ahead, step, inspection_sd, costs)
    return look_ahead(
        cost,
        weights,
        damage,
        inspection_sd=inspection_sd or 0.0,
        inspection_cost=np.inf if inspection_sd is None else costs.price(INSPECTION),
        monitored=monitored,
        outcomes=OUTCOMES,
    )


def _monitored(
    pooled: drift.Pooled, ahead: Int[np.ndarray, " time"], step: float, sd: float
) -> list[Monitored]:
    """Say how well the readings of some epochs together tell the damage of now.

    The mean of n readings less the expected drift has the variance sd² / n of their errors, and
    of the mean of a Wiener process over their time t a third of q t.
    """
    found = []
    for count in WAITS:
        if count in ahead:
            time = step * count
            own = (sd / drift.slope_at(pooled.place, pooled.acceleration)) ** 2
            var = own / count + pooled.variance * time / 3.0 + pooled.prr * time**2 / 3.0
            found.append(Monitored(int(np.flatnonzero(ahead == count)[0]), np.sqrt(var)))
    return found


def _postponed(
    pooled: drift.Pooled,
    ahead: Int[np.ndarray, " time"],
    step: float,
    sd: float,
    costs: Costs,
) -> list[Monitored]:
    """Say what an inspection after some epochs of waiting tells, and costs.

    What the damage does meanwhile, of variance q t, hides in which state it is now.
    """
    found = []
    for count in WAITS:
        if count in ahead:
            time = step * count
            own = (sd / drift.slope_at(pooled.place, pooled.acceleration)) ** 2
            weight = float(discount(np.array([time]), costs.discount_rate)[0])
            found.append(
                Monitored(
                    int(np.flatnonzero(ahead == count)[0]),
                    np.sqrt(own + pooled.variance * time),
                    weight * costs.price(INSPECTION),
                )
            )
    return found


@dataclasses.dataclass(frozen=True, slots=True)
class VisitCandidate:
    """An asset that a team might be sent to.

    Parameters
    ----------
    asset
        Its id.
    net_value
        Net value of an inspection within the window [currency].
    cost
        Of the inspection [currency].
    """

    asset: str
    net_value: float
    cost: float


def dispatch(
    candidates: Sequence[VisitCandidate], visits: int, budget: float | None = None
) -> tuple[VisitCandidate, ...]:
    """Choose the assets that teams inspect, of the largest total net value.

    Parameters
    ----------
    candidates
        Assets that could be inspected, with net value and cost.
    visits
        How many inspections the teams can make.
    budget
        What they may cost in all [currency]; None for no limit.

    Returns
    -------
    The assets in the order of their net value; none whose inspection is not worth its cost.
    Without a budget this is the best choice; with one and different costs, the better of the
    choices by net value and by net value per cost, which is at least half of the best.
    """
    useful = [one for one in candidates if one.net_value > 0.0]
    by_value = _greedy(sorted(useful, key=lambda one: -one.net_value), visits, budget)
    ratio = sorted(useful, key=lambda one: -one.net_value / max(one.cost, 1e-300))
    by_ratio = _greedy(ratio, visits, budget)
    best = max(by_value, by_ratio, key=lambda chosen: sum(one.net_value for one in chosen))
    return tuple(sorted(best, key=lambda one: -one.net_value))


def _greedy(
    ordered: Sequence[VisitCandidate], visits: int, budget: float | None
) -> list[VisitCandidate]:
    chosen: list[VisitCandidate] = []
    spent = 0.0
    for one in ordered:
        fits = budget is None or spent + one.cost <= budget
        if len(chosen) < visits and fits:
            chosen.append(one)
            spent += one.cost
    return chosen
