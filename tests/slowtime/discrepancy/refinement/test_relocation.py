"""Laws are tried at other places once all effects are in the model."""

import dataclasses

import pytest

from slowtime.discrepancy.diagnosis import Rival
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.refinement.relocation import relocate
from slowtime.dynamics.effects import Effect, Place, catalogue
from slowtime.dynamics.plant import Plant
from tests.slowtime.discrepancy.protocol import fit_at, fitted_chain, scaled
from tests.slowtime.discrepancy.two_mass_chain import FIRST, SECOND, TWO, records_of

KINDS = catalogue()
DRAG = Effect("quadratic_damping", FIRST, {"c2_n_s2_per_m2": 30.0})
NODES = [Place("node", node.id) for node in TWO.nodes]
TRUE = {
    "curve": Effect("cubic_hardening", SECOND, {"k3_n_per_m3": 8e4}),
    "jump": Effect("stiffness_jump", SECOND, {"dk_n_per_m": 150.0, "t_jump_s": 4.1}),
    "rider": Effect(
        "extra_dof", NODES[1], {"mass_kg": 0.2, "frequency_hz": 3.1, "damping_n_s_per_m": 0.2}
    ),
}
OTHER = {"curve": FIRST, "jump": FIRST, "rider": NODES[0]}


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False], ids=["first", "last"])
@pytest.mark.parametrize("name", ["jump", "curve", "rider"])
def test_a_law_moves_to_the_place_where_it_leaves_least(first, name):
    true = TRUE[name]
    # Beside less noise, which minimum the wrong law is fitted into hangs on the last digit.
    trials = records_of((true, DRAG), samples=600, noise=0.05)
    wrong = dataclasses.replace(true, place=OTHER[name])
    begun = fitted_chain(TWO, trials, KINDS, *((wrong, DRAG) if first else (DRAG, wrong)))
    found = relocate(begun, KINDS, Monitor())
    told = {answer.effect.kind: answer for answer in found.effects}
    assert told[true.kind].effect.place == true.place
    assert told["quadratic_damping"].effect.place == FIRST
    assert found.last.chi2_in_band < 1.2 < begun.last.chi2_in_band
    for number, value in true.parameters.items():
        assert told[true.kind].numbers[number].value == pytest.approx(value, rel=0.1)
    assert [len(fit.plant.effects) for fit in found.fits] == [0, 1, 2]
    assert str(true.place) in told[true.kind].sentence


@pytest.fixture(scope="module")
def misplaced():
    """A curve at the first element, which sits at the second, and a damper."""
    true = TRUE["curve"]
    trials = records_of((true, DRAG), samples=600)
    return fitted_chain(TWO, trials, KINDS, dataclasses.replace(true, place=FIRST), DRAG)


@pytest.mark.long
def test_laws_at_the_right_places_stay():
    found = fitted_chain(TWO, records_of((TRUE["curve"], DRAG)), KINDS, TRUE["curve"], DRAG)
    assert relocate(found, KINDS, Monitor()) is found


@pytest.mark.long
def test_a_single_law_and_a_hypothesis_that_is_final_are_left_as_they_are(misplaced):
    for changed in (
        {"fits": misplaced.fits[:2], "effects": misplaced.effects[:1]},
        {"final": True},
        {"without_sensor": True},
        {"holds": ("zero",)},
    ):
        found = dataclasses.replace(misplaced, **changed)
        assert relocate(found, KINDS, Monitor()) is found


@pytest.mark.long
def test_out_of_budget_laws_stay_and_the_hypothesis_is_marked_exhausted(misplaced):
    late = relocate(misplaced, KINDS, Monitor(over=lambda: True))
    assert late.exhausted
    assert not misplaced.exhausted
    assert (late.fits, late.effects) == (misplaced.fits, misplaced.effects)


@pytest.mark.long
@pytest.mark.parametrize(
    ("factors", "later_s"), [({"dk_n_per_m": 0.25}, 0.0), ({}, 0.3)], ids=["weak", "late"]
)
def test_a_law_is_begun_at_another_place_with_other_strengths_and_instants(factors, later_s):
    """An element that moves less needs more of a law; and a jump may have been misdated."""
    trials = records_of((TRUE["jump"], DRAG), samples=600)
    right = fitted_chain(TWO, trials, KINDS, DRAG, TRUE["jump"])
    (drag, jump), model = right.last.plant.description.effects, right.last.plant.description
    wrong = dataclasses.replace(model, effects=(drag, {**jump, "element": FIRST.id}))
    plant = Plant.of(wrong, kinds=KINDS)
    values = scaled(right.last, **factors)
    values[plant.parameters.index(("effect", 1, "t_jump_s"))] += later_s
    fit = fit_at(dataclasses.replace(right.last, plant=plant), trials, values)
    placed = dataclasses.replace(
        right.effects[1], effect=dataclasses.replace(TRUE["jump"], place=FIRST)
    )
    begun = dataclasses.replace(
        right, fits=(*right.fits[:-1], fit), effects=(right.effects[0], placed)
    )
    found = relocate(begun, KINDS, Monitor())
    assert found.effects[1].effect.place == SECOND
    assert found.effects[1].effect.parameters["t_jump_s"] == pytest.approx(4.1, abs=0.05)
    assert found.effects[1].effect.parameters["dk_n_per_m"] == pytest.approx(150.0, rel=0.1)


@pytest.mark.long
def test_doubts_about_the_place_that_a_law_had_are_dropped(misplaced):
    true = TRUE["curve"]
    rival, other = (Rival(true.kind, place, 0.3) for place in (SECOND, FIRST))
    curve, drag = misplaced.effects
    doubted = dataclasses.replace(
        misplaced,
        effects=(dataclasses.replace(curve, rivals=(rival,)), drag),
        undecided=(other, rival),
    )
    found = relocate(doubted, KINDS, Monitor())
    assert found.effects[0].effect.place == SECOND
    assert found.effects[0].rivals == ()
    assert found.undecided == ()
