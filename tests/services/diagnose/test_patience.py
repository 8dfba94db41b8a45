"""When a diagnosis is told that its budget is nearly used up, and when that it is."""

import dataclasses
import types

import numpy as np
import pytest

from slowtime.discrepancy.time_limit import TimeLimit, limited
from slowtime.dynamics.builders import chain
from slowtime.dynamics.description import Input
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import SIMULATION_WORK, STEP_WORK, count_work, metered
from slowtime_services.diagnose import run


class Told(Exception):
    """What the search was told is known; the rest of it is not run."""


@pytest.fixture
def told(monkeypatch):
    """Give what the search is told at shares of its budget of work, and of the clock's."""

    def of(work_shares, *, clock_share=0.0, patience_s=10.0, masses=1):
        now, seen = [5.0], []
        clock = types.SimpleNamespace(monotonic=lambda: 0.0, thread_time=lambda: now[0])

        def diagnose(_, **how):
            now[0] += clock_share * run.LAST_STOP * patience_s
            done = 0
            for share in work_shares:
                target = int(share * run.WORK_PER_S * patience_s)
                count_work(target - done)
                done = target
                seen.append((how["late"](), how["over"]()))
            raise Told

        monkeypatch.setattr(run, "time", clock)
        monkeypatch.setattr(run, "compiling_s", lambda: 0.0)
        monkeypatch.setattr(run, "gather", lambda *_: types.SimpleNamespace(campaign=None))
        monkeypatch.setattr(run, "diagnose", diagnose)
        rig = chain([1.0] * masses, [1.0] * masses)
        with pytest.raises(Told):
            run.diagnose_records(rig, [], patience_s=patience_s, unchecked=True)
        return seen

    return of


def test_it_is_late_before_it_is_over_by_work_that_is_counted(told):
    shares = (0.0, 0.69, 0.71, 0.99, 1.01)
    assert told(shares) == [
        (False, False), (False, False), (True, False), (True, False), (True, True),
    ]  # fmt: skip


def test_a_slow_machine_changes_nothing_before_the_last_stop(told):
    assert told((0.0, 0.5), clock_share=0.99) == [(False, False), (False, False)]
    assert told((0.0, 0.5), clock_share=1.01) == [(True, True), (True, True)]


def test_a_shorter_patience_bounds_the_report_as_well(told, monkeypatch):
    limits: list[TimeLimit] = []

    def kept(limit):
        limits.append(limit)
        return limited(limit)

    monkeypatch.setattr(run, "limited", kept)
    for patience_s, share in ((0.1 * run.PATIENCE_S, 0.1), (5 * run.PATIENCE_S, 1.0)):
        told((0.0,), clock_share=1.01, patience_s=patience_s)
        limit = limits.pop()
        assert limit.is_reached()
        assert limit.budget_share == pytest.approx(share)
        told((0.0,), clock_share=0.99, patience_s=patience_s)
        assert not limits.pop().is_reached()


@pytest.mark.parametrize(("masses", "times"), [(1, 1), (3, 1), (4, 4 / 3), (5, 5 / 3), (30, 2)])
def test_more_masses_have_a_larger_budget_up_to_twice(masses, times):
    rig = chain([1.0] * masses, [1.0] * masses)
    assert run.patience_for(rig) == pytest.approx(times * run.PATIENCE_S)


def test_runs_of_a_plant_are_counted_by_steps_states_and_derivatives():
    rig = dataclasses.replace(
        chain([1.0], [100.0]), inputs=(Input(channel="u", kind="force", node="m1", unit="N"),)
    )
    plant, push = Plant.of(rig), np.ones((200, 1))
    with metered() as plain:
        plant.states(plant.values, push, 100.0)
    with metered() as twice:
        plant.states(plant.values, np.ones((400, 1)), 100.0)
    steps, more = (meter.spent - SIMULATION_WORK for meter in (plain, twice))
    assert steps >= 199 * (STEP_WORK + 2)
    assert more == pytest.approx(2 * steps, rel=0.02)
