"""The plan of a twin and of a fleet by REST, the typed client and the page."""

import json

import pytest
from click.testing import CliRunner
from playwright.sync_api import expect

from slowtime_cli.__main__ import app
from slowtime_schemas.answers.plans import FleetPlanModel, PlanModel
from slowtime_services.client import Client

TWIN = "/api/v1/twins/lab.beam"
COSTS = {
    "currency": "EUR",
    "time_unit": "slow_time",
    "failure": {"mean": 900.0, "sd": 100.0},
    "repair": 40.0,
    "inspection": 1.0,
}
DECISION = {
    "failure": {"quantity": "stiffness_change", "below": -0.4},
    "horizon": 60.0,
    "inspection": {"name": "ultrasound", "sd": 0.01},
    "sensors": [{"name": "strain gauge", "sd": 0.01, "count": 5, "every": 2.0, "cost": 3.0}],
}
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "costs": COSTS,
    "decision": DECISION,
}


@pytest.fixture
def planned(serving, ageing, eventually):
    """Give a server whose beam has lost a quarter of its stiffness, and one without costs."""
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    server.feed(ageing(40, loss=0.26))
    assert eventually(lambda: server.count() == 40)
    return server


def test_a_plan_says_what_to_do_by_when_and_at_what_cost(planned):
    plan = planned.get(f"{TWIN}/plan").json()
    told = PlanModel.model_validate(plan)
    assert told.valid
    assert told.action in ("repair", "inspect", "wait", "undecided")
    costs = [option.cost.value for option in told.options]
    assert costs == sorted(costs)
    by_name = {option.name: option for option in told.options}
    assert by_name["repair_now"].cost.value >= 40.0
    for option in told.options:
        assert option.curve[-1] == pytest.approx(option.cost.value, rel=1e-6)
        assert len(option.curve) == len(told.times)
    names = {one.name for one in told.information}
    assert {"ultrasound", "strain gauge", "one more reading"} <= names
    assert all(one.value >= -1e-9 for one in told.information)
    assert told.times[-1].slow_time == pytest.approx(39.0 + 60.0)
    assert "EUR" in told.sentence
    assert planned.get(f"{TWIN}/plan").json() == plan

    with Client(planned.url) as client:
        typed = client.plan("lab.beam")
        assert typed.sentence == told.sentence
        assert [one.name for one in typed.options] == [one.name for one in told.options]
        fleet = client.fleet_plan(teams=2, window_d=3650.0)
        assert [one.id for one in fleet.assets] == ["lab.beam"]
    body = planned.get("/api/v1/fleet/plan", window_d=30).json()
    FleetPlanModel.model_validate(body)
    assert body["visits"] == 1
    assert body["assets"][0]["sentence"] == told.sentence


def test_lead_time_months_and_accepted_probability_can_be_asked_for(planned):
    free = planned.get(f"{TWIN}/plan").json()["last_order"]
    assert (free["by"], free["lead_time"], free["limit"]) == ("cost", 0.0, None)
    asked = {"lead_time": 15, "accepted": 0.05}
    told = PlanModel.model_validate(planned.get(f"{TWIN}/plan", **asked).json())
    last = told.last_order
    assert last is not None
    assert (last.by, last.limit, last.lead_time) == ("probability", 0.05, 15.0)
    assert last.probability <= 0.05
    assert last.order is not None
    assert last.effect is not None
    assert last.order.slow_time + 15.0 == pytest.approx(last.effect.slow_time)
    later = planned.get(f"{TWIN}/plan", **(asked | {"lead_time": 5})).json()["last_order"]
    assert later["order"]["ahead"] == pytest.approx(last.order.ahead + 10.0)
    with Client(planned.url) as client:
        typed = client.plan("lab.beam", lead_time=15.0, accepted=0.05).last_order
        assert typed is not None
        assert typed.sentence == last.sentence
    refused = planned.get(f"{TWIN}/plan", months="5-13")
    assert refused.status_code == 422
    assert "At query.months" in refused.json()["detail"]
    # What was asked once is not what is registered.
    assert planned.get(f"{TWIN}/plan").json()["last_order"] == free

    where = ["--server", planned.url, "--asset", "lab.beam", "--out", "-"]
    ran = CliRunner().invoke(
        app, ["plan", *where, "--setting", "lead_time=15", "--setting", "accepted=0.05"]
    )
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["last_order"]["sentence"] == last.sentence
    with_terms = DECISION | {"lead_time": 15.0, "accepted": 0.05}
    assert planned.client.put(TWIN, json=BODY | {"decision": with_terms}).is_success
    assert planned.get(f"{TWIN}/plan").json()["last_order"]["sentence"] == last.sentence


def test_without_costs_a_plan_says_what_to_register(serving):
    server = serving()
    bare = {"nominal": BODY["nominal"]}
    assert server.client.put(TWIN, json=bare).status_code == 201
    told = server.get(f"{TWIN}/plan").json()
    assert not told["valid"]
    assert "no `costs` and `decision`" in told["reasons"][0]
    fleet = server.get("/api/v1/fleet/plan").json()
    assert fleet["without"][0]["id"] == "lab.beam"
    assert fleet["assets"] == []


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"costs": None}, "without costs"),
        (
            {"decision": {**DECISION, "failure": {"quantity": "storey9", "below": -0.1}}},
            "storey9",
        ),
        (
            {
                "decision": {
                    **DECISION,
                    "failure": {"quantity": "stiffness_change", "below": 0.1},
                }
            },
            "as built",
        ),
        ({"costs": {**COSTS, "failure": {"mean": 0.0, "sd": 5.0}}}, "above 0"),
        ({"decision": {**DECISION, "inspection": {"name": "x"}}}, "sd, or detects_half"),
    ],
)
def test_costs_and_decisions_that_cannot_be_are_refused(serving, change, text):
    refused = serving().client.put(TWIN, json=BODY | change)
    assert refused.status_code == 422
    assert text in refused.text


@pytest.mark.browser
@pytest.mark.long
def test_the_page_shows_the_plan_with_its_chart_and_the_fleet_its_visits(planned, visit):
    told = planned.get(f"{TWIN}/plan", timeout=300).json()
    page = visit(planned, "#lab.beam")
    plan = page.locator('[id="lab.beam"] .plan')
    expect(plan.locator(".sentence")).to_have_text(told["sentence"], timeout=60_000)
    expect(plan.locator(".last-order")).to_have_text(told["last_order"]["sentence"])
    expect(plan).to_have_attribute("data-action", told["action"])
    expect(plan.locator(".options tbody tr")).to_have_count(len(told["options"]))
    expect(plan.locator(".options tbody tr").first.locator("th")).to_have_text(
        told["options"][0]["words"]
    )
    expect(plan.locator(".plot")).to_have_attribute("data-drawn", "6", timeout=60_000)
    first = plan.locator(".plot").evaluate("plot => [...plot.data[0].y]")
    assert first == pytest.approx(told["options"][0]["curve"])
    assert page.complaints == []
