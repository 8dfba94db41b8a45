"""Mode shapes of a finite-element model move in space on the page, measured over model."""

import json
import re

import pytest
from axe_playwright_python.sync_playwright import Axe
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


INK = """([canvas, hex]) => {
  const [r, g, b] = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4)
    count += data[i + 3] > 200
      && Math.hypot(data[i] - r, data[i + 1] - g, data[i + 2] - b) < 12;
  return count;
}"""


@pytest.mark.parametrize(
    ("locale", "said"),
    [
        ("en-GB", ("loss of 15", "thick: certain", "Sensor measures", "upper legs −1")),
        ("de-DE", ("Verlust von 15", "dick: sicher", "Sensor misst", "upper legs −1")),
    ],
)
def test_lines_are_coloured_by_their_change_and_sensors_by_their_health(
    towered, visit, locale, said
):
    page = visit(towered, "#lab.tower", locale=locale, reduced_motion="reduce")
    canvas = canvas_of(page)
    expect(canvas).to_have_attribute("data-nodes", "12")
    tones = json.loads(canvas.get_attribute("data-tones"))
    assert set(tones) == set(GROUPS)
    assert [name for name, one in tones.items() if one["sure"]] == ["upper legs"]
    # In front, where nothing pales them, the weakened legs have their colour.
    assert canvas.evaluate(f"(c, hex) => ({INK})([c, hex])", tones["upper legs"]["tone"]) > 50
    # Nobody sends any more: what was measured stays, and the sensors are silent.
    heard = json.loads(canvas.get_attribute("data-sensors"))
    assert sum(heard.values()) == 8
    words = page.locator('[id="lab.tower"] .wireframe .tones')
    for text in said[:3]:
        expect(words).to_contain_text(text)
    assert said[3] in canvas.get_attribute("aria-label")
    found = Axe().run(page).response["violations"]
    assert [v["id"] for v in found if v["impact"] in ("serious", "critical")] == []
    assert page.complaints == []


HEALTHS = """async ([scene, changes]) => {
  const { WireframeView } = await import('/assets/wireframe.js');
  const healths = ['measures', 'missing', 'silent'];
  const sensors = scene.sensors.slice(0, 3).map((one, i) => (
    { ...one, node: scene.nodes.length - 1 - i, health: healths[i] }
  ));
  const view = new WireframeView({ ...scene, modes: [], changes, sensors }, { still: true });
  document.body.append(view.root);
  await new Promise(requestAnimationFrame);
  const drawn = [view.canvas.dataset.tones, view.canvas.dataset.sensors].map(JSON.parse);
  const picture = () => view.canvas.toDataURL(), before = picture();
  const label = view.canvas.getAttribute('aria-label');
  view.show({ ...view.scene, changes: {} });
  const uncoloured = picture(), keys = view.keys.children.length;
  view.close();
  view.root.remove();
  return [...drawn, before !== uncoloured, keys, label];
}"""


def test_colours_tell_size_and_certainty_and_dots_each_health(towered, visit):
    page = visit(towered)
    scene = towered.get(f"{TOWER}/shapes").json()
    changes = {
        "lower legs": {"value": 0.03, "sd": 0.01, "lo": 0.01, "hi": 0.05},
        "upper legs": {"value": -0.1, "sd": 0.01, "lo": -0.12, "hi": -0.08},
        "braces": {"value": -0.05, "sd": 0.04, "lo": -0.13, "hi": 0.03},
    }
    tones, sensors, coloured, keys, label = page.evaluate(HEALTHS, [scene, changes])
    assert [one["sure"] for one in tones.values()] == [True, True, False]
    # −10 % is the end of the scale, −5 % half way to it, and a gain goes another way.
    end, half, gain = (tones[name]["tone"] for name in ("upper legs", "braces", "lower legs"))
    assert end == "#b04900"
    middle = [(a + b) / 2 for a, b in zip(rgb(end), rgb("#5c636a"), strict=True)]
    assert rgb(half) == pytest.approx(middle, abs=1)
    assert rgb(gain)[2] > rgb(gain)[0]
    assert sensors == {"silent": 1, "missing": 1, "measures": 1}
    assert (coloured, keys) == (True, 3)
    assert "Sensor silent: " in label
    assert "upper legs −10\u202f% (95\u202f%: −12\u202f% … −8\u202f%)" in label


def rgb(tone):
    return [int(tone[at : at + 2], 16) for at in (1, 3, 5)]


def test_rest_tells_shapes_of_the_latest_epoch_and_of_an_earlier_one(towered):
    found = towered.get(f"{TOWER}/shapes").json()
    assert found["changed"] == ["upper legs"]
    assert found["changes"]["upper legs"]["hi"] < -0.05
    assert set(found["changes"]) == set(GROUPS)
    assert all(sensor["measured"] for sensor in found["sensors"])
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
