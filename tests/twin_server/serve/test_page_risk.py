"""The page says how probable failure is, by each limit state, as REST does."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

TWIN = "/api/v1/twins/lab.beam"
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "limit_states": [
        {
            "kind": "threshold", "name": "softer", "quantity": "stiffness_change",
            "below": -0.4, "accepted": 0.01,
        },
        {
            "kind": "resonance", "name": "near the machine",
            "excitation_hz": {"marginal": "normal", "mean": 2.9, "sd": 0.05}, "margin": 0.02,
        },
    ],
}  # fmt: skip


@pytest.mark.long
def test_each_limit_state_is_shown_with_its_band_and_drawn(serving, ageing, visit, eventually):
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    server.feed(ageing(60, loss=0.26))
    assert eventually(lambda: server.count() == 60)
    page = visit(server, "#lab.beam")
    section = page.locator('[id="lab.beam"] section.risk')
    rows = section.locator("tbody tr")
    expect(rows).to_have_count(2, timeout=60_000)
    told = server.get(f"{TWIN}/risk").json()["limit_states"]
    for number, state in enumerate(told):
        row = rows.nth(number)
        expect(row.locator("th")).to_have_text(state["name"])
        expect(row).to_have_attribute("aria-label", state["sentence"])
        index = state["now"]["beta"]
        # Below 1 in 10,000 no digits are said: models of loads do not know them.
        beta = "> 3.7" if index > 3.72 else f"{index:.2f}".replace("-", "−")
        expect(row.locator("td").nth(2)).to_have_text(beta)
    drawn = section.locator(".plot").evaluate("plot => plot.data.map(t => t.name)")
    assert {state["name"] for state in told} <= set(drawn)
    assert page.complaints == []
    assert Axe().run(page).response["violations"] == []


@pytest.mark.long
def test_nothing_is_said_of_failure_where_no_limit_state_is_registered(
    serving, ageing, visit, eventually
):
    server = serving()
    assert server.client.put(TWIN, json={"nominal": BODY["nominal"]}).status_code == 201
    server.feed(ageing(5))
    assert eventually(lambda: server.count() == 5)
    page = visit(server, "#lab.beam")
    expect(page.locator('[id="lab.beam"] .plot').first).to_be_visible()
    expect(page.locator('[id="lab.beam"] section.risk')).to_be_hidden()
