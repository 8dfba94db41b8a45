"""Effects named while others were missing are looked for again beside those."""

import dataclasses

import pytest

from slowtime.discrepancy.calibration import refit
from slowtime.discrepancy.calibration.augmentation import carry_effect
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.refinement.substitution import is_worthwhile, substitute
from slowtime.dynamics.effects import Effect, Place, catalogue
from tests.slowtime.discrepancy.protocol import fitted_chain, named_effect
from tests.slowtime.discrepancy.two_mass_chain import FIRST, SECOND, TWO, records_of

NAMES = ("gap_symmetric", "gap_one_sided", "cubic_hardening", "sensor_gain", "input_gain")
KINDS = {name: kind for name, kind in catalogue().items() if name in NAMES}
HARD = Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 2e4})
PLAY = Effect("gap_symmetric", SECOND, {"kg_n_per_m": 900.0, "gap_m": 0.008})
THERE = Effect("cubic_hardening", FIRST, {"k3_n_per_m3": 2e4})
LOUD = Effect("sensor_gain", Place("sensor", "x_m1"), {"gain": 1.2})


@pytest.fixture(scope="module")
def trials():
    return records_of((HARD, LOUD), samples=700)


@pytest.fixture(scope="module")
def wrong_law(trials):
    return fitted_chain(TWO, trials, KINDS, PLAY, LOUD)


@pytest.fixture(scope="module")
def wrong_place(trials):
    return fitted_chain(TWO, trials, KINDS, THERE, LOUD)


@pytest.fixture(scope="module")
def right(trials):
    return fitted_chain(TWO, trials, KINDS, HARD, LOUD)


@pytest.mark.long
@pytest.mark.parametrize("neighbour", ["wrong_law", "wrong_place"])
def test_a_neighbour_of_the_right_law_is_substituted_once_the_other_effect_is_in(
    neighbour, request
):
    found = request.getfixturevalue(neighbour)
    assert found.last.chi2_in_band > 1.5
    better = substitute(found, KINDS, None, Monitor())
    told = {answer.effect.kind: answer for answer in better.effects}
    assert set(told) == {"cubic_hardening", "sensor_gain"}
    assert told["cubic_hardening"].effect.place == SECOND
    assert better.last.chi2_in_band < 1.2
    assert told["cubic_hardening"].numbers["k3_n_per_m3"].value == pytest.approx(2e4, rel=0.02)
    assert [len(fit.plant.effects) for fit in better.fits] == [0, 1, 2]
    assert substitute(better, KINDS, None, Monitor()) is better


def test_two_laws_that_explain_all_are_not_worth_a_substitution(right):
    assert not is_worthwhile(right, KINDS)
    assert substitute(right, KINDS, None, Monitor()) is right


@pytest.mark.long
def test_a_law_of_general_form_is_looked_for_again_and_stays_where_it_is_right():
    """Named while another was missing, it may have imitated that."""
    kinds = KINDS | {"quintic_stiffness": catalogue()["quintic_stiffness"]}
    numbers = {"k3_n": 0.02, "k5_n": 0.02, "e0_m": 0.01}
    general = Effect("quintic_stiffness", SECOND, numbers)
    found = fitted_chain(TWO, records_of((general, LOUD), samples=700), kinds, general, LOUD)
    assert found.last.chi2_in_band < 1.2
    assert is_worthwhile(found, kinds)
    told: list[str] = []
    stays = substitute(found, kinds, None, Monitor(lambda stage, _: told.append(stage)))
    assert {one.effect.kind for one in stays.effects} == {"quintic_stiffness", "sensor_gain"}
    assert any("looking again at quintic_stiffness" in stage for stage in told)


def test_a_single_effect_a_final_hypothesis_and_segments_are_not_worth_a_substitution(
    wrong_law,
):
    assert is_worthwhile(wrong_law, KINDS)
    half = tuple(
        t for trial in wrong_law.trials for t in (trial.part(0, 350), trial.part(350, 700))
    )
    for changed in (
        {"fits": wrong_law.fits[:2], "effects": wrong_law.effects[:1]},
        {"final": True},
        {"holds": ("zero",)},
        {"trials": half},
    ):
        found = dataclasses.replace(wrong_law, **changed)
        assert not is_worthwhile(found, KINDS)
        assert substitute(found, KINDS, None, Monitor()) is found


@pytest.mark.long
def test_of_two_hypotheses_that_do_as_well_the_one_of_fewer_effects_stands(right, trials):
    """A third effect that is needless is dropped before they are compared."""
    idle = Effect("cubic_hardening", FIRST, {"k3_n_per_m3": 1.0})
    more = carry_effect(right.last, idle, KINDS)
    more = refit(more.plant, trials, values=more.values, states=more.states, horizons=(1.0,))
    many = right.with_effect(more, named_effect(idle, KINDS))
    assert is_worthwhile(many, KINDS)
    fewer = substitute(many, KINDS, None, Monitor())
    assert {answer.effect.kind for answer in fewer.effects} == {
        "cubic_hardening",
        "sensor_gain",
    }
    assert len(fewer.effects) == 2


@pytest.mark.long
def test_a_law_that_does_next_to_nothing_is_substituted_late_as_it_may_be():
    """What rides on a node and swings for ever, without damping, is a tone."""
    names = ("extra_dof", "harmonic_force", "cubic_hardening")
    kinds = {name: kind for name, kind in catalogue().items() if name in names}
    node = Place("node", TWO.nodes[1].id)
    tone = Effect(
        "harmonic_force", node, {"amplitude_n": 0.4, "frequency_hz": 5.3, "phase_rad": 0.4}
    )
    heard = records_of((HARD, tone), samples=700)
    rings = Effect(
        "extra_dof", node, {"mass_kg": 1e-3, "frequency_hz": 5.3, "damping_n_s_per_m": 1e-5}
    )
    found = fitted_chain(TWO, heard, kinds, HARD, rings)
    assert is_worthwhile(found, kinds)
    late = Monitor(late=lambda: True, over=lambda: False)
    better = substitute(found, kinds, None, late)
    assert {answer.effect.kind for answer in better.effects} == {
        "cubic_hardening",
        "harmonic_force",
    }


def test_out_of_budget_nothing_is_looked_for_again(wrong_law):
    late = substitute(wrong_law, KINDS, None, Monitor(late=lambda: True))
    assert late.exhausted
    assert (late.fits, late.effects) == (wrong_law.fits, wrong_law.effects)
    assert not wrong_law.exhausted
