"""What plans with a lead time cost on histories of known laws, beside an oracle's.

`python -m benchmarks.methods.calibration.orders --results FILE` goes on where FILE ends. At
sixteenths of each history, from a half on, it is decided whether to order a repair, which takes
effect a lead time later: by the twin's futures, by those of an oracle that is told the family
of the law, and by the twin's futures as if a repair took effect at once. All three
decide by `slowtime.decisions.make_plan`. A repair costs 1, a failure before it takes effect
costs RATIO; an account ends with the first of both.
"""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from slowtime.decisions import (
    Access,
    Cost,
    Costs,
    Ensemble,
    EstimateError,
    Observation,
    Plan,
    Terms,
    from_paths,
    make_plan,
)
from twin_server.estimate.forecast import changes
from twin_server.estimate.plans.plan import MEMORY, MORE, PlanOrder, damage_futures
from twin_server.registration.costs import CostTable, Deciding

from . import histories, oracle
from .bench import QUANTITY, keep, read
from .histories import LAWS, InstantCase

LEAD = 0.1
"""Share of a history [1] from an order to its effect."""

RATIO = 10.0
"""Cost of a failure over that of a repair [1]."""

DATES = tuple(0.5 + k / 16 for k in range(8))
"""Shares of a history at which it is decided."""

TARGET = 1.1
"""Mean cost over the oracle's [1] that the plan is held to."""

COSTS = Costs(failure=Cost(RATIO), repair=Cost(1.0))
WHO = ("plan", "oracle", "without lead")


def judge(case: InstantCase) -> dict[str, Any]:
    """Give what each pays in one history, and when it orders."""
    result: dict[str, Any] = {"law": case.law, "number": case.number}
    result["crossed"] = case.crossed if np.isfinite(case.crossed) else None
    waiting, told = set(WHO), {}
    for which, date in enumerate(DATES):
        readings = int(np.searchsorted(case.time, date + 1e-12, "right"))
        now = float(case.time[readings - 1])
        if not waiting or case.crossed <= now:
            break
        twin = _of_twin(case, readings) if waiting - {"oracle"} else None
        for who in sorted(waiting):
            if who == "oracle":
                futures = _of_oracle(case, readings, which)
            else:
                assert twin is not None
                futures = twin
            plan = _plan(futures, case, 0.0 if who == "without lead" else LEAD)
            if plan.best.now == "repair":
                told[who] = now
                waiting.discard(who)
    return result | {who: paid(case, told.get(who)) for who in WHO} | {"ordered": told}


def paid(case: InstantCase, ordered: float | None) -> float:
    """Give the cost of a history in which a repair was ordered at a time, or never."""
    effect = np.inf if ordered is None else ordered + LEAD
    if case.crossed <= min(effect, 1.0):
        return RATIO
    return 1.0 if effect <= 1.0 else 0.0


def with_foresight(case: dict[str, Any]) -> float:
    """Give the least that a history can cost: one who knows the time of the crossing."""
    crossed = case["crossed"]
    if crossed is None:
        return 0.0
    return 1.0 if crossed > DATES[0] + LEAD else RATIO


def _plan(futures: Ensemble, case: InstantCase, lead: float) -> Plan:
    spread, every = float(np.std(futures.damage[:, 0])), float(case.time[1])
    more = tuple(
        Observation(
            name="readings",
            kind="readings",
            sd=case.sd / abs(case.threshold),
            count=count,
            every=every,
        )
        for count in MORE
        if count * every <= futures.horizon / 2
    )
    terms = Terms(
        error=EstimateError(spread, MEMORY * every),
        access=Access(lead=lead),
        observations=more,
    )
    return make_plan(futures, COSTS, terms)


def _sound(time: np.ndarray) -> Ensemble:
    """Give a repaired asset, which does not fail again within a history."""
    return from_paths(time, np.zeros((2, len(time))))


def _of_twin(case: InstantCase, readings: int) -> Ensemble:
    """Give the futures that the server makes its plans of, in shares of the history."""
    past = {
        QUANTITY: changes.Past(
            case.time[:readings] * case.unit,
            case.value[:readings],
            np.full(readings, case.sd),
            0.0,
        )
    }
    state = changes.forecast_state_of(past, changes.learn(past))
    assert state is not None
    now = float(case.time[readings - 1])
    table = CostTable(time_unit="slow_time", failure=RATIO, repair=1.0)
    limit = {"quantity": QUANTITY, "below": case.threshold}
    decision = Deciding.model_validate({"failure": limit, "horizon": (1.0 - now) * case.unit})
    order = PlanOrder(
        table, decision, state.laws[QUANTITY], state.common[QUANTITY], case.sd,
        case.unit * float(case.time[1]), None, now * case.unit,
    )  # fmt: skip
    found = damage_futures(order, 1.0)
    time = found.time / case.unit
    return dataclasses.replace(
        found, time=time, failure_time=found.failure_time / case.unit,
        renewed=lambda _: _sound(time),
    )  # fmt: skip


def _of_oracle(case: InstantCase, readings: int, which: int) -> Ensemble:
    rng = np.random.default_rng([case.number, which])
    drawn = oracle.futures(case, readings, rng)
    time = drawn.time - drawn.time[0]
    grid = np.linspace(0.0, time[-1], 121)
    damage = np.array([np.interp(grid, time, path) for path in drawn.paths]) / case.threshold
    first = from_paths(grid, damage, renewed=lambda _: _sound(grid))
    # A rough path may have failed between two times at which it has not.
    above = drawn.paths - case.threshold
    product = np.maximum(above[:, 1:] * above[:, :-1], 0.0)
    rough = np.maximum(drawn.roughness[:, None] * np.diff(time), 1e-300)
    with np.errstate(over="ignore"):
        chance = np.where(drawn.roughness[:, None] > 0.0, np.exp(-2.0 * product / rough), 0.0)
    touched = rng.random(chance.shape) < chance
    at = np.where(touched.any(axis=1), time[1:][touched.argmax(axis=1)], np.inf)
    return dataclasses.replace(first, failure_time=np.minimum(first.failure_time, at))


def table(results: list[dict[str, Any]]) -> tuple[str, float]:
    """Write what each law costs, and give the ratio of all."""
    lines = [
        "| law | histories | fail without a repair | plan | oracle | plan over oracle "
        "| plan without lead time | with foresight | orders: plan, oracle "
        "| failures: plan, oracle, without lead time |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    ratio = np.nan
    for name in (*LAWS, "all"):
        part = [one for one in results if name in (one["law"], "all")]
        if not part:
            continue
        mean = {who: float(np.mean([one[who] for one in part])) for who in WHO}
        failed = {who: sum(one[who] == RATIO for one in part) for who in WHO}
        orders = [sum(who in one["ordered"] for one in part) for who in WHO[:2]]
        ratio = mean["plan"] / mean["oracle"] if mean["oracle"] else np.nan
        shown = f"{ratio:.2f}" if mean["oracle"] else ""
        lines.append(
            f"| {name} | {len(part)} | {sum(one['crossed'] is not None for one in part)} "
            f"| {mean['plan']:.2f} | {mean['oracle']:.2f} | {shown} "
            f"| {mean['without lead']:.2f} | {np.mean([*map(with_foresight, part)]):.2f} "
            f"| {orders[0]}, {orders[1]} "
            f"| {failed['plan']}, {failed['oracle']}, {failed['without lead']} |"
        )
    return "\n".join(lines), ratio


def interval_of(results: list[dict[str, Any]], draws: int = 4000) -> tuple[float, float]:
    """Give the 5 and 95 % ends of the ratio of mean costs, by resampling histories."""
    cost = np.array([[one["plan"], one["oracle"]] for one in results])
    rows = np.random.default_rng(0).integers(0, len(cost), (draws, len(cost)))
    sums = cost[rows].sum(axis=1)
    low, high = np.quantile(sums[:, 0] / np.maximum(sums[:, 1], 1e-9), [0.05, 0.95])
    return float(low), float(high)


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, and print the table; 1 where the plan costs more than it may."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, help="file of results to go on with")
    parser.add_argument("--histories", type=int, default=14, help="of each law")
    parser.add_argument("--laws", nargs="*", default=list(LAWS), choices=LAWS)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    found = read(asked.results) if asked.results else {}
    wanted = [(law, number) for number in range(asked.histories) for law in asked.laws]
    for law, number in wanted:
        if (law, number) not in found:
            found[law, number] = judge(histories.case(law, number, asked.seed))
            if asked.results:
                keep(found[law, number], asked.results)
    shown = [found[key] for key in wanted]
    text, ratio = table(shown)
    low, high = interval_of(shown)
    print(f"{text}\n\nPlan over oracle: {ratio:.3f} (5 to 95 %: {low:.2f} to {high:.2f}).")
    return 0 if ratio <= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
