"""Whether anything is wrong: the answer to each situation, and laws over all of them."""

import dataclasses
import itertools

import pytest

from tests.twin_server.serve.situations import SITUATIONS, WELL
from twin_server.serve.conclusion import ANSWERS, conclude
from twin_server.settings import ServeSettings


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
