"""The page in a real Chromium: limits are changed and put back by those who may."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

BODY = {
    "changes": "stiffness",
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.3, "certainty": 0.9}],
    "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.2}]},
}


def registered(server):
    told = server.client.get("/api/v1/twins/lab.beam").json()["registration"]
    return (
        [(a["quantity"], a["below"], a["above"], a["certainty"]) for a in told["alarms"]],
        [(one["quantity"], one["at"]) for one in told["forecast"]["thresholds"]],
    )


def test_limits_are_changed_refused_and_put_back(serving, ageing, visit, eventually):
    server = serving()
    assert server.client.put("/api/v1/twins/lab.beam", json=BODY).status_code == 201
    server.feed(ageing(40))
    assert eventually(lambda: server.count() == 40)
    before = registered(server)
    assert before == (
        [("stiffness_change", -0.3, None, 0.9)],
        [("stiffness_change", -0.2)],
    )
    page = visit(server, "#lab.beam")
    limits = page.locator(".limits")
    limits.locator("summary").click()
    expect(limits.locator("li")).to_have_text(
        [
            "alarm when Stiffness change is below −30\u202f% with 90\u202f% certainty",
            "forecast of when Stiffness change reaches −20\u202f%",
        ]
    )
    limits.get_by_role("button", name="Change the limits").click()
    limits.get_by_role("button", name="Add a limit").click()
    rows = limits.locator("form p:has(select)")
    expect(rows).to_have_count(3)
    rows.nth(0).get_by_label("Limit").fill("-12.5")
    rows.nth(1).get_by_role("button", name="Remove").click()
    last = rows.nth(1)
    last.get_by_label("Quantity").select_option("frequency_hz")
    last.get_by_label("Side").select_option("above")
    last.get_by_label("Limit").fill("3.25")
    limits.get_by_role("button", name="Save").click()
    expect(limits.locator(".answer")).to_contain_text("Saved.")
    assert registered(server) == (
        [
            ("stiffness_change", -0.125, None, 0.9),
            ("frequency_hz", None, 3.25, 0.975),
        ],
        [],
    )
    expect(limits.locator("li")).to_have_count(2)
    expect(limits.locator("li").nth(1)).to_contain_text("above 3.25\u202fHz")

    changes = page.locator(".revisions")
    changes.locator("summary").click()
    changes.get_by_role("button", name="Undo").first.click()
    expect(limits.locator("li").nth(0)).to_contain_text("below −30\u202f%")
    assert registered(server) == before
    assert page.complaints == []
