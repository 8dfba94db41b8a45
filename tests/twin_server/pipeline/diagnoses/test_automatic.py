"""Diagnoses that a twin orders by itself, and what its policy lets become of them."""

import pytest

from twin_server.pipeline.diagnoses.automatic import AutomaticDiagnoses, refusal
from twin_server.pipeline.monitoring.gap import Comparison
from twin_server.registration.disagreement import DisagreementPolicy
from twin_server.registration.twin import MODEL_EXAMPLE, Registration
from twin_server.serve import ProblemError

ID = "lab.rig"
POLICY = {"samples_s": 40.0, "holdout_s": 10.0, "tries": 2, "between": 3, "adopt_above": 0.9}
AGREES = Comparison(nominal=0.02, in_use=0.02, limit=0.03, disagrees=False)
DISAGREES = Comparison(nominal=0.2, in_use=0.2, limit=0.03, disagrees=True)
WORSE = Comparison(nominal=0.02, in_use=0.2, limit=0.03, disagrees=True)


def report(probability=0.99, verdict="missing_effect", augmented=0.02):
    return {
        "verdict": verdict,
        "effects": [{"effect": "coulomb", "probability": probability}],
        "gap": {"refitted_nominal": 0.1, "augmented": augmented},
    }


class Desk:
    """Orders nothing, and notes what it was asked for."""

    def __init__(self):
        self.orders, self.done, self.refused = [], [], False

    def order(self, twin_id, registration, order, principal):
        if self.refused:
            raise ProblemError(409, "no-samples", "The edge is away.")
        self.orders.append(order)
        return len(self.orders)

    def adopt(self, twin_id, registration, number):
        if self.refused:
            raise ProblemError(409, "not-adoptable", "It was changed meanwhile.")
        self.done.append(("adopt", number))

    def undo(self, twin_id, registration, number):
        self.done.append(("undo", number))


class Acting:
    """Automatic diagnoses of one twin, with what they ask for and tell."""

    def __init__(self, policy, adopted=()):
        self.desk, self.notes = Desk(), []
        given = {**MODEL_EXAMPLE, "on_disagreement": policy, "adopted": adopted}
        self.registration = Registration.model_validate(given)
        self.automatic = AutomaticDiagnoses(
            self.desk, lambda twin_id: self.registration, self.note, samples_s=60.0
        )

    def note(self, twin_id, kind, severity, message, details):
        self.notes.append(message)

    def see(self, found, times=1):
        for _ in range(times):
            self.automatic.compared(ID, found)


def adopted(number):
    one = {
        "diagnosis": number,
        "clock": "fast",
        "effects": ["coulomb"],
        "sentence": "Friction.",
    }
    return one | {"model_before": MODEL_EXAMPLE["model"]}


def test_nothing_is_ordered_without_a_policy_or_while_the_model_agrees():
    acting = Acting(None)
    acting.see(DISAGREES, 5)
    assert (acting.desk.orders, acting.notes) == ([], [])
    acting = Acting(POLICY)
    acting.see(AGREES, 5)
    assert acting.desk.orders == []


def test_a_disagreement_orders_one_diagnosis_of_the_samples_that_the_policy_names():
    acting = Acting(POLICY)
    acting.see(DISAGREES, 20)
    (order,) = acting.desk.orders
    assert (order.raw.duration_s, order.holdout_s, order.quick) == (40.0, 10.0, False)
    assert acting.notes == [
        "Diagnosis 1 was ordered without a person, of the last 40 s of raw samples: attempt 1 "
        "of 2."
    ]


def test_two_comparisons_are_asked_for_where_the_policy_does_not_say_how_much():
    acting = Acting({})
    acting.see(DISAGREES)
    assert acting.desk.orders[0].raw.duration_s == 60.0


def test_what_is_probable_and_closes_the_gap_is_adopted_with_the_reason():
    acting = Acting(POLICY)
    acting.see(DISAGREES)
    acting.automatic.ended(ID, 1, report())
    assert acting.desk.done == [("adopt", 1)]
    assert acting.notes[-1] == (
        "Diagnosis 1 was adopted without a person: its probability is 99.0%, and the error of "
        "the free run falls from 10.0% to 2.0%."
    )


def test_a_diagnosis_that_a_person_ordered_is_left_to_them():
    acting = Acting(POLICY)
    acting.automatic.ended(ID, 1, report())
    acting.see(DISAGREES)
    acting.automatic.ended(ID, 7, report())
    assert acting.desk.done == []


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (report(probability=0.5), "its probability is 50.0%, below 90.0%."),
        (report(verdict="sensor_fault"), "its verdict is sensor fault."),
        (report(augmented=0.11), "the error of the free run does not fall: 10.0% without"),
    ],
)
def test_what_is_not_adopted_says_why_and_is_tried_again_with_newer_samples(found, says):
    acting = Acting(POLICY)
    acting.see(DISAGREES)
    acting.automatic.ended(ID, 1, found)
    assert acting.desk.done == []
    assert says in acting.notes[-1]
    acting.see(DISAGREES, 3)
    assert len(acting.desk.orders) == 1
    acting.see(DISAGREES)
    assert len(acting.desk.orders) == 2
    acting.automatic.ended(ID, 2, None)  # failed
    acting.see(DISAGREES, 20)
    assert len(acting.desk.orders) == 2  # as many tries as the policy allows
    acting.see(AGREES)
    acting.see(DISAGREES)
    assert len(acting.desk.orders) == 3


def test_what_is_undecided_is_adopted_if_the_policy_says_so_and_all_together_are_probable():
    rivals = [{"effect": one, "probability": 0.46} for one in ("coulomb", "stribeck")]
    undecided = report(probability=0.46, verdict="undecided") | {"undecided": rivals}
    assert (
        refusal(DisagreementPolicy(adopt_above=0.9), undecided) == "its verdict is undecided."
    )
    policy = DisagreementPolicy(adopt_above=0.9, adopt_undecided=True)
    assert refusal(policy, undecided) is None
    said = refusal(DisagreementPolicy(adopt_above=0.95, adopt_undecided=True), undecided)
    assert said is not None
    assert "92.0%, below 95.0%" in said


def test_without_a_probability_in_the_policy_a_person_adopts():
    assert refusal(DisagreementPolicy(), report()) == "adopting is left to a person."
    assert refusal(DisagreementPolicy(adopt_above=0.9), report()) is None


def test_an_edge_that_is_away_is_asked_again_and_costs_no_try():
    acting = Acting(POLICY)
    acting.desk.refused = True
    acting.see(DISAGREES, 20)
    acting.desk.refused = False
    acting.see(DISAGREES)
    assert len(acting.desk.orders) == 1
    assert "attempt 1 of 2" in acting.notes[-1]


def test_an_adoption_that_is_refused_is_told():
    acting = Acting(POLICY)
    acting.see(DISAGREES)
    acting.desk.refused = True
    acting.automatic.ended(ID, 1, report())
    assert acting.notes[-1].startswith("Diagnosis 1 could not be adopted: ")


def test_an_adopted_model_that_is_worse_than_none_is_undone_after_as_many_comparisons():
    acting = Acting({"undo_after": 3}, [adopted(4)])
    acting.see(WORSE, 2)
    acting.see(AGREES)
    acting.see(WORSE, 2)
    assert acting.desk.done == []
    acting.see(WORSE)
    assert acting.desk.done == [("undo", 4)]
    assert "in 3 comparisons in a row the model with it is worse" in acting.notes[-1]
    assert "20.0% against 2.0%" in acting.notes[-1]


def test_nothing_is_diagnosed_while_an_adopted_model_may_be_undone():
    acting = Acting({"undo_after": 3}, [adopted(4)])
    acting.see(WORSE, 2)
    assert acting.desk.orders == []
    acting.see(WORSE)
    acting.registration = acting.registration.model_copy(update={"adopted": ()})
    acting.see(AGREES._replace(disagrees=True))  # the monitor waits for a second one
    assert acting.desk.orders == []


def test_what_was_found_with_another_model_is_not_adopted():
    acting = Acting(POLICY)
    acting.see(DISAGREES)
    given = acting.registration.to_dict()
    given["model"]["nodes"][0]["mass_kg"] = 901.0
    acting.registration = Registration.model_validate(given)
    acting.automatic.ended(ID, 1, report())
    assert acting.desk.done == []
    assert acting.notes[-1].endswith("the model of the twin was changed meanwhile.")


def test_an_adopted_model_that_explains_a_part_is_kept():
    acting = Acting({"undo_after": 3}, [adopted(4)])
    acting.see(Comparison(nominal=0.4, in_use=0.2, limit=0.03, disagrees=True), 20)
    assert acting.desk.done == []


def test_undoing_is_left_to_a_person_where_the_policy_does_not_say_when():
    acting = Acting({}, [adopted(4)])
    acting.see(WORSE, 20)
    assert acting.desk.done == []
