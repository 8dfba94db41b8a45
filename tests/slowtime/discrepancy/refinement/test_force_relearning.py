"""A law whose free run is stuck beside the right numbers finds them in its own force."""

import dataclasses

import numpy as np
import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.refinement.force_relearning import _which, law_of, relearn_force
from slowtime.discrepancy.state import Found
from slowtime.dynamics.effects import Effect, Motion, Place, catalogue, force_along
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.proposers.test_lower_ranked import EVERY, MIDDLE, TOP, recorded

KINDS = catalogue()
PLAY = Effect("gap_symmetric", MIDDLE, {"kg_n_per_m": 2500.0, "gap_m": 0.02})
LAWS = {
    "cubic_hardening": {"k3_n_per_m3": 2e5},
    "gap_symmetric": {"kg_n_per_m": 900.0, "gap_m": 0.02},
    "saturating_stiffness": {"ks_n_per_m": 500.0, "es_m": 0.02},
    "quadratic_damping": {"c2_n_s2_per_m2": 20.0},
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("off", [0.6, 1.3])
def test_a_law_has_the_numbers_of_its_force_whatever_spring_is_beside_it(name, off):
    rng = np.random.default_rng(5)
    times = np.arange(6000) / 100.0
    e = 0.03 * np.sin(2 * np.pi * 1.3 * times) * (1 + 0.5 * np.sin(0.2 * times))
    motion = Motion(e=e, v=np.gradient(e, times), a=np.zeros(6000), times=times)
    force = force_along(KINDS[name], LAWS[name], motion)
    beside = 40.0 * motion.e - 0.7 * motion.v + 0.3
    heard = force + beside + 0.02 * force.std() * rng.standard_normal(6000)
    guess = {key: off * value for key, value in LAWS[name].items()}
    found = law_of(KINDS[name], Effect(name, MIDDLE, guess), heard, motion)
    assert found == pytest.approx(LAWS[name], rel=0.05)


def answered(effect):
    return NamedEffect(effect, KINDS[effect.kind].family, {}, 1.0, (), "")


@pytest.fixture(scope="module")
def stuck():
    """A right law with numbers that are off, and what the model leaves with them."""
    trials = recorded(EVERY, (PLAY,), level=20.0)
    plant = Plant.of(dataclasses.replace(EVERY, effects=(PLAY.entry(),)))
    right = refit(plant, trials, horizons=(1.0,))
    off = right.values.copy()
    off[plant.parameters.index(("effect", 0, "kg_n_per_m"))] *= 0.93
    off[plant.parameters.index(("effect", 0, "gap_m"))] *= 0.95
    runs = [
        plant.simulate(off, trial.inputs, trial.rate_hz, state0=state)
        for trial, state in zip(trials, right.states, strict=True)
    ]
    left = tuple(trial.measured - run for trial, run in zip(trials, runs, strict=True))
    wrong = dataclasses.replace(
        right, values=off, outputs=tuple(runs), residual=left, chi2_in_band=50.0
    )
    first = refit(Plant.of(EVERY), trials)
    return Found([first, wrong], trials, answers=[answered(PLAY)]), right


@pytest.mark.long
def test_what_is_stuck_is_freed_and_told_with_its_new_numbers(stuck):
    found, right = stuck
    found = dataclasses.replace(found, fits=[*found.fits], answers=[*found.answers])
    last = found.fits[-1]
    assert relearn_force(found, last, locate(last, found.trials), KINDS, Monitor())
    assert found.fits[-1].chi2_in_band < 1.2
    assert found.fits[-1].values == pytest.approx(right.values, rel=0.01)
    numbers = found.answers[0].numbers
    assert numbers["kg_n_per_m"].value == pytest.approx(2500.0, rel=0.02)
    assert numbers["gap_m"].value == pytest.approx(0.02, rel=0.02)


@pytest.mark.long
def test_what_is_right_is_left_as_it_is_and_so_is_all_once_it_is_late(stuck):
    found, right = stuck
    fine = dataclasses.replace(found, fits=[found.fits[0], right])
    located = locate(found.fits[-1], found.trials)
    assert not relearn_force(fine, right, located, KINDS, Monitor())
    assert not relearn_force(found, found.fits[-1], located, KINDS, Monitor(late=lambda: True))


@pytest.mark.long
def test_only_a_law_where_alone_a_force_is_missing_is_learnt_from_it(stuck):
    found, _ = stuck
    located = locate(found.fits[-1], found.trials)
    best, *others = located.groups
    assert _which(found, located, KINDS) == 0

    def told(**change):
        return _which(dataclasses.replace(found, **change), located, KINDS)

    assert told(answers=[answered(dataclasses.replace(PLAY, place=TOP))]) is None
    slips = Effect("coulomb", MIDDLE, {"friction_n": 1.0})
    assert told(answers=[answered(slips)]) is None
    assert told(answers=[answered(slips), answered(PLAY)]) == 1
    near = dataclasses.replace(others[0], left=2 * best.left)
    both = dataclasses.replace(located, groups=(best, near, *others[1:]))
    assert _which(found, both, KINDS) is None
    loud = dataclasses.replace(best, left=4.0)
    assert _which(found, dataclasses.replace(located, groups=(loud,)), KINDS) is None
    node = dataclasses.replace(best, places=(Place("node", "m1"),))
    assert _which(found, dataclasses.replace(located, groups=(node,)), KINDS) is None
