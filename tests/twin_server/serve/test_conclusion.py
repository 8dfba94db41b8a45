"""Whether anything is wrong: the answer to each situation, and laws over all of them."""

import dataclasses
import itertools
from typing import Any

import pytest

from twin_server.history import states
from twin_server.serve.conclusion import (
    ANSWERS,
    Evidence,
    FailureProspect,
    LimitProspect,
    conclude,
)
from twin_server.settings import ServeSettings

WELL = Evidence(reasons=0, alive=True)
NEAR = LimitProspect(0.3, 0.0, "Stiffness change below −30 %: 10 %: by 700.")
FAR = LimitProspect(0.01, 0.0, "Stiffness change below −30 %.")
PASSED = LimitProspect(0.9, 0.8, "Stiffness change below −30 %.")
SAFE = FailureProspect(1e-9, 1e-7, 1e-4, False, "collapse: 1e-9")
RISING = FailureProspect(1e-5, 2e-4, 1e-4, True, "collapse: 1e-5")
FAILING = FailureProspect(3e-4, 4e-4, 1e-4, True, "collapse: 3e-4")
DOOMED = FailureProspect(0.001, 0.69, 0.9, False, "collapse: 0.001")
BEGUN = FailureProspect(0.0, 0.2, 0.9, False, "collapse: 0.2")
RAISED = ("Stiffness change is below −10 %.",)
SITUATIONS: dict[str, tuple[dict[str, Any], str, list[str]]] = {
    "well": ({}, "no", []),
    "not begun": ({"reasons": None}, "cannot_say", ["no_readings"]),
    "never begun, no agent": (
        {"reasons": None, "alive": False}, "cannot_say", ["no_readings", "agent_offline"],
    ),
    "offline": ({"alive": False}, "cannot_say", ["agent_offline"]),
    "silent sensor": ({"silent_s": 90}, "cannot_say", ["sensor_silent"]),
    "stale": ({"late_s": 900}, "cannot_say", ["readings_late"]),
    "offline explains stale": (
        {"alive": False, "late_s": 900, "silent_s": 9}, "cannot_say", ["agent_offline"],
    ),
    "learning": ({"reasons": states.LEARNING}, "cannot_say", ["learning"]),
    "training": ({"reasons": states.TRAINING}, "cannot_say", ["learning"]),
    "no mode": ({"reasons": states.NO_MODE}, "cannot_say", ["not_valid"]),
    "misfit": ({"reasons": states.MODEL_MISFIT}, "cannot_say", ["not_valid"]),
    "beyond covariates": ({"reasons": states.BEYOND_COVARIATES}, "cannot_say", ["not_valid"]),
    "measured before": ({"reasons": states.MEASURED_BEFORE}, "no", []),
    "beyond a limit": ({"raised": RAISED}, "act", ["limit_passed"]),
    "beyond two": ({"raised": RAISED * 2}, "act", ["limit_passed"] * 2),
    "beyond, offline": (
        {"raised": RAISED, "alive": False}, "act", ["limit_passed", "agent_offline"],
    ),
    "beyond, not valid": (
        {"raised": RAISED, "reasons": states.NO_MODE}, "act", ["limit_passed", "not_valid"],
    ),
    "likely beyond soon": ({"limits": [NEAR]}, "watch", ["limit_near"]),
    "hardly beyond": ({"limits": [FAR]}, "no", []),
    "probably passed, no alarm yet": ({"limits": [PASSED]}, "no", []),
    "safe": ({"failures": [SAFE]}, "no", []),
    "accepted risk reached later": ({"failures": [RISING]}, "watch", ["risk_rising"]),
    "accepted risk exceeded": ({"failures": [FAILING]}, "act", ["risk_too_high"]),
    "failure more likely than not, later": ({"failures": [DOOMED]}, "watch", ["risk_rising"]),
    "failure possible": ({"failures": [BEGUN]}, "watch", ["risk_rising"]),
    "one of two states fails": (
        {"failures": [SAFE, FAILING]}, "act", ["risk_too_high"],
    ),
    "repair is due": ({"plan": ("repair", "Repair now.")}, "act", ["repair_due"]),
    "close it": ({"plan": ("close", "Close it.")}, "act", ["repair_due"]),
    "inspection is due": ({"plan": ("inspect", "Inspect.")}, "act", ["inspection_due"]),
    "plan waits": ({"plan": ("wait", "Wait.")}, "no", []),
    "plan undecided": ({"plan": ("undecided", "Equal.")}, "no", []),
    "element changed": ({"suspects": ["storey2"]}, "watch", ["changed"]),
    "unexplained": ({"unexplained": True}, "watch", ["unexplained_change"]),
    "model disagrees": ({"disagrees": True}, "watch", ["model_disagrees"]),
    "message set aside": ({"set_aside": 1}, "watch", ["set_aside"]),
    "changed and offline": (
        {"suspects": ["k1"], "alive": False}, "watch", ["changed", "agent_offline"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SITUATIONS)
def test_each_situation_has_its_answer_and_its_reasons(name):
    changes, answer, kinds = SITUATIONS[name]
    told = conclude(dataclasses.replace(WELL, **changes))
    assert told.answer == answer
    assert [one.kind for one in told.findings] == kinds
    said = told.to_dict()
    assert (said["next"] is None) == (not kinds)
    assert all(one["text"] for one in said["findings"])


def test_more_evidence_against_it_never_calms():
    urgency = ("no", "cannot_say", "watch", "act")
    for first, second in itertools.combinations(SITUATIONS.values(), 2):
        if not first[0].keys().isdisjoint(second[0]):
            continue
        one, other = (
            conclude(dataclasses.replace(WELL, **each[0])) for each in (first, second)
        )
        both = conclude(dataclasses.replace(WELL, **first[0], **second[0]))
        least = max(urgency.index(one.answer), urgency.index(other.answer))
        if "alive" in {**first[0], **second[0]}:  # it explains why nothing comes
            assert both.answer != "no"
        assert urgency.index(both.answer) >= least


def test_every_kind_is_reached_and_no_answer_is_calm_with_a_finding():
    kinds = {kind for _, _, all_of_them in SITUATIONS.values() for kind in all_of_them}
    assert kinds == set(ANSWERS)
    assert "no" not in ANSWERS.values()


LOST_HALF = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.3}],
    "limit_states": [
        {
            "kind": "threshold", "name": "collapse", "quantity": "stiffness_change",
            "below": -0.35, "accepted": 0.2,
        }
    ],
}  # fmt: skip


def test_what_is_likely_ahead_is_told_though_nobody_has_asked(serving, ageing, eventually):
    server = serving(serve=ServeSettings(forecast_refresh_readings=10))
    twin = "/api/v1/twins/lab.beam"
    assert server.client.put(twin, json=LOST_HALF).status_code == 201
    server.feed(ageing(60, loss=0.2))
    kinds = {"limit_near", "risk_rising", "agent_offline"}

    def told():
        return server.get(twin).json()["conclusion"]

    def kinds_told():
        return {one["kind"] for one in told()["findings"]}

    assert eventually(lambda: kinds <= kinds_told(), 300.0)
    assert told()["answer"] == "watch"
    near = next(one["text"] for one in told()["findings"] if one["kind"] == "limit_near")
    asked = server.get(f"{twin}/forecast").json()["crossings"][0]["sentence"]
    assert near == asked
    risk = server.get(f"{twin}/risk").json()["limit_states"][0]["sentence"]
    assert risk in [one["text"] for one in told()["findings"]]


def test_of_a_past_instant_nothing_is_concluded(serving, ageing, eventually):
    server = serving()
    server.feed(ageing(5))
    assert eventually(lambda: server.count() == 5)
    assert server.get("/api/v1/twins/lab.beam", at="slow:2").json()["conclusion"] is None
    assert server.get("/api/v1/twins").json()["twins"][0]["conclusion"]["answer"] == (
        "cannot_say"
    )
