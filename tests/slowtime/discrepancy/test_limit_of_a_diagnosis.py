"""A diagnosis ends at its time limit, search and report alike, and says what it left out."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import initial_states, refit
from slowtime.discrepancy.diagnose import diagnose
from slowtime.discrepancy.noise import estimate_noise
from slowtime.discrepancy.records import Campaign
from slowtime.discrepancy.time_limit import TimeLimit, budget_share, leave_out, limited
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.work import metered
from tests.slowtime.discrepancy.two_mass_chain import CUBIC, KINDS, RATE, TWO, records_of


def reached():
    return TimeLimit(is_reached=lambda: True)


def test_without_a_limit_nothing_is_left_out():
    assert not leave_out("a step")
    assert budget_share() == 1.0


def test_a_limit_holds_within_and_lists_each_step_once():
    limit = reached()
    with limited(limit):
        assert leave_out("one")
        assert leave_out("another")
        assert leave_out("one")
    assert limit.left_out == ["one", "another"]
    assert limit.note.count("one, another") == 1
    assert not leave_out("one")
    assert TimeLimit().note == ""


def test_a_fit_ends_where_it_began_once_the_limit_is_reached():
    trials = records_of((CUBIC,))
    plant = Plant.of(dataclasses.replace(TWO, effects=(CUBIC.entry(),)), kinds=KINDS)
    start = 1.01 * plant.values
    with metered() as whole:
        fit = refit(plant, trials, values=start)
    limit = reached()
    with metered() as meter, limited(limit):
        cut = refit(plant, trials, values=start)
    assert np.array_equal(cut.values, start)
    assert cut.cost > 2 * fit.cost
    assert meter.spent < 0.5 * whole.spent
    assert limit.left_out == ["convergence of fits"]


def test_initial_states_are_not_searched_at_random_once_the_limit_is_reached(monkeypatch):
    asked = []
    monkeypatch.setattr(initial_states, "try_refit", lambda *_, **how: asked.append(how))
    (trial, *_) = records_of((CUBIC,))
    plant = Plant.of(TWO, kinds=KINDS)
    noise = estimate_noise((trial,), (trial.measured,), silent_above_hz=RATE / 2)
    known = np.zeros(len(plant.state_names))

    def searched():
        asked.clear()
        return initial_states.multistart_initial_state(
            plant, trial, noise, plant.values, known, known + 1.0
        )

    assert searched() is known
    assert len(asked) == initial_states.STARTS + 2
    limit = reached()
    with limited(limit):
        assert searched() is known
    assert len(asked) == 1
    assert limit.left_out == ["a multistart of initial states"]


@pytest.mark.long
def test_a_diagnosis_ends_soon_after_its_limit():
    """The law is not among the kinds: a force surface would be fitted next."""
    campaign = Campaign(description=TWO, trials=records_of((CUBIC,)))
    names = ("viscous_damping", "stiffness_loss")
    few = {name: kind for name, kind in KINDS.items() if kind.is_surface or name in names}
    stages: list[str] = []
    limit = TimeLimit(is_reached=lambda: "validating" in " ".join(stages))
    with limited(limit):
        found = diagnose(campaign, kinds=few, progress=lambda stage, _: stages.append(stage))
    assert found.verdict == "unknown_effect"
    assert "the force surface" in limit.note
    assert found.measured_force is None
