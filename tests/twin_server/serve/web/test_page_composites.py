"""Composites on the page: under the fleet, opened to their probability, tree and members."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

PHONE = {"width": 375, "height": 800}
BEAMS = ("beam", "calm", "worn")


@pytest.fixture(scope="module")
def house(serving, ageing, eventually):
    server = serving()
    body = {
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
        "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.2}]},
    }
    losses = dict(zip(BEAMS, (0.17, 0.0, 0.19), strict=True))
    for name, loss in losses.items():
        assert server.client.put(f"/api/v1/twins/lab.{name}", json=body).status_code == 201
        server.feed(ageing(40, asset=name, loss=loss, sd=0.01))
    assert eventually(lambda: [server.count(f"lab.{name}") for name in BEAMS] == [40] * 3)
    ids = [f"lab.{name}" for name in BEAMS]
    line = {"kind": "line", "members": ids, "tree": {"k": 2, "of": ids}, "horizon": 20.0}
    yard = {"name": "Yard", "members": ["lab.line", "lab.worn"], "horizon": 20.0}
    for name, wanted in (("line", line), ("yard", yard)):
        answer = server.client.put(f"/api/v1/composites/lab.{name}", json=wanted)
        assert answer.status_code == 201, answer.text
    return server


@pytest.mark.long
def test_a_composite_opens_to_its_probability_its_tree_and_links_to_members(house, visit):
    page = visit(house)
    composites = page.locator(".composite")
    expect(composites).to_have_count(2)
    line, yard = composites.nth(0), composites.nth(1)
    expect(line.locator(".alarm")).to_contain_text("line of similar assets · 3 twins · 3 valid")
    opener = line.get_by_role("button", name="Show failure probability")
    expect(opener).to_have_attribute("aria-expanded", "false")
    opener.click()
    told = house.get("/api/v1/composites/lab.line").json()
    expect(line.locator(".told")).to_contain_text("Probability of failure within 20")
    expect(line.locator(".tree .gate")).to_have_text(
        "2 out of 3: works as long as at least 2 work"
    )
    expect(line.locator(".tree a")).to_have_count(3)
    values = {one["id"]: one["failure"]["value"] for one in told["twins"]}
    assert told["health"]["worst"] == max(values, key=lambda one: values[one])
    first = line.locator("table").first.locator("tbody th").first
    expect(first).to_have_text(told["health"]["worst"])
    expect(line.locator("table").nth(1)).to_contain_text(
        "Predicted for another asset of this kind"
    )
    yard.get_by_role("button").click()
    expect(yard.locator(".tree")).to_contain_text("Series: fails as soon as one fails")
    expect(yard.locator(".tree a")).to_have_count(1)  # the line is no twin
    found = [one["id"] for one in Axe().run(page).response["violations"]]
    assert found == []
    page.set_viewport_size(PHONE)
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
    yard.locator(".tree a").click()
    expect(page).to_have_url(f"{house.url}/#lab.worn")
