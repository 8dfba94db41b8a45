"""The page in a real Chromium: changes of limits and costs are kept with authors and undone."""

from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_services.client import Client

pytestmark = pytest.mark.browser

TWIN = "/api/v1/twins/lab.beam"
BODY: dict[str, Any] = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.3}],
}


@pytest.fixture
def house(serving, ageing, eventually):
    """A server with a beam that has lost a fifth of its stiffness."""
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    server.feed(ageing(40))
    assert eventually(lambda: server.count() == 40)
    return server


def test_a_limit_is_changed_with_a_reason_and_undone_from_the_history(house, visit):
    page = visit(house, "#lab.beam")
    limits, changes = page.locator(".limits"), page.locator(".revisions")
    changes.locator("summary").press("Enter")
    expect(changes).to_contain_text("No changes yet.")
    limits.locator("summary").press("Enter")
    limits.get_by_role("button", name="Change the limits").press("Enter")
    limits.get_by_label("Limit", exact=True).fill("-25")
    limits.get_by_label("Name").fill("Ann Moreau")
    limits.get_by_label("Reason").fill("<b>Handbook</b>")
    limits.get_by_role("button", name="Save").press("Enter")
    expect(limits.locator(".answer")).to_contain_text("Saved.")
    item = changes.locator("li")
    expect(item).to_contain_text("Ann Moreau (token a local user): <b>Handbook</b>")
    expect(item.locator("del")).to_contain_text("below −30\u202f%")
    expect(item.locator("ins")).to_contain_text("below −25\u202f%")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []

    # A page that is opened later shows the same, and undoes it.
    other = visit(house, "#lab.beam")
    other.locator(".revisions summary").press("Enter")
    other.get_by_role("button", name="by Ann Moreau").press("Enter")
    expect(other.locator(".revisions .answer")).to_have_text("Put back.")
    expect(other.locator(".revisions li")).to_have_count(2)
    expect(other.locator(".revisions li.reversed")).to_contain_text("undone by change")
    (undone, first) = Client(house.url).changes("lab.beam")
    assert (undone.reverses, first.reversed_by) == (first.number, undone.number)
    assert house.get(TWIN).json()["registration"]["alarms"][0]["below"] == -0.3
    # The first page hears of it, and a form opened before is not saved over it.
    expect(changes.locator("li")).to_have_count(2)
    assert page.complaints == other.complaints == []


def test_a_form_that_was_overtaken_is_refused(house, visit):
    page = visit(house, "#lab.beam")
    limits = page.locator(".limits")
    limits.locator("summary").press("Enter")
    limits.get_by_role("button", name="Change the limits").press("Enter")
    Client(house.url).change("lab.beam", {"alarms": [BODY["alarms"][0] | {"below": -0.4}]})
    limits.get_by_label("Limit", exact=True).fill("-25")
    limits.get_by_role("button", name="Save").press("Enter")
    expect(limits.locator(".answer")).to_contain_text("Somebody has changed alarms")
    assert house.get(TWIN).json()["registration"]["alarms"][0]["below"] == -0.4


def test_costs_are_entered_and_the_plan_uses_them(house, visit):
    page = visit(house, "#lab.beam")
    costs = page.locator(".costs")
    expect(costs.locator("summary")).to_contain_text("Costs: none")
    expect(page.locator(".plan")).to_be_hidden()
    costs.locator("summary").press("Enter")
    costs.get_by_role("button", name="Change the costs").press("Enter")
    for label, value in (
        ("failure", "900000"), ("standard deviation: failure", "300000"), ("repair", "40000"),
        ("inspection", "800"), ("Failed at a change of [%]", "-30"),
        ("Horizon [time units]", "50"), ("Name", "Ann"),
    ):  # fmt: skip
        costs.get_by_label(label, exact=True).fill(value)
    costs.locator("select").first.select_option("slow_time")
    costs.get_by_label("Standard deviation of the change that an inspection").fill("2.5")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
    costs.get_by_role("button", name="Save").press("Enter")
    expect(costs.locator(".answer")).to_contain_text("Saved.")
    told = house.get(TWIN).json()["registration"]
    assert told["costs"]["failure"] == {"mean": 9e5, "sd": 3e5}
    assert (told["costs"]["repair"], told["costs"]["inspection"]) == (4e4, 800.0)
    assert told["decision"]["failure"]["below"] == -0.3
    assert (told["decision"]["horizon"], told["decision"]["inspection"]["sd"]) == (50.0, 0.025)
    expect(costs.locator("summary")).to_have_text(
        "Costs [EUR]: failure 900,000, repair 40,000, inspection 800"
    )
    expect(page.locator(".plan table")).to_contain_text("expected cost [EUR]")

    page.locator(".revisions summary").press("Enter")
    expect(page.locator(".revisions li")).to_contain_text("costs.failure.mean – → 900000")
    costs.get_by_role("button", name="Undo").press("Enter")
    expect(costs.locator("summary")).to_contain_text("Costs: none")
    assert house.get(TWIN).json()["registration"]["decision"] is None
    assert page.complaints == []
