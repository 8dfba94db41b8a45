"""One seed: faults as scheduled, peace, the account, and a comparison with a quiet life."""

import contextlib
import heapq
import itertools
import json
import sqlite3
import threading
import time
from pathlib import Path
from typing import NamedTuple

from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample
from slowtime_services.clock import HandClock
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

from .harm import Undo, inflict
from .house import House
from .ledger import Key, Seen, Verdict, judge
from .schedule import ASSETS, Plan

CALM_S = 4.0
"""How long the edges go on once nothing goes wrong any more: what follows shows what lacks."""

PEACE_S = 90.0
"""How long everything may take to heal once nothing goes wrong any more."""

LATER_NS = 4 * 10**18
"""Far in the future: the quiet life judges no clock a second time."""


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
        verdict, healed_s = _heal(house)
        faults = verdict.faults
        if verdict.lost and not plan.may_lose:
            faults.append(f"{verdict.lost} lost, and nothing in the schedule excuses it")
        if verdict.accepted == 0 and plan.seconds >= 5:
            faults.append("nothing arrived at all")
        statuses = house.end()
        faults += [f"{name} ended with {s}" for name, s in statuses.items() if s != 0]
        if not faults:
            faults += differences(Path(database), home / "quiet.sqlite")
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


def _heal(house: House) -> tuple[Verdict, float]:
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
        verdict = judge(house.ledger, look(house.database))
        took_s = time.monotonic() - began_s
        whole = not verdict.faults and took_s > 2.0
        if (whole and all(map(house.alive, ("twin", *ASSETS)))) or took_s > PEACE_S:
            return verdict, took_s


def look(database: str) -> Seen:
    """Read history and losses straight from the database, by other code than the server's."""
    history: list[tuple[Key, bytes]] = []
    lost: list[tuple[str, str, int, int, str]] = []
    with contextlib.suppress(sqlite3.OperationalError):
        with contextlib.closing(
            sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=5.0)
        ) as reader:
            for asset, boot, sequence, message in reader.execute(
                "select asset, boot, id & ((1 << 40) - 1), message from features "
                "join runs on number = id >> 40"
            ):
                history.append(((asset, boot, sequence), bytes(message)))
            for asset, body in reader.execute("select asset, body from events"):
                event = json.loads(body)
                if event["kind"] == "features_lost":
                    why = event["details"]
                    lost.append((asset, why["boot"], why["first"], why["last"], why["why"]))
    return Seen(history, lost)


def differences(database: Path, quiet: Path) -> list[str]:
    """Give the same features to a server that nothing ever happens to; say what differs."""
    suffered, calm = SqliteStore(database), SqliteStore(quiet)
    try:
        pipeline = Pipeline(TwinSettings(), calm, clock=HandClock(LATER_NS))
        for asset in ASSETS:
            rows = suffered.messages(f"lab.{asset}", (0, -1), 10**9)
            key = FEATURES.key("lab", asset)
            pipeline.ingest(Sample(key, row.message, None, True) for row in rows)
        pipeline.give_up()
        found = []
        for asset in ASSETS:
            twin_id = f"lab.{asset}"
            for what, ours, theirs in (
                ("states", suffered.digest(twin_id), calm.digest(twin_id)),
                ("checkpoint", suffered.twin(twin_id), calm.twin(twin_id)),
                ("events", _derived(suffered, twin_id), _derived(calm, twin_id)),
            ):
                if ours != theirs:
                    found.append(f"{what} of {twin_id} differ from those of a quiet life")
        return found
    finally:
        suffered.close()
        calm.close()


def _derived(store: SqliteStore, twin_id: str) -> list[str]:
    return [event.body for event in store.events(twin_id, limit=10**6) if event.derived]


def run_many(plans: list[Plan], home: Path, jobs: int, tell: object) -> list[Outcome]:
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
            outcome = run(plan, home / str(plan.seed))
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
