"""Laws that may be pieces of one."""

import pytest

from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.selection.many_laws import (
    pieces_of_one,
    temper_many_laws,
    variable_of,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Friction, Hidden, Law, Place, catalogue

KINDS = catalogue()
HERE, THERE = Place("element", "j1"), Place("element", "j2")

ALONG = {
    "cubic_hardening": "elongation",
    "cubic_softening": "elongation",
    "quadratic_stiffness": "elongation",
    "saturating_stiffness": "elongation",
    "gap_symmetric": "elongation",
    "gap_one_sided": "elongation",
    "pendulum_sine": "elongation",
    "coulomb": "speed",
    "stribeck": "speed",
    "quadratic_damping": "speed",
    "cubic_damping": "speed",
    "friction_with_drag": "speed",
    "friction_with_creep": "speed",
    "power_law_damping": "speed",
    "rayleigh_damping": "speed",
    "quintic_stiffness": "elongation",
    "stiffness_two_knees": "elongation",
}
"""The laws that are curves; all others remember, take both, change in time, or are no laws."""


def law_of(name, place=HERE):
    # Of a size at which none is flat.
    parameters = {p.name: p.choices[0] if p.choices else 0.3 + 0.1 * i
                  for i, p in enumerate(KINDS[name].parameters)}  # fmt: skip
    if name == "cubic_softening":
        parameters = {"k3_n_per_m3": -2.0}
    return NamedEffect(Effect(name, place, parameters), KINDS[name].family, {}, 1.0, (), "")


def sure_of(answers, count, alike=False):
    return temper_many_laws(answers, count, KINDS, alike=alike)


@pytest.mark.parametrize("name", sorted(KINDS))
def test_each_kind_is_known_for_the_variable_it_is_a_curve_of(name):
    assert variable_of(law_of(name).effect, KINDS) == ALONG.get(name)
    assert name not in ALONG or isinstance(KINDS[name].action, Law | Friction | Hidden)


def test_a_model_of_many_laws_is_never_sure():
    answers = [law_of("cubic_hardening"), law_of("coulomb"), law_of("bouc_wen", THERE)]
    assert [a.probability for a in sure_of(answers[:2], 2)] == [1.0, 1.0]
    assert all(a.probability < LIMITS.decided_probability for a in sure_of(answers, 3))


def test_two_curves_of_one_elongation_may_be_one_that_is_unknown():
    two = [law_of("cubic_hardening"), law_of("saturating_stiffness")]
    assert pieces_of_one(two, KINDS) == {HERE: "elongation"}
    assert all(a.probability < LIMITS.decided_probability for a in sure_of(two, 2))
    apart = [law_of("cubic_hardening"), law_of("saturating_stiffness", THERE)]
    assert pieces_of_one(apart, KINDS) == {}
    assert [a.probability for a in sure_of(apart, 2)] == [1.0, 1.0]


@pytest.mark.parametrize(
    ("curve", "constant", "pieces"),
    [
        ("quadratic_damping", "viscous_damping", True),
        ("cubic_hardening", "stiffness_loss", True),
        ("quadratic_damping", "stiffness_loss", False),
        ("cubic_hardening", "viscous_damping", False),
        ("bouc_wen", "stiffness_loss", False),
    ],
)
def test_a_curve_beside_a_constant_that_is_off_may_be_one_curve(curve, constant, pieces):
    both = [law_of(curve), law_of(constant)]
    assert all((a.probability < LIMITS.decided_probability) == pieces for a in sure_of(both, 2))
    apart = [law_of(curve), law_of(constant, THERE)]
    assert [a.probability for a in sure_of(apart, 2)] == [1.0, 1.0]


def test_beside_a_base_that_moves_as_no_law_tells_a_law_is_less_sure():
    base = law_of("base_motion", Place("base", "base"))
    assert [a.probability for a in sure_of([base], 1)] == [1.0]
    assert all(
        a.probability < LIMITS.decided_probability
        for a in sure_of([law_of("coulomb"), base], 2)
    )
    wander = law_of("sensor_drift", Place("sensor", "x"))
    sure = sure_of([law_of("coulomb"), wander], 2)
    assert [a.probability for a in sure] == [1.0, 1.0]


def test_where_a_force_on_the_structure_would_do_the_same_a_base_is_less_sure_to_move():
    base, law = law_of("base_motion", Place("base", "base")), law_of("coulomb")
    (moved,) = sure_of([base], 1, alike=True)
    assert 0.5 < moved.probability < LIMITS.decided_probability
    assert sure_of([law], 1, alike=True)[0].probability == 1.0
