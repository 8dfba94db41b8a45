"""What was known at an instant of the past, and what is raised and was heard now."""

import time

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health, Link
from slowtime_schemas.streams import HEALTH

TWIN = "/api/v1/twins/lab.beam"
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.05, "certainty": 0.9}],
}


@pytest.fixture(scope="module")
def aged(serving, ageing, eventually):
    """A server whose twin has lost so much that its alarm is raised; before and after."""
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    before = server.get(TWIN).json()
    messages = ageing(80, loss=0.2)
    server.feed(messages[:60])
    assert eventually(lambda: server.count() == 60)
    foretold = server.client.get(f"{TWIN}/forecast", timeout=300).json()
    server.feed(messages[60:])
    assert eventually(lambda: server.count() == 80)
    return server, before, foretold


@pytest.mark.long
def test_what_was_foretold_at_a_past_instant_is_foretold_again(aged):
    server, _, foretold = aged
    again = server.client.get(
        f"{TWIN}/forecast", params={"at": "slow:59.5"}, timeout=300
    ).json()
    assert again == foretold
    assert again["since"] == 59.0
    now = server.client.get(f"{TWIN}/forecast", timeout=300).json()
    assert now["since"] == 79.0
    early = server.get(f"{TWIN}/forecast", at="slow:-1").json()
    assert early["points"] == []
    wrong = server.get(f"{TWIN}/forecast", at="yesterday")
    assert (wrong.status_code, "At query.at" in wrong.json()["detail"]) == (422, True)


def test_an_alarm_that_is_raised_is_told_with_its_limit(aged):
    server, before, _ = aged
    assert before["raised"] == []
    raised = [{"quantity": "stiffness_change", "side": "below", "limit": -0.05}]
    assert server.get(TWIN).json()["raised"] == raised
    assert server.get("/api/v1/twins").json()["twins"][0]["raised"] == raised


def test_it_is_told_when_features_last_came(aged):
    server, before, _ = aged
    assert before["heard_ns"] is None
    heard = server.get(TWIN).json()["heard_ns"]
    assert 0 <= time.time_ns() - heard < 60e9


def test_it_is_told_what_the_link_of_the_agent_carries_and_when(serving, eventually):
    server = serving()
    server.client.put(TWIN, json=BODY)
    assert server.get(TWIN).json()["link"] is None
    link = Link(
        profile="metered",
        health_within_s=900.0,
        features_within_s=900.0,
        offline_within_s=120.0,
        month_bytes=7,
        budget_bytes=10**8,
    )
    health = Health(
        site="lab", asset="beam", boot="b9", sequence=0, t_ns=10**18, last_sequence=-1,
        first_held=-1, uptime_s=1.0, link=link,
    )  # fmt: skip
    server.bus.publish(HEALTH.key("lab", "beam"), encode(health), encoding=HEALTH.encoding)
    assert eventually(lambda: server.get(TWIN).json()["link"] == link.model_dump())
    assert server.client.delete(TWIN).status_code == 204
    server.client.put(TWIN, json=BODY)
    assert server.get(TWIN).json()["link"] is None
