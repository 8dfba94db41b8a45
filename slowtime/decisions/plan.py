"""Comparison and ranking of maintenance options, with the value of more data."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from .comparison import Ranking, rank
from .continuation import Cycle, Follow, payments, per_path
from .costs import CLOSED, CLOSING, INSPECTION, ITEMS, Costs, discount
from .ensemble import Ensemble
from .information import value_of_information
from .lead_times import Access, LastOrder, last_order_by_cost, last_order_by_probability
from .lookahead import never_items, repair_items
from .observations import (
    Actions,
    Observation,
    Worth,
    index_of,
    likelihood_of,
    most_worth,
    worth,
)
from .option import Now, Option
from .rules import EstimateError, at_age, at_estimate
from .standing import Starts, standing_policies

LATER = 16
"""Later times of a repair among which is chosen after an observation."""

LEVELS_AFTER = (0.6, 0.7, 0.8, 0.85, 0.9)
"""Thresholds on the estimate [1] that may be followed after an observation."""

INSPECTIONS = 8
"""Later times of an inspection that are tried."""

LEAST_GAIN = 1e-3
"""Share of the least cost of waiting [1] by which deciding after readings has to be cheaper
to be an option. Source: less than the three digits of a printed cost."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Terms:
    """What decisions take for granted, besides futures and costs.

    Parameters
    ----------
    restored, restored_sd
        Share of the damage that a repair takes away, and its standard deviation [1].
    error
        Of the estimate by which thresholds act.
    window
        Time within which a failure counts for the threshold on P_f [time].
    inspection
        How an inspection that may be ordered measures; None where none can be.
    observations
        Others that may be ordered: sensors, more readings.
    access
        Lead time of a repair, and the windows in which it may take effect.
    accepted
        Accepted probability of a failure before a repair takes effect [1]: the last order is
        judged by it; None to judge it by cost.
    seed
        Of draws of costs.
    """

    restored: float = 1.0
    error: EstimateError = dataclasses.field(default_factory=EstimateError)
    window: float = 0.0
    inspection: Observation | None = None
    observations: tuple[Observation, ...] = ()
    access: Access = dataclasses.field(default_factory=Access)
    accepted: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.restored <= 1.0:
            raise ValueError(
                f"A repair that restores {self.restored:g} was given. Allowed: above 0, up "
                "to 1."
            )


@dataclasses.dataclass(frozen=True, slots=True)
class Plan:
    """What to do with one asset.

    Parameters
    ----------
    options
        All that may be done, the cheapest first.
    costs
        Expected cost of each [currency].
    ranking
        Best option, the best that does something else now, and whether that is known.
    worths
        Of each observation, the most that it is worth; the best first.
    inspections
        What an inspection is worth at each time that was tried.
    repair_cost
        Expected cost of a repair at each time [currency].
    failure_probability
        By each time [1].
    futures
        What it was made of.
    last_order
        The last order of a repair that is in time.
    """

    options: tuple[Option, ...]
    costs: Float[np.ndarray, " option"]
    ranking: Ranking
    worths: tuple[Worth, ...]
    inspections: tuple[Worth, ...]
    repair_cost: Float[np.ndarray, " time"]
    failure_probability: Float[np.ndarray, " time"]
    futures: Ensemble
    last_order: LastOrder

    @property
    def best(self) -> Option:
        """Cheapest option."""
        return self.options[self.ranking.best]

    @property
    def advice(self) -> Worth | None:
        """Observation of largest net value that is in time, where one is worth its cost."""
        last = max(self.last_order.order, 0.0)
        return most_worth([one for one in self.worths if one.at <= last])


def make_plan(futures: Ensemble, costs: Costs, terms: Terms) -> Plan:
    """Compare all options of an asset over its futures, with common random numbers.

    Parameters
    ----------
    futures
        From now to the horizon.
    costs
        Times in the unit of the futures.
    terms
        Terms besides futures and costs, such as what a repair restores and what can be ordered.

    Returns
    -------
    Options with expected costs until the horizon; each includes what follows the first renewal:
    for repairs and inspections now or at a time, the best standing policy.
    """
    futures = dataclasses.replace(futures, access=terms.access)
    starts = Starts.of(futures, terms.restored)
    window = _window(futures, terms.window)
    inspection = terms.inspection
    standing = standing_policies(
        starts,
        costs,
        terms.error,
        window=window,
        inspection_sd=None
        if inspection is None or inspection.kind != "inspection"
        else inspection.sd,
    )
    prices = costs.prices()
    follow = min(standing, key=lambda one: float(one.follow.new[-1] @ prices)).follow
    items, never = _planned(futures, costs, follow)
    expected = futures.weights @ (items @ prices)
    actions = _Left(futures, costs, terms.error, _actions(futures, items, never, follow))
    options = [one.option for one in standing]
    options += _repairs(futures, items, expected, costs, follow)
    if costs.closing is not None:
        options += _closings(futures, costs, follow)
    least = _least(options, futures, prices)
    if inspection is not None:
        options += _inspections(futures, costs, inspection, actions)
    last = _last_order(futures, items, never, prices, terms)
    waiting = [float(futures.weights @ (o.items @ prices)) for o in options if o.now == "wait"]
    options += _readings(futures, costs, terms, actions, last.order, min(waiting))
    means = np.array([float(each.quantities(futures.weights) @ prices) for each in options])
    order = np.argsort(means, kind="stable")
    options = [options[k] for k in order]
    worths = _worths(futures, costs, terms, actions, least)
    return Plan(
        tuple(options),
        means[order],
        rank(options, futures.weights, costs, terms.seed),
        tuple(sorted((max(each, key=_net) for each in worths), key=_net, reverse=True)),
        worths[0] if inspection is not None else (),
        expected,
        futures.failure_probability(),
        futures,
        last,
    )


def _last_order(
    futures: Ensemble,
    items: Float[np.ndarray, "path time item"],
    never: Float[np.ndarray, "path item"],
    prices: Float[np.ndarray, " item"],
    terms: Terms,
) -> LastOrder:
    failing, weights = futures.failure_time, futures.weights
    if terms.accepted is not None:
        return last_order_by_probability(failing, weights, terms.access, terms.accepted)
    cost = np.append(items @ prices, (never @ prices)[:, None], axis=1)
    return last_order_by_cost(futures.time, cost, failing, weights, terms.access)


def _window(futures: Ensemble, given: float) -> int:
    """Give the steps of the window of P_f; by default a twelfth of the horizon."""
    last = len(futures.time) - 1
    step = futures.time[1]
    return int(np.clip(round(given / step) if given > 0 else round(last / 12), 1, last))


def _planned(
    futures: Ensemble, costs: Costs, follow: Follow
) -> tuple[Float[np.ndarray, "path time item"], Float[np.ndarray, "path item"]]:
    """Items of a repair at each time, and of none."""
    cdf = np.minimum(futures.failure_cdf(), 1.0)
    share = np.clip(futures.damage, 0.0, 1.0)[..., None]
    after_repair = (1.0 - share) * follow.new[::-1] + share * follow.worn[::-1]
    new = np.broadcast_to(follow.new[::-1], (1, *follow.new.shape))
    items = repair_items(futures.time, cdf, costs, after_repair, new)
    return items, never_items(futures.time, cdf, costs, new)


def _actions(
    futures: Ensemble,
    items: Float[np.ndarray, "path time item"],
    never: Float[np.ndarray, "path item"],
    follow: Follow,
) -> Actions:
    time = futures.time
    planned = futures.access.planned_index(time)[_denser_at_first(len(time), LATER)]
    index = np.unique(planned[planned < len(time)])
    every = np.concatenate([items[:, index], never[:, None]], axis=1)
    cycles = tuple(at_age(futures, k) for k in (*index.tolist(), len(futures.time)))
    return Actions(cycles, every, follow, (*index.tolist(), len(futures.time)))


class _Left:
    """What may be done after an observation at a time: repairs planned, or rules followed."""

    def __init__(
        self, futures: Ensemble, costs: Costs, error: EstimateError, planned: Actions
    ) -> None:
        self._futures, self._costs, self._planned = futures, costs, planned
        self._estimates = error.of(futures)
        self._kept: dict[int, Actions] = {}

    def since(self, index: int) -> Actions:
        """Planned repairs from an index on, and thresholds on the estimate from it on."""
        if index not in self._kept:
            first = self._futures.access.effect_index(self._futures.time)[index]
            left = self._planned.since(int(first))
            seen = self._estimates.copy()
            seen[:, :index] = -np.inf
            cycles = [at_estimate(self._futures, level, seen) for level in LEVELS_AFTER]
            more = [per_path(c, self._futures, self._costs, left.follow) for c in cycles]
            items = np.concatenate([left.items, np.stack(more, axis=1)], axis=1)
            self._kept[index] = Actions((*left.cycles, *cycles), items, left.follow)
        return self._kept[index]


def _least(
    options: Sequence[Option], futures: Ensemble, prices: Float[np.ndarray, " item"]
) -> float:
    return min(float(each.quantities(futures.weights) @ prices) for each in options)


def _denser_at_first(count: int, parts: int) -> Int[np.ndarray, " index"]:
    """Give indices from 0 to the last, denser at first, where decisions are near."""
    return np.unique(
        np.round((count - 1) * np.linspace(0.0, 1.0, parts + 1) ** 1.5).astype(int)
    )


def _repairs(
    futures: Ensemble,
    items: Float[np.ndarray, "path time item"],
    expected: Float[np.ndarray, " time"],
    costs: Costs,
    follow: Follow,
) -> list[Option]:
    """Order a repair now, and at the best later time at which it can take effect."""
    time, access = futures.time, futures.access
    at = access.effect_times(time)
    now = int(access.effect_index(time)[0])
    later = np.flatnonzero(np.isfinite(at) & (np.arange(len(time)) > now))
    chosen: list[tuple[str, Now, int, float]] = []
    if now < len(time):
        chosen.append(("repair_now", "repair", now, access.effect(0.0)))
    if len(later):
        least = float(expected[later].min())
        # Of equal costs the last: waiting forgoes nothing, and readings may tell more.
        same = expected[later] <= least + 1e-9 * abs(least)
        best = int(later[np.flatnonzero(same)[-1]])
        chosen.append(("repair_at", "wait", best, float(at[best])))
    return [
        Option(
            name,
            act,
            items[:, index],
            payments(at_age(futures, index), futures, costs).until(follow),
            {"at": effect, "order": 0.0 if act == "repair" else effect - access.lead},
            np.where(futures.failure_time > time[index], effect, np.inf),
        )
        for name, act, index, effect in chosen
    ]


def _closings(futures: Ensemble, costs: Costs, follow: Follow) -> list[Option]:
    """Close for good, and until a repair that is ordered now, where that takes some time."""
    last = len(futures.time) - 1
    curve = _closed_until(last, futures, costs)
    options = [Option("close", "close", np.repeat(curve[-1:], len(futures.weights), 0), curve)]
    done = int(futures.access.effect_index(futures.time)[0])
    if 0 < done <= last:
        options.append(_closed_for_repair(done, futures, costs, follow))
    return options


def _closed_until(
    index: int, futures: Ensemble, costs: Costs
) -> Float[np.ndarray, "time item"]:
    """Give discounted items of being closed from now to the time of an index."""
    time = np.minimum(futures.time, futures.time[index])
    weight = discount(time, costs.discount_rate)
    steps = (weight[1:] + weight[:-1]) / 2 * np.diff(time)
    curve = np.zeros((len(time), len(ITEMS)))
    curve[:, CLOSING], curve[1:, CLOSED] = 1.0, np.cumsum(steps)
    return curve


def _closed_for_repair(done: int, futures: Ensemble, costs: Costs, follow: Follow) -> Option:
    """Close now, repair at the first possible time, and reopen.

    What is closed does not fail, but its damage goes on as in the futures. Futures that have
    failed by now are renewed at once.
    """
    failed = futures.failure_time <= 0.0
    cycle = Cycle(np.where(failed, 0, done), failed)
    closed = _closed_until(done, futures, costs)
    effect = futures.access.effect(0.0)
    return Option(
        "close_until_repair",
        "close",
        per_path(cycle, futures, costs, follow) + ~failed[:, None] * closed[-1],
        payments(cycle, futures, costs).until(follow) + futures.weights @ ~failed * closed,
        {"at": effect, "order": 0.0},
        np.where(failed, np.inf, effect),
    )


def _inspections(
    futures: Ensemble, costs: Costs, inspection: Observation, actions: _Left
) -> list[Option]:
    """Inspect now, and at the best later time; then do what is best by what is found."""
    later = _denser_at_first(len(futures.time), INSPECTIONS)[1:-1].tolist()
    prices = costs.prices()
    found = [_inspected(futures, costs, inspection, actions, index) for index in (0, *later)]
    expected = [float(futures.weights @ (items @ prices)) for items, _, _ in found]
    best = 1 + int(np.argmin(expected[1:])) if later else 0
    options = []
    for place in sorted({0, best}):
        index = (0, *later)[place]
        items, taken, changes = found[place]
        given = {"at": float(futures.time[index]), "changes": changes}
        options.append(
            Option(
                "inspect_at" if place else "inspect_now",
                "wait" if place else "inspect",
                items,
                _curve_after(futures, costs, actions.since(index), taken, index),
                given,
            )
        )
    return options


def _inspected(
    futures: Ensemble, costs: Costs, inspection: Observation, actions: _Left, index: int
) -> tuple[Float[np.ndarray, "path item"], Float[np.ndarray, "path action"], float]:
    """Items of each future, the probability of each action, and that another one is taken."""
    items, taken, changes = _decided(futures, costs, inspection, actions, index)
    return items + _of_inspection(futures, costs, index), taken, changes


def _decided(
    futures: Ensemble, costs: Costs, observation: Observation, actions: _Left, index: int
) -> tuple[Float[np.ndarray, "path item"], Float[np.ndarray, "path action"], float]:
    """Give the same of what is decided after an observation, without what that costs."""
    left, weights = actions.since(index), futures.weights
    likelihood = likelihood_of(observation, index, futures.time, futures.damage, weights)
    found = value_of_information(left.items @ costs.prices(), weights, likelihood)
    taken = np.zeros((len(weights), len(left.cycles)))
    for outcome, action in enumerate(found.actions.tolist()):
        taken[:, action] += likelihood[:, outcome]
    items = np.einsum("pa,pai->pi", taken, left.items)
    return items, taken, float(found.changes)


def _readings(
    futures: Ensemble,
    costs: Costs,
    terms: Terms,
    actions: _Left,
    last_order: float,
    waiting: float,
) -> list[Option]:
    """Take the readings that come anyway, and decide by what they show: the best count.

    Readings end by the last order that is in time. Where they save nothing against `waiting`,
    the least cost of an option that waits without them, they are no option.
    """
    best: Option | None = None
    least = waiting - LEAST_GAIN * abs(waiting)
    prices = costs.prices()
    end = futures.time[futures.time <= max(last_order, 0.0) * (1 + 1e-9)][-1]
    for given in terms.observations:
        one = _in_time(given, float(end))
        index = index_of(one, futures.time)
        if one.kind != "readings" or one.cost > 0.0 or not 0 < index < len(futures.time) - 1:
            continue
        items, taken, changes = _decided(futures, costs, one, actions, index)
        mean = float(futures.weights @ (items @ prices))
        if mean < least:
            least = mean
            parameters = {"at": float(futures.time[index]), "changes": changes}
            curve = _curve_after(futures, costs, actions.since(index), taken, None)
            best = Option("read_on", "wait", items, curve, parameters)
    return [] if best is None else [best]


def _in_time(one: Observation, end: float) -> Observation:
    """Leave out the readings after a time."""
    if one.count * one.every <= end:
        return one
    # A quotient that is whole but for rounding is that whole number.
    return dataclasses.replace(one, count=int(end / one.every * (1 + 1e-9)))


def _of_inspection(
    futures: Ensemble, costs: Costs, index: int
) -> Float[np.ndarray, "path item"]:
    at = futures.time[index : index + 1]
    alive = (futures.failure_time > at[0]) | (index == 0)
    own = discount(at, costs.discount_rate) * costs.event(INSPECTION)
    return np.asarray(alive[:, None] * own)


def _curve_after(
    futures: Ensemble,
    costs: Costs,
    left: Actions,
    taken: Float[np.ndarray, "path action"],
    inspected: int | None,
) -> Float[np.ndarray, "time item"]:
    """Give expected items until each time: those of each action where it is taken.

    `inspected` is the index of the time of an inspection, None without one.
    """
    found = np.zeros((len(futures.time), len(ITEMS)))
    for column, cycle in enumerate(left.cycles):
        shares = futures.weights * taken[:, column]
        total = float(shares.sum())
        if total > 0.0:
            some = dataclasses.replace(futures, weights=shares / total)
            found += total * payments(cycle, some, costs).until(left.follow)
    if inspected is not None:
        found[inspected:] += futures.weights @ _of_inspection(futures, costs, inspected)
    return found


def _worths(
    futures: Ensemble, costs: Costs, terms: Terms, actions: _Left, least: float
) -> list[tuple[Worth, ...]]:
    """Give of each observation what it is worth at each time, the inspection first."""
    asked = list(terms.observations)
    if terms.inspection is not None:
        priced = dataclasses.replace(terms.inspection, cost=costs.price(INSPECTION))
        asked.insert(0, priced)
    prices, found = costs.prices(), []
    later = _denser_at_first(len(futures.time), INSPECTIONS)[:-1].tolist()
    used = {*later, *(index_of(one, futures.time) for one in asked if one.kind == "readings")}
    # What could be done later without any observation is not to its credit.
    priors = [float((futures.weights @ (actions.since(k).items @ prices)).min()) for k in used]
    least = min(least, *priors)
    for one in asked:
        places = [index_of(one, futures.time)] if one.kind == "readings" else later
        each = tuple(
            worth(
                one,
                index,
                futures.time,
                futures.damage,
                futures.weights,
                actions.since(index),
                prices,
                least,
                float(np.exp(-costs.discount_rate * futures.time[index])),
            )
            for index in places
        )
        found.append(each)
    return found


def _net(one: Worth) -> float:
    return one.net
