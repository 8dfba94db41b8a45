"""The page in a real Chromium: a limit is moved on its chart, and the forecast is asked."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_services.client import Client

pytestmark = pytest.mark.browser

TWIN = "/api/v1/twins/lab.beam"
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.25}],
}
FAR = [{"quantity": "stiffness_change", "at": at} for at in (-0.7, -0.8)]


@pytest.fixture(scope="module")
def house(serving, ageing, eventually):
    """A server with a beam that has lost a fifth of its stiffness, and goes on losing it."""
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    server.feed(ageing(60))
    assert eventually(lambda: server.count() == 60)
    return server


def foretold(house, threshold):
    found = Client(house.url).forecast("lab.beam", points=1, threshold=threshold)
    (crossing,) = [one for one in found.crossings if one.threshold == pytest.approx(threshold)]
    return crossing


def test_a_limit_is_moved_by_keys_and_the_forecast_says_when_it_is_reached(house, visit):
    before = house.get(TWIN).json()["registration"]
    page = visit(house, "#lab.beam")
    grip = page.get_by_role("slider", name="Stiffness change: move the limit")
    expect(grip).to_have_count(1)
    expect(grip).to_have_attribute("aria-valuetext", "−25\u202f%")
    answer = page.locator(".supposition").first
    expect(answer).to_be_hidden()
    grip.focus()
    for key in ("ArrowUp", "ArrowUp", "PageDown", "ArrowDown"):
        grip.press(key)
    expect(grip).to_have_attribute("aria-valuenow", "-29.5")
    expect(grip).to_have_text("what if −29.5\u202f%")
    said = page.locator('figure:has([data-quantity="stiffness_change"]) .supposition')
    expect(said).to_contain_text("What if: Stiffness change below −29.5\u202f%")
    expect(said).to_contain_text("Nothing is stored.")
    crossing = foretold(house, -0.295)
    assert float(said.get_attribute("data-within")) == pytest.approx(crossing.within, abs=1e-9)
    expect(said).to_contain_text(f"{100 * crossing.within:.0f}\u202f% probable by")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []

    grip.press("Escape")
    expect(said).to_be_hidden()
    expect(grip).to_have_text("−25\u202f%")
    assert house.get(TWIN).json()["registration"] == before
    assert Client(house.url).changes("lab.beam") == ()
    assert page.complaints == []


def test_a_limit_is_dragged_and_put_back(house, visit, eventually):
    page = visit(house, "#lab.beam")
    grip = page.get_by_role("slider", name="Stiffness change: move the limit")
    plot = page.locator('[data-quantity="stiffness_change"]')
    expect(grip).to_be_visible()
    plot.scroll_into_view_if_needed()

    def y_of(percent):
        top = plot.bounding_box()["y"]
        return top + plot.evaluate("(plot, v) => plot.scene.scales.y.at(v)", percent)

    def off(percent):
        box = grip.bounding_box()
        return abs(box["y"] + box["height"] / 2 - y_of(percent))

    assert eventually(lambda: off(-25.0) < 2.0)  # once what stands above has come
    box = grip.bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 5, y_of(-15.0), steps=4)
    page.mouse.up()
    moved = float(grip.get_attribute("aria-valuenow"))
    assert abs(moved + 15.0) < 0.5
    assert eventually(lambda: off(moved) < 2.0)
    said = page.locator('figure:has([data-quantity="stiffness_change"]) .supposition')
    # The beam has lost more than that already.
    expect(said).to_contain_text("100\u202f% probable by")
    # Dragging a limit does not zoom.
    assert plot.evaluate("plot => plot.asked.zoom.y === null && plot.asked.zoom.x === null")
    said.get_by_role("button", name="Put back").click()
    expect(grip).to_have_attribute("aria-valuenow", "-25")
    expect(said).to_be_hidden()
    assert page.complaints == []


def test_a_chart_without_a_limit_has_a_handle_that_readings_do_not_move(
    serving, ageing, visit, eventually
):
    server = serving()
    server.client.put(TWIN, json={"nominal": BODY["nominal"]})
    server.feed(ageing(20))
    assert eventually(lambda: server.count() == 20)
    page = visit(server, "#lab.beam")
    grip = page.get_by_role("slider", name="Stiffness change: move the limit")
    start = float(grip.get_attribute("aria-valuenow"))
    assert -25.0 < start < 0.0
    grip.press("PageDown")
    server.feed(ageing(20, first=20))
    plot = page.locator('[data-quantity="stiffness_change"]')
    expect(plot).to_have_attribute("data-points", "40")
    expect(grip).to_have_attribute("aria-valuenow", f"{start - 5:g}")
    said = page.locator('figure:has([data-quantity="stiffness_change"]) .supposition')
    expect(said).to_contain_text("Stiffness change reaches")
    # Limits that are registered meanwhile have handles of their own, side by side at the edge.
    server.client.put(TWIN, json=BODY | {"forecast": {"thresholds": FAR}})
    expect(grip).to_have_count(3)
    assert [one.get_attribute("aria-valuenow") for one in grip.all()] == ["-25", "-70", "-80"]
    expect(said).to_be_hidden()
    left, right = (grip.nth(i).bounding_box() for i in (2, 1))
    assert left["y"] == right["y"]
    assert left["x"] + left["width"] < right["x"]
