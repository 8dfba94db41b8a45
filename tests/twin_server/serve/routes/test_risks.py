"""Failure probability over REST: each limit state by itself, from the forecast."""

import itertools

import pytest

from slowtime_services.client import Client

TWIN = "/api/v1/twins/lab.beam"
STATES = [
    {"kind": "threshold", "name": "softer", "quantity": "stiffness_change", "below": -0.2},
    {
        "kind": "resonance",
        "name": "near the machine",
        "excitation_hz": {"marginal": "normal", "mean": 2.9, "sd": 0.05},
        "margin": 0.02,
    },
    {
        "kind": "response",
        "name": "shaken",
        "load": {"kind": "noise", "psd": 0.01, "low_pass_hz": 6.0},
        "response": {
            "quantity": "displacement",
            "node": "mass",
            "statistic": "peak",
            "duration_s": 60.0,
        },
        "capacity": {"marginal": "lognormal", "mean": 0.03, "sd": 0.006},
        "events": 0.1,
        "accepted": 0.05,
    },
]


@pytest.fixture
def told(serving, ageing, eventually):
    server = serving()
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "limit_states": STATES}
    assert server.client.put(TWIN, json=body).status_code in (200, 201)
    server.feed(ageing(60))
    assert eventually(lambda: server.count() == 60)
    return server


def test_every_limit_state_is_told_with_its_band_and_its_time(told):
    found = told.client.get(f"{TWIN}/risk", params={"horizon": 500.0}).json()
    by_name = {one["name"]: one for one in found["limit_states"]}
    assert list(by_name) == ["softer", "near the machine", "shaken"]
    for one in by_name.values():
        points = one["points"]
        assert points[0]["slow_time"] == found["since"]
        assert points[-1]["slow_time"] == pytest.approx(found["horizon"])
        survival = [point["survival"]["value"] for point in points]
        assert all(a >= b - 1e-12 for a, b in itertools.pairwise(survival))
        assert one["within"]["value"] == pytest.approx(1.0 - survival[-1])
        now = one["now"]["probability"]
        assert 0.0 <= now["lo"] <= now["hi"] <= 1.0
        assert one["sentence"].startswith(one["name"])
        assert len(one["past"]) == 60


def test_it_agrees_with_the_forecast_of_the_same_threshold(told):
    asked = {"horizon": 500.0, "threshold": -0.2, "toward": "below"}
    crossing = told.client.get(f"{TWIN}/forecast", params=asked).json()["crossings"][0]
    risk = told.client.get(f"{TWIN}/risk", params={"horizon": 500.0}).json()
    assert risk["limit_states"][0]["within"]["value"] == pytest.approx(
        crossing["within"], abs=0.03
    )


@pytest.mark.long
def test_a_softer_structure_fails_more(told, ageing, eventually):
    first = told.client.get(f"{TWIN}/risk").json()["limit_states"]
    told.feed(ageing(120)[60:])
    assert eventually(lambda: told.count() == 120)
    later = told.client.get(f"{TWIN}/risk").json()["limit_states"]
    assert later[2]["now"]["probability"]["value"] > first[2]["now"]["probability"]["value"]


def test_a_twin_without_limit_states_says_what_to_do(serving, ageing, eventually):
    server = serving()
    server.feed(ageing(30))
    assert eventually(lambda: server.count() == 30)
    found = server.client.get(f"{TWIN}/risk").json()
    assert found["valid"] is False
    assert "Register the twin with" in found["reasons"][0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "threshold", "name": "x", "quantity": "colour", "below": -0.1}, "Allowed"),
        ({"kind": "threshold", "name": "x", "quantity": "stiffness_change"}, "one side"),
        (STATES[2] | {"load": {"kind": "record", "file": "a.csv"}}, "not kept"),
        (STATES[2] | {"capacity": {"marginal": "nothing", "mean": 1.0}}, "nothing"),
        (STATES[2] | {"maxima": [1.0, 2.0]}, "Give 8 at least"),
    ],
)
def test_a_limit_state_that_is_none_is_refused(serving, change, said):
    server = serving()
    answer = server.client.put(TWIN, json={"limit_states": [change]})
    assert answer.status_code == 422
    assert said in answer.text


def test_an_own_limit_state_that_is_not_installed_keeps_no_other_from_being_told(
    serving, ageing, eventually
):
    server = serving()
    states = [{"kind": "own", "name": "mine", "part": "nowhere"}, STATES[0]]
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "limit_states": states}
    server.client.put(TWIN, json=body)
    server.feed(ageing(40))
    assert eventually(lambda: server.count() == 40)
    mine, softer = server.client.get(f"{TWIN}/risk").json()["limit_states"]
    assert mine["valid"] is False
    assert "No limit_state 'nowhere' is installed" in mine["reasons"][0]
    assert softer["now"] is not None


def test_the_client_reads_it(told):
    found = Client(str(told.client.base_url)).risk("lab.beam", horizon=300.0)
    assert found.limit_states[2].name == "shaken"
    assert found.limit_states[2].now is not None
