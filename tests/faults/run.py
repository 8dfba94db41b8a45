"""One seed: faults as scheduled, peace, the account, and a comparison with a quiet life."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .harm import Undo, inflict
from .history import databases, differences, look, rivals
from .house import House
from .ledger import Verdict, judge
from .schedule import ASSETS, Plan

CALM_S = 4.0
"""How long the edges go on once nothing goes wrong any more: what follows shows what lacks."""

PEACE_S = 90.0
"""How long everything may take to heal once nothing goes wrong any more."""


class Outcome(NamedTuple):
    """How a seed has ended."""

    plan: Plan
    verdict: Verdict | None
    faults: list[str]
    said: list[str]
    healed_s: float

    @property
    def line(self) -> str:
        """One line for the log."""
        found = self.verdict
        account = (
            f"{found.made} made, {found.accepted} in history, {found.lost} reported lost"
            if found
            else "no account"
        )
        return (
            f"seed {self.plan.seed}: {'; '.join(self.faults) or 'sound'} ({account}, "
            f"{len(self.plan.faults)} faults, {self.plan.time_base}, healed in "
            f"{self.healed_s:.1f} s)"
        )


def run(plan: Plan, home: Path, database: str | None = None) -> Outcome:
    """Run a plan in the folder `home`."""
    home.mkdir(parents=True, exist_ok=True)
    database = database or str(home / "twin.sqlite")
    house = House(plan, home, database)
    verdict, faults, healed_s = None, [], 0.0
    try:
        house.open()
        _suffer(house)
        parts = databases(database, plan.shards)
        verdict, healed_s = _heal(house, parts)
        faults = verdict.faults
        if verdict.lost and not plan.may_lose:
            faults.append(f"{verdict.lost} lost, and nothing in the schedule excuses it")
        faults += rivals(parts)
        if verdict.accepted == 0 and plan.seconds >= 5:
            faults.append("nothing arrived at all")
        statuses = house.end()
        faults += [f"{name} ended with {s}" for name, s in statuses.items() if s != 0]
        if not faults:
            faults += differences(database, plan.shards, home / "quiet.sqlite")
    except Exception as error:
        faults.append(f"the harness failed: {error!r}")
    finally:
        house.close()
    return Outcome(plan, verdict, faults, house.said, healed_s)


def _suffer(house: House) -> None:
    """Begin and end each fault at its time; start again who ended by himself."""
    order = itertools.count()
    due = [(fault.at_s, next(order), fault, None) for fault in house.plan.faults]
    agenda: list[tuple[float, int, object, Undo | None]] = [*due]
    heapq.heapify(agenda)
    began_s = time.monotonic()
    while (now_s := time.monotonic() - began_s) < house.plan.seconds or agenda:
        while agenda and agenda[0][0] <= now_s:
            _, _, fault, undo = heapq.heappop(agenda)
            if undo is None:
                undo = inflict(fault, house)  # type: ignore[arg-type]
                end_s = now_s + fault.for_s  # type: ignore[attr-defined]
                heapq.heappush(agenda, (end_s, next(order), fault, undo))
            else:
                undo()
        house.tend()
        wait_s = min(0.5, agenda[0][0] - now_s if agenda else 0.5)
        time.sleep(max(0.01, wait_s))


def _heal(house: House, parts: list[str]) -> tuple[Verdict, float]:
    """Go on for a little, then wait until the account is whole, or patience ends."""
    calm_s = time.monotonic() + CALM_S
    while time.monotonic() < calm_s:
        house.tend()
        time.sleep(0.2)
    for rate in house.rates.values():
        rate.value = 0.0
    began_s = time.monotonic()
    while True:
        house.tend()
        time.sleep(0.5)
        verdict = judge(house.ledger, look(parts))
        took_s = time.monotonic() - began_s
        whole = not verdict.faults and took_s > 2.0
        peace_s = PEACE_S * (1 + len(house.shards))  # each of which may have to start again
        if (whole and all(map(house.alive, ("twin", *ASSETS)))) or took_s > peace_s:
            return verdict, took_s


def run_many(
    plans: list[Plan],
    home: Path,
    jobs: int,
    tell: object,
    database: Callable[[Plan], str | None] = lambda plan: None,
) -> list[Outcome]:
    """Run plans, so many at a time; most of the time all of them wait."""
    outcomes: list[Outcome] = []
    left = iter(plans)
    lock = threading.Lock()

    def work() -> None:
        while True:
            with lock:
                plan = next(left, None)
            if plan is None:
                return
            outcome = run(plan, home / str(plan.seed), database(plan))
            with lock:
                outcomes.append(outcome)
                tell(outcome)  # type: ignore[operator]

    workers = [threading.Thread(target=work) for _ in range(jobs)]
    for worker in workers:
        worker.start()
        time.sleep(0.7)
    for worker in workers:
        worker.join()
    return outcomes
