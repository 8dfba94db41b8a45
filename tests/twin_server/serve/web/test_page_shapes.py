"""Mode shapes of a finite-element model move in space on the page, measured over model."""

import re

import pytest
from playwright.sync_api import expect

from tests.twin_server.towers import GROUPS, LOSS, epoch, full_model, tower

pytestmark = [pytest.mark.browser, pytest.mark.long]

TOWER = "/api/v1/twins/lab.tower"
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def towered(serving, frame, eventually):
    """A server with a tower whose upper legs have been weaker since the 8th epoch."""
    started, made = serving(), frame(seed=5, asset="tower")
    model = full_model()
    body = {
        "changes": "elements",
        "model": tower(),
        "parameters": dict.fromkeys(GROUPS, 0.3),
        "learn_epochs": 6,
    }
    assert started.client.put(TOWER, json=body).status_code == 201
    started.feed([epoch(made, model, i, LOSS if i >= 8 else (0.0,) * 3) for i in range(14)])
    assert eventually(lambda: started.count("lab.tower") == 14)
    return started


def canvas_of(page):
    return page.locator('[id="lab.tower"] .wireframe canvas')


def picture_of(canvas):
    return canvas.evaluate("canvas => canvas.toDataURL()")


def test_the_weaker_group_and_the_measured_points_are_drawn_and_turn_by_keys(towered, visit):
    page = visit(towered, "#lab.tower")
    canvas = canvas_of(page)
    expect(canvas).to_have_attribute("data-nodes", "12")
    expect(canvas).to_have_attribute("data-lines", "24")
    expect(canvas).to_have_attribute("data-points", "4")
    expect(canvas).to_have_attribute("data-changed", "upper legs")
    told = page.locator('[id="lab.tower"] .wireframe [aria-live]')
    expect(told).to_contain_text(re.compile(r"MAC (1\.000|0\.9[89]\d)"))
    page.get_by_role("button", name="Stop the animation").last.click()
    before = picture_of(canvas)
    assert len(before) > 5000
    canvas.focus()
    page.keyboard.press("ArrowRight")
    assert picture_of(canvas) != before
    page.locator('[id="lab.tower"] .wireframe select').select_option("2")
    expect(canvas).to_have_attribute("data-mode", "2")
    assert page.complaints == []
    # Nothing comes from elsewhere: it works without the internet.
    assert all(url.startswith(towered.url) for url in page.requested)


def test_the_shapes_move_until_they_are_held(towered, visit):
    page = visit(towered, "#lab.tower")
    canvas = canvas_of(page)
    expect(canvas).to_have_attribute("data-nodes", "12")
    canvas.scroll_into_view_if_needed()
    page.wait_for_function(
        "([canvas, before]) => canvas.toDataURL() !== before",
        arg=[canvas.element_handle(), picture_of(canvas)],
    )


def test_a_phone_shows_the_shapes_without_scrolling_sideways(towered, visit):
    page = visit(towered, "#lab.tower", viewport=PHONE)
    canvas = canvas_of(page)
    expect(canvas).to_have_attribute("data-nodes", "12")
    box = canvas.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= PHONE["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    views = page.locator('[id="lab.tower"] .wireframe')
    for name in ("Corner", "Front", "Side", "Above"):
        expect(views.get_by_role("button", name=name)).to_be_visible()


def test_rest_tells_shapes_of_the_latest_epoch_and_of_an_earlier_one(towered):
    found = towered.get(f"{TOWER}/shapes").json()
    assert found["changed"] == ["upper legs"]
    both = [mode for mode in found["modes"] if mode["points"] and mode["wire"]]
    assert len(both) == 6
    for mode in both:
        assert mode["mac"] > 0.98
        assert mode["measured_hz"] == pytest.approx(mode["model_hz"], rel=0.02)
        assert mode["points"]["nodes"] == [4, 6, 8, 10]
    earlier = towered.get(f"{TOWER}/shapes", at="slow:7").json()
    assert earlier["changed"] == []
    assert earlier["modes"][0]["measured_hz"] > found["modes"][0]["measured_hz"]


def test_a_twin_without_a_geometry_says_how_to_give_one(towered):
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    assert towered.client.put("/api/v1/twins/lab.plain", json=body).status_code == 201
    refused = towered.get("/api/v1/twins/lab.plain/shapes")
    assert refused.status_code == 404
    assert "Register a `frame`" in refused.json()["detail"]
