"""Standing policies side by side: each tuned on the futures, with its own continuation."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from . import rules
from .continuation import Cycle, Follow, Payments, follow_of, payments, per_path
from .costs import REPAIR, Costs, discount
from .ensemble import Ensemble
from .option import Option
from .rules import EstimateError

LEVELS = (0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)
"""Thresholds on the estimate [1 at failure] among which the best is sought."""

PROBABILITIES = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""Thresholds on the probability of a failure within the window."""

INSPECTED_LEVELS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
PARTS = 24
"""Into how many steps the horizon is divided for ages and intervals; inspections half."""

Rule = Callable[[Ensemble], Cycle]


@dataclasses.dataclass(frozen=True, slots=True)
class Starts:
    """Futures now, of a new asset, and of one repaired from a damage of 1 (None: as new)."""

    now: Ensemble
    new: Ensemble
    worn: Ensemble | None

    @classmethod
    def of(cls, futures: Ensemble, restored: float) -> "Starts":
        """Make the futures that repairs lead to.

        Parameters
        ----------
        futures
            Futures of the asset from now on.
        restored
            Share of the damage that a repair takes away [1]; a failure always ends in a new
            asset.

        Returns
        -------
        Futures from now, of a new asset, and of one repaired from a damage of 1.
        """
        later = futures.access.on_average(futures.horizon)

        def after(start: float) -> Ensemble:
            return dataclasses.replace(futures.after_repair(start), access=later)

        return cls(futures, after(0.0), None if restored >= 1.0 else after(1.0 - restored))

    def follow(self, rule: Rule, costs: Costs) -> Follow:
        """V of a rule."""
        new = payments(rule(self.new), self.new, costs)
        worn = None if self.worn is None else payments(rule(self.worn), self.worn, costs)
        return follow_of(new, worn)


@dataclasses.dataclass(frozen=True, slots=True)
class Standing:
    """A standing policy with the option it makes from now on, and V after a renewal."""

    option: Option
    follow: Follow


def standing_policies(
    starts: Starts,
    costs: Costs,
    error: EstimateError,
    *,
    window: int,
    inspection_sd: float | None,
) -> list[Standing]:
    """Best standing policy of each kind, such as by age, by interval or by threshold.

    Parameters
    ----------
    starts
        Futures from now, of a new asset, and of one repaired from a damage of 1.
    error
        Of the estimate by which thresholds act.
    window
        Steps within which a failure counts for the threshold on P_f.
    inspection_sd
        Error of an inspection [1]; None where none can be ordered.
    """
    count = len(starts.now.time)
    steps = sorted({max(1, round(k * (count - 1) / PARTS)) for k in range(1, PARTS + 1)})
    seen = {id(each): error.of(each) for each in _each(starts)}
    found = [_best("nothing", starts, costs, [({}, rules.run_to_failure)])]
    found.append(
        _best(
            "age",
            starts,
            costs,
            [({"age": float(starts.now.time[k])}, _age(k)) for k in steps],
        )
    )
    found += _fixed_interval(starts, costs, _possible(starts.now, steps))
    found.append(_thresholds(starts, costs, seen))
    levels: list[tuple[dict[str, float], Rule]] = []
    for chance in PROBABILITIES:
        level = rules.threshold_of_probability(starts.new, seen[id(starts.new)], chance, window)
        if np.isfinite(level):
            told = {"probability": chance, "damage": level}
            told["window"] = float(starts.now.time[window])
            levels.append((told, _level(level, seen)))
    if levels:
        found.append(_best("probability_threshold", starts, costs, levels))
    if inspection_sd is not None:
        measured = {id(each): EstimateError(inspection_sd, seed=error.seed + 1).of(each)
                    for each in _each(starts)}  # fmt: skip
        found.append(
            _best("periodic_inspection", starts, costs, [
                ({"every": float(starts.now.time[k]), "damage": level},
                 _inspection(k, level, measured))
                for k in steps[: PARTS // 2 : 2] for level in INSPECTED_LEVELS
            ])
        )  # fmt: skip
    return found


def threshold_policy(starts: Starts, costs: Costs, error: EstimateError) -> Standing:
    """Give the best threshold on the estimate."""
    return _thresholds(starts, costs, {id(each): error.of(each) for each in _each(starts)})


def _thresholds(
    starts: Starts, costs: Costs, seen: Mapping[int, Float[np.ndarray, "path time"]]
) -> Standing:
    candidates = [({"damage": level}, _level(level, seen)) for level in LEVELS]
    return _best("estimate_threshold", starts, costs, candidates)


def _each(starts: Starts) -> Iterable[Ensemble]:
    return [one for one in (starts.now, starts.new, starts.worn) if one is not None]


def _age(index: int) -> Rule:
    return lambda futures: rules.at_age(futures, index)


def _level(level: float, seen: Mapping[int, Float[np.ndarray, "path time"]]) -> Rule:
    return lambda futures: rules.at_estimate(futures, level, seen[id(futures)])


def _inspection(
    every: int, level: float, measured: Mapping[int, Float[np.ndarray, "path time"]]
) -> Rule:
    return lambda futures: rules.by_inspection(futures, every, level, measured[id(futures)])


def _best(
    name: str,
    starts: Starts,
    costs: Costs,
    candidates: Iterable[tuple[dict[str, float], Rule]],
) -> Standing:
    """Choose the parameters of least expected cost from now on."""
    best: tuple[float, dict[str, float], Cycle, Payments, Follow] | None = None
    prices = costs.prices()
    for parameters, rule in candidates:
        cycle, follow = rule(starts.now), starts.follow(rule, costs)
        spent = payments(cycle, starts.now, costs)
        cost = float(spent.until_horizon(follow) @ prices)
        if best is None or cost < best[0]:
            best = cost, parameters, cycle, spent, follow
    assert best is not None
    _, parameters, cycle, spent, follow = best
    now = cycle.end == 0 if cycle.ordered is None else cycle.ordered == 0
    # What is done now is done where it has not failed yet.
    alive = ~(cycle.failed & (cycle.end == 0))
    repairs = bool(alive.any() and np.mean(now[alive]) > 0.5)
    option = Option(
        name,
        "repair" if repairs else "wait",
        per_path(cycle, starts.now, costs, follow),
        spent.until(follow),
        parameters,
        _repair_time(cycle, starts.now),
    )
    return Standing(option, follow)


def _repair_time(cycle: Cycle, futures: Ensemble) -> Float[np.ndarray, " path"]:
    """Time of the planned repair that ends each cycle; infinite where none does."""
    times = np.append(futures.time, np.inf)[cycle.end]
    return np.where(cycle.failed, np.inf, times)


def _possible(futures: Ensemble, steps: Iterable[int]) -> list[int]:
    """Give the intervals of which every multiple can be the time of a repair."""
    can = np.isfinite(futures.access.effect_times(futures.time))
    return [k for k in steps if can[k::k].all()]


def _fixed_interval(starts: Starts, costs: Costs, steps: Sequence[int]) -> list[Standing]:
    """Repair at multiples of an interval from now on, whatever has failed in between."""
    if not steps:
        return []
    failing = starts.follow(rules.run_to_failure, costs)
    first = payments(rules.run_to_failure(starts.now), starts.now, costs).until(failing)
    weight = discount(starts.now.time, costs.discount_rate)
    event, prices = costs.event(REPAIR), costs.prices()
    best = None
    for k in steps:
        # From a repair to the next one; of an imperfect one, from a damage of 1 (the worst).
        value = failing.worn.copy()
        for n in range(k, len(value)):
            value[n] = failing.worn[k] + weight[k] * (event + value[n - k])
        curve = first.copy()
        curve[k:] = first[k] + weight[k] * (event + value[: len(curve) - k])
        cost = float(curve[-1] @ prices)
        if best is None or cost < best[0]:
            best = cost, k, curve, value
    assert best is not None
    _, k, curve, value = best
    items = _until_interval(starts.now, costs, failing, k)
    items = items + weight[k] * (event + value[len(weight) - 1 - k])
    option = Option(
        "fixed_interval",
        "wait",
        items,
        curve,
        {"every": float(starts.now.time[k])},
        np.full(len(items), starts.now.time[k]),
    )
    return [Standing(option, Follow(value, value))]


def _until_interval(
    futures: Ensemble, costs: Costs, failing: Follow, index: int
) -> Float[np.ndarray, "path item"]:
    """Items of each future until the time of `index`, run to failure."""
    cut = dataclasses.replace(
        futures, time=futures.time[: index + 1], damage=futures.damage[:, : index + 1]
    )
    short = Follow(failing.new[: index + 1], failing.worn[: index + 1])
    return per_path(rules.run_to_failure(cut), cut, costs, short)
