"""What was named while something else was missing is looked for again beside that."""

import dataclasses
import functools

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.candidates.library_fit import Candidate
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.refinement import substitution as revising
from slowtime.discrepancy.refinement.substitution import substitute, worth_it
from slowtime.discrepancy.selection.probabilities import answer_of
from slowtime.discrepancy.state import Found
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.test_search import FIRST, ONLY, SECOND, TWO, seen

NAMES = ("gap_symmetric", "gap_one_sided", "cubic_hardening", "sensor_gain", "input_gain")
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
HARD = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4})
PLAY = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 900.0, "gap_m": 0.008})
THERE = Effect("cubic_hardening", FIRST, {"k3_n_per_m3": 2e4})
LOUD = Effect("sensor_gain", ONLY, {"gain": 1.2})


_ACCOUNTS: dict[str, Found] = {}


def accounted(trials, *effects, kinds=KINDS):
    """Give an account of effects, one after the other, as they were fitted."""
    key = repr((effects, sorted(kinds)))
    if key not in _ACCOUNTS or _ACCOUNTS[key].trials is not trials:
        _ACCOUNTS[key] = fitted(trials, *effects, kinds=kinds)
    known = _ACCOUNTS[key]
    return dataclasses.replace(known, fits=[*known.fits], answers=[*known.answers])


def fitted(trials, *effects, kinds):
    fits = [refit(Plant.of(TWO, kinds=kinds), trials)]
    answers = []
    for effect in effects:
        (named,) = fit_candidates(
            fits[-1], [Candidate(effect, 0.0, 0.0, 0.0)], trials, kinds, lambda *_: False
        )
        fits.append(named.fit)
        answers.append(answer_of([named], [1.0], kinds))
    return Found(fits, trials, answers=answers)


@pytest.fixture(scope="module")
def trials():
    return seen((HARD, LOUD), samples=700)


@pytest.mark.long
@pytest.mark.parametrize(
    "neighbour",
    [PLAY, pytest.param(THERE, marks=pytest.mark.long)],
    ids=["law", "place"],
)
def test_a_neighbour_of_the_right_law_gives_way_once_the_other_is_in(trials, neighbour):
    found = accounted(trials, neighbour, LOUD)
    assert found.fits[-1].chi2_in_band > 1.5
    better = substitute(found, KINDS, None, Monitor())
    told = {answer.effect.kind: answer for answer in better.answers}
    assert set(told) == {"cubic_hardening", "sensor_gain"}
    assert told["cubic_hardening"].effect.place == SECOND
    assert better.fits[-1].chi2_in_band < 1.2
    assert told["cubic_hardening"].numbers["k3_n_per_m3"].value == pytest.approx(2e4, rel=0.02)
    assert [len(fit.plant.effects) for fit in better.fits] == [0, 1, 2]


@pytest.mark.long
def test_what_is_right_stays_as_it_is(trials):
    found = accounted(trials, HARD, LOUD)
    assert not worth_it(found, KINDS)
    assert substitute(found, KINDS, None, Monitor()) is found


@pytest.mark.long
def test_it_is_not_worth_it_for_one_effect_nor_for_what_ended_or_was_cut(trials):
    found = accounted(trials, PLAY, LOUD)
    assert worth_it(found, KINDS)
    one = dataclasses.replace(found, fits=found.fits[:2], answers=found.answers[:1])
    assert not worth_it(one, KINDS)
    assert not worth_it(dataclasses.replace(found, ended=True), KINDS)
    assert not worth_it(dataclasses.replace(found, holds=("zero",)), KINDS)
    half = tuple(t for trial in trials for t in (trial.part(0, 350), trial.part(350, 700)))
    assert not worth_it(dataclasses.replace(found, trials=half), KINDS)


def test_of_two_accounts_that_do_as_well_the_one_of_fewer_effects_stands(trials, monkeypatch):
    """A third effect that is needless is forgotten before they are weighed."""
    found = accounted(trials, HARD, LOUD)
    idle = Effect("cubic_hardening", FIRST, {"k3_n_per_m3": 1.0})
    more = carry_effect(found.fits[-1], idle, KINDS)
    more = refit(more.plant, trials, values=more.values, states=more.states, horizons=(1.0,))
    third = dataclasses.replace(found.answers[0], effect=idle)
    many = dataclasses.replace(found, fits=[*found.fits, more], answers=[*found.answers, third])
    assert worth_it(many, KINDS)
    monkeypatch.setattr(revising, "_anew", lambda *_: dataclasses.replace(many))
    fewer = substitute(many, KINDS, None, Monitor())
    assert [answer.effect.kind for answer in fewer.answers] == [
        "cubic_hardening",
        "sensor_gain",
    ]


@pytest.mark.long
def test_what_does_next_to_nothing_of_its_own_gives_way_to_what_it_stands_for():
    """What rides on a node and swings for ever, without damping, is a tone."""
    names = ("extra_dof", "harmonic_force", "cubic_hardening")
    kinds = {name: kind for name, kind in catalogue().items() if name in names}
    node = Place("node", TWO.nodes[1].id)
    tone = Effect(
        "harmonic_force", node, {"amplitude_n": 0.4, "frequency_hz": 5.3, "phase_rad": 0.4}
    )
    heard = seen((HARD, tone), samples=700)
    rings = Effect(
        "extra_dof", node, {"mass_kg": 1e-3, "frequency_hz": 5.3, "damping_n_s_per_m": 1e-5}
    )
    found = accounted(heard, HARD, rings, kinds=kinds)
    assert worth_it(found, kinds)
    better = substitute(found, kinds, None, Monitor())
    assert {answer.effect.kind for answer in better.answers} == {
        "cubic_hardening",
        "harmonic_force",
    }


def test_once_it_is_late_nothing_is_looked_for_again(trials):
    found = accounted(trials, PLAY, LOUD)
    late = substitute(found, KINDS, None, Monitor(late=lambda: True))
    assert late is found
    assert late.hurried


@pytest.mark.parametrize("faint", [True, False])
def test_what_does_nothing_of_its_own_gives_way_to_what_does_as_well(
    trials, monkeypatch, faint
):
    """Late as it may be; what does something stays, unless others explain more."""
    found = accounted(trials, PLAY, LOUD)
    known = accounted(trials, HARD, LOUD)
    branch = dataclasses.replace(found, answers=known.answers)
    monkeypatch.setattr(
        revising, "_faint", lambda one, _: [0] if faint and one is found else []
    )
    monkeypatch.setattr(revising, "_anew", lambda *_: dataclasses.replace(branch))
    for late in (False, True):
        watch = Monitor(late=functools.partial(bool, late), over=lambda: False)
        better = substitute(found, KINDS, None, watch)
        assert (better is not found) == faint
        assert found.hurried == (late and not faint)
