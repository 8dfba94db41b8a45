"""Hypotheses on what has changed, as a person reads them."""

import numpy as np
import pytest

from slowtime.evolution.structures import ChangedParts, NamedChanges
from twin_server.estimate.elements.suspects import suspects_of

NAMES = ("j1", "j2", "j4", "m1.mass")


def hypothesis(probability, **changes):
    change = np.array(list(changes.values()))
    sd = np.full(len(change), 0.01)
    names = tuple(name.replace("_mass", ".mass") for name in changes)
    return ChangedParts(names, probability, change, sd, change - 2 * sd, change + 2 * sd)


def sentences(*hypotheses):
    named = NamedChanges(hypotheses, dict.fromkeys(NAMES, 0.5), "")
    return [suspect.sentence for suspect in suspects_of(named)]


def test_of_two_that_explain_the_same_both_are_named_with_their_sizes():
    told = sentences(hypothesis(0.5, j4=-0.12), hypothesis(0.4, j1=-0.08))
    assert told == [
        "j1 or j4 has changed; the readings do not show which: either j1 has lost 8 % ± 1 % of "
        "its stiffness, or j4 has lost 12 % ± 1 % of its stiffness."
    ]


def test_what_all_hypotheses_share_is_certain_and_told_first():
    told = sentences(hypothesis(0.5, j2=0.05, j4=-0.12), hypothesis(0.4, j2=0.05, m1_mass=0.08))
    assert told == [
        "j2 has gained 5 % ± 1 % of its stiffness.",
        "j4 or m1.mass has changed; the readings do not show which: either j4 has lost 12 % ± "
        "1 % of its stiffness, or m1 has gained 8 % ± 1 % of its mass.",
    ]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_sentence_is_the_same_whichever_rival_leads(order):
    rivals = [{"j1": -0.08}, {"j4": -0.12}]
    first, second = (rivals[i] for i in order)
    told = sentences(hypothesis(0.5, **first), hypothesis(0.45, **second))
    assert told[0].startswith("j1 or j4 has changed")


@pytest.mark.parametrize(
    ("best", "other"),
    [
        pytest.param((0.92, {"j1": -0.1}), (0.5, {"j4": -0.1}), id="near certain"),
        pytest.param((0.6, {"j1": -0.1}), (0.1, {"j4": -0.1}), id="rival improbable"),
        pytest.param((0.5, {"j1": -0.1}), (0.4, {"j1": -0.1, "j4": 0.1}), id="rival adds"),
    ],
)
def test_what_is_no_rival_is_not_named(best, other):
    told = sentences(*(hypothesis(p, **changes) for p, changes in (best, other)))
    assert told == ["j1 has lost 10 % ± 1 % of its stiffness."]
