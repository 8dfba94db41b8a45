"""The budget of a step, and the isolation of what exceeds it."""

import threading
import time
from typing import Any

import numpy as np
import pytest

from twin_server import estimate as estimators
from twin_server.estimate import Checkpoint, Twin, estimate
from twin_server.history.states import SET_ASIDE
from twin_server.pipeline.progress import (
    EstimateBatch,
    OverBudgetError,
    Phase,
    Progress,
    ProgressMonitor,
    WorkBudget,
    estimate_apart,
    isolation,
)
from twin_server.registration.twin import MODEL_EXAMPLE, Registration
from twin_server.settings import ProgressSettings

SHORT = ProgressSettings(step_s=0.3, step_s_per_message=0.0, silent_s=2.0, store_s=10.0)


def spin():
    while True:
        pass


def test_a_step_within_its_budget_returns_what_it_returns():
    assert WorkBudget(SHORT).run(lambda: 5) == 5


def test_a_step_over_its_budget_is_interrupted_and_the_next_one_is_not():
    budget = WorkBudget(SHORT)
    for _ in range(2):
        with pytest.raises(OverBudgetError, match=r"more than 0\.3 s of processor time"):
            budget.run(spin)
        assert budget.run(lambda: sum(range(1000))) == 499500
    assert budget.used_s() is None


def test_a_step_that_catches_exceptions_is_interrupted_all_the_same():
    def stubborn():
        while True:
            try:
                spin()
            except Exception:
                pass

    with pytest.raises(OverBudgetError):
        WorkBudget(SHORT).run(stubborn)


def test_time_in_which_nothing_is_computed_is_not_of_the_budget():
    assert WorkBudget(SHORT).run(lambda: time.sleep(0.8)) is None


def test_the_budget_grows_with_the_messages():
    settings = SHORT.model_copy(update={"step_s_per_message": 0.1})

    def work():
        began_s = time.thread_time()
        while time.thread_time() - began_s < 0.6:
            pass

    with pytest.raises(OverBudgetError):
        WorkBudget(settings).run(work, 1)
    WorkBudget(settings).run(work, 20)


def test_the_budget_grows_with_the_parameters_of_twins_of_elements():
    settings = SHORT.model_copy(update={"step_s_per_parameter": 0.1})

    def work():
        began_s = time.thread_time()
        while time.thread_time() - began_s < 0.6:
            pass

    with pytest.raises(OverBudgetError):
        WorkBudget(settings).run(work, 1, 0)
    WorkBudget(settings).run(work, 1, 30)


def test_messages_of_twins_of_elements_get_a_budget_for_their_parameters(ageing, monkeypatch):
    """Where one of many groups has changed, finding it takes longer than anything else."""
    batch = batch_of(ageing, Registration.model_validate(MODEL_EXAMPLE))
    granted = []

    def run(self, step, messages=1, parameters=0):
        granted.append((messages, parameters))
        raise OverBudgetError("not of interest here")

    monkeypatch.setattr(WorkBudget, "run", run)
    estimate_apart(batch, WorkBudget(SHORT))
    assert granted[0] == (20, 20 * len(MODEL_EXAMPLE["parameters"]))


def test_an_error_of_a_step_comes_out_as_it_is():
    with pytest.raises(ZeroDivisionError):
        WorkBudget(SHORT).run(lambda: 1 / 0)


def batch_of(ageing, registration=None):
    twin = Twin(
        registration or Registration(), Checkpoint.start(registration or Registration())
    )
    features = [
        m for pair in zip(ageing(30), ageing(30, asset="bad"), strict=True) for m in pair
    ]
    return EstimateBatch([twin, twin], features, [0, 1] * 30, [0] * 60, [0.0] * 60)


@pytest.mark.parametrize("how", ["spins", "raises"])
def test_only_the_message_that_fails_has_no_estimate(ageing, monkeypatch, how):
    batch = batch_of(ageing)
    expected = estimate(*batch)

    def fragile(twins, features, *rest):
        if any(f.asset == "bad" and f.sequence == 7 for f in features):
            if how == "spins":
                spin()
            raise ArithmeticError("a fault")
        return estimators.estimate(twins, features, *rest)

    monkeypatch.setattr(isolation, "estimate", fragile)
    found, failed = estimate_apart(batch, WorkBudget(SHORT))
    assert list(failed) == [15]
    assert ("processor time" if how == "spins" else "a fault") in failed[15]
    of_beam = slice(0, None, 2)
    assert found.states[of_beam].tobytes() == expected.states[of_beam].tobytes()
    aside = found.states["reasons"] & SET_ASIDE > 0
    assert np.flatnonzero(aside).tolist() == [15]
    assert found.states["t_ns"].tolist() == expected.states["t_ns"].tolist()
    assert found.states["slow_time"].tolist() == expected.states["slow_time"].tolist()


def test_what_is_aside_is_not_tried_and_others_are_as_if_it_had_never_come(ageing, monkeypatch):
    batch = batch_of(ageing)
    without = [row for row in range(60) if row != 15]
    expected = estimate(
        batch.twins, [batch.features[row] for row in without],
        [batch.owners[row] for row in without], [0] * 59, [0.0] * 59,
    )  # fmt: skip
    found, failed = estimate_apart(batch, WorkBudget(SHORT), aside={15}, alone={3, 4, 20})
    assert list(failed) == [15]
    assert found.states[without].tobytes() == expected.states.tobytes()
    assert found.checkpoints == expected.checkpoints


class Scene:
    """A monitor whose looks are made by hand."""

    def __init__(self, *, waiting=True, phase=Phase.STEP):
        self.progress, self.budget = Progress(), WorkBudget(SHORT)
        self.progress.phase = phase
        self.waiting = waiting
        self.told: list[tuple[Any, ...]] = []
        self.ended: list[Any] = []
        self.monitor = ProgressMonitor(
            SHORT, self.progress, self.budget, lambda: self.waiting,
            lambda *told: self.told.append(told), look_s=0.5, end=self.ended.append,
        )  # fmt: skip

    def looks(self, seconds):
        for _ in range(int(seconds / 0.5)):
            self.monitor.look()


def test_a_pipeline_that_stands_still_is_told_with_its_stacks_and_ended(caplog):
    scene = Scene()
    scene.looks(1.5)
    assert not scene.told
    scene.looks(1.0)
    ((sentence, by_message),) = scene.told
    assert "Nothing was finished for 2 s" in sentence
    assert by_message
    assert "test_a_pipeline_that_stands_still" in caplog.text
    assert not scene.ended
    scene.looks(2.5)
    assert scene.ended[0] == 70


def test_a_pipeline_that_finishes_or_waits_for_nothing_does_not_stand_still():
    scene = Scene()
    for _ in range(20):
        scene.progress.advance()
        scene.looks(1.0)
    idle = Scene(waiting=False, phase=Phase.IDLE)
    idle.looks(60)
    assert not scene.told
    assert not idle.told


def test_the_database_may_take_longer_and_no_message_is_blamed_for_it():
    scene = Scene(phase=Phase.STORE)
    scene.looks(9.5)
    assert not scene.told
    scene.looks(1.0)
    assert scene.told[0][1] is False


def test_a_step_that_sleeps_in_turns_is_interrupted_before_the_server_would_end(monkeypatch):
    scene, ended = Scene(), threading.Event()

    def sleepy():
        while True:
            time.sleep(0.001) if ended.is_set() else ended.wait(0.01)

    caught = []

    def step():
        try:
            scene.budget.run(sleepy)
        except OverBudgetError as error:
            caught.append(str(error))

    thread = threading.Thread(target=step)
    thread.start()
    until_s = time.monotonic() + 60
    monkeypatch.setattr(scene.monitor, "_moves", lambda: False)  # it computes nearly nothing
    while thread.is_alive() and time.monotonic() < until_s:
        scene.monitor.look()
        time.sleep(0.05)
        scene.monitor._still_s = min(scene.monitor._still_s, 1.5)
    thread.join(10)
    assert caught
    assert "did not go on" in caught[0]
    assert not scene.told
