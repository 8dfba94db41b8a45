"""Effects are named with the probability of all models that they are in."""

import pytest

from slowtime.discrepancy.selection.probabilities import (
    first_doubts,
    name_in_combination,
    probabilities,
)
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Place, catalogue
from tests.slowtime.discrepancy.protocol import named_effect

KINDS = catalogue()
PLACE = Place("element", "k1")
FRICTION, DRAG, CUBIC = (
    (name, PLACE) for name in ("coulomb", "quadratic_damping", "cubic_hardening")
)
MODELS = [((FRICTION, CUBIC), 0.5), ((DRAG, CUBIC), 0.3), ((FRICTION,), 0.15), ((), 0.05)]


def named(kind, models=MODELS):
    effect = Effect(kind, PLACE, {})

    def instead(labels):
        return [one for one in labels if one != CUBIC]

    return name_in_combination(effect, {}, models, instead, KINDS)


def test_an_effect_has_the_probability_of_the_combinations_that_it_is_in():
    friction, cubic = named("coulomb"), named("cubic_hardening")
    assert friction.probability == pytest.approx(0.65)
    assert cubic.probability == pytest.approx(0.8)
    assert [(one.effect, one.probability) for one in friction.rivals] == [
        ("quadratic_damping", 0.3)
    ]
    assert [one.effect for one in cubic.rivals] == ["coulomb"]


def test_rivals_come_in_the_order_of_their_probability_and_hardly_probable_ones_do_not():
    faint = (("stribeck", PLACE),), 0.9 * LIMITS.told_probability
    models = [((CUBIC,), 0.5), ((FRICTION,), 0.1), ((DRAG,), 0.395), faint]
    rivals = named("cubic_hardening", models).rivals
    assert [one.effect for one in rivals] == ["quadratic_damping", "coulomb"]


def test_evidence_is_worth_less_where_the_best_model_leaves_much():
    sure, unsure = probabilities([3.0, 0.0], 1.0), probabilities([3.0, 0.0], 10.0)
    assert sum(sure) == pytest.approx(1.0)
    assert sure[0] > unsure[0] > 0.5


def test_doubts_are_those_of_the_first_effect_that_is_not_decided():
    sure = named_effect(Effect("coulomb", PLACE, {}), KINDS, 0.999)
    unsure = named_effect(Effect("quadratic_damping", PLACE, {}), KINDS, 0.5)
    assert [one.effect for one in first_doubts([sure, unsure])] == ["quadratic_damping"]
    assert first_doubts([sure]) == ()
