"""Forked workers compute what one process computes, and what a lost one left undone."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from slowtime.discrepancy.workers import counted, is_helping, map_shared, shared_among
from slowtime.dynamics.work import count_work, metered
from slowtime_services.engines.forks import ForkedWorkers

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux")
NUMBERS = range(40)


def square(number):
    count_work(number)
    return number**2


@pytest.mark.parametrize("count", [1, 2, 3])
def test_results_and_work_are_those_of_one_process(count):
    with metered() as meter, shared_among(ForkedWorkers(count)):
        assert map_shared(square, NUMBERS) == [number**2 for number in NUMBERS]
    assert meter.spent == sum(NUMBERS)


def test_more_items_than_are_dealt_at_a_time_are_all_computed(monkeypatch):
    monkeypatch.setattr("slowtime_services.engines.forks.MOST_TOKENS", 7)
    with shared_among(ForkedWorkers(2)):
        assert map_shared(square, NUMBERS) == [number**2 for number in NUMBERS]


def test_what_a_killed_process_had_to_do_is_done_by_the_other():
    def fatal_elsewhere(number):
        if is_helping():
            os.kill(os.getpid(), signal.SIGKILL)
        return square(number)

    with metered() as meter, shared_among(ForkedWorkers(3)):
        assert map_shared(fatal_elsewhere, NUMBERS) == [number**2 for number in NUMBERS]
    assert meter.spent == sum(NUMBERS)


def test_the_first_error_in_the_order_of_the_items_is_raised():
    def refuse(number):
        if number in (5, 30):
            raise ValueError(f"not {number}")
        return number

    with shared_among(ForkedWorkers(2)), pytest.raises(ValueError, match="not 5"):
        map_shared(refuse, NUMBERS)


def test_shared_objects_stay_the_same_objects():
    whole = [object(), lambda: None]  # neither can be sent
    found = ForkedWorkers(2).begin(lambda: counted(lambda: whole[1]), whole).result()
    assert found is not None
    assert found[0] is whole[1]


def test_a_process_that_is_lost_has_no_result():
    def fatal():
        os.kill(os.getpid(), signal.SIGKILL)
        return None, 0

    pending = ForkedWorkers(2).begin(fatal, ())
    assert pending.result() is None


def children():
    tasks = Path("/proc/self/task").iterdir()
    return {pid for task in tasks for pid in (task / "children").read_text().split()}


def test_no_process_is_left_behind():
    def endless():
        signal.pause()
        return None, 0

    before = children()
    pending = ForkedWorkers(2).begin(endless, ())
    assert children() > before
    pending.drop()
    assert children() <= before


def test_workers_share_nothing_further():
    with shared_among(ForkedWorkers(2)):
        found = map_shared(lambda _: map_shared(lambda _: is_helping(), range(3)), range(6))
    assert all(len(set(inner)) == 1 for inner in found)


LAW_OF_A_CHILD = """
from slowtime.discrepancy.workers import map_shared, shared_among
from slowtime.dynamics.description import Description, Input, Node, Sensor, Spring
from slowtime.dynamics.plant import Plant
from slowtime_services.engines.forks import ForkedWorkers
import numpy as np

def made(number):
    from slowtime.dynamics.effects import catalogue
    effect = {"effect": "lugre", "element": "s", **catalogue_values(catalogue()["lugre"])}
    plant = Plant.of(Description(
        name="one", nodes=(Node(id="m", mass_kg=1.0),),
        elements=(Spring(id="s", between=("base", "m"), stiffness_n_per_m=100.0),),
        inputs=(Input(channel="u", kind="force", node="m", unit="N"),),
        sensors=(Sensor(channel="a", quantity="acceleration", node="m", unit="m/s^2"),),
        effects=(effect,)))
    plant.simulate(plant.values, np.ones((50, 1)), 100.0)
    return plant.layout

def catalogue_values(kind):
    return {p.name: 1.0 for p in kind.parameters if p.default is None}

with shared_among(ForkedWorkers(2)):
    layouts = map_shared(made, range(4))
# What a process has loaded into its memory is not in what it sends to another.
import dataclasses, pickle
for layout in layouts:
    for field in dataclasses.fields(layout):
        whole = np.asarray(getattr(layout, field.name), dtype=object).ravel()
        numbers = [one for one in whole if isinstance(one, int)]
        assert all(abs(one) < 2**31 for one in numbers), field.name
print("sound")
"""


def test_addresses_of_machine_code_do_not_travel_between_processes():
    told = subprocess.run(
        [sys.executable, "-c", LAW_OF_A_CHILD], capture_output=True, text=True, check=False
    )
    assert told.stdout == "sound\n", told.stderr
