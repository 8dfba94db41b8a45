"""The page of a twin of many elements names what changed, in words, charts and shapes."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

PATIENCE_MS = 300_000
FRAME = "#lab.frame"
LOSS = (0.0, -0.08, 0.0)
SIZE = re.compile(r"^storey2 has lost [78]\.\d\u202f% ± [\d.]+\u202f% of its stiffness\.$")


@pytest.fixture(scope="module")
def frames(serving, frame, eventually):
    """A server with a frame that has stood still for 40 epochs."""
    server, made = serving(), frame(seed=2)
    put = server.client.put("/api/v1/twins/lab.frame", json=made.registration(name="Frame"))
    assert put.status_code == 201
    server.feed([made.epoch(i) for i in range(40)])
    assert eventually(lambda: server.count("lab.frame") == 40)
    return server, made


def part(page, selector):
    return page.locator(f'[id="lab.frame"] {selector}')


@pytest.mark.long
def test_the_page_names_the_storey_that_loses_stiffness_while_it_looks_on(
    frames, visit, eventually
):
    server, made = frames
    page = visit(server, FRAME)
    verdict = part(page, ".verdict")
    expect(verdict).to_have_text("No element has changed significantly.")
    expect(part(page, "table.elements tbody tr")).to_have_count(3)
    chart = part(page, '[data-quantity="elements"]')
    expect(chart).to_have_attribute("data-suspects", "")

    server.feed([made.epoch(i, LOSS) for i in range(40, 60)])
    expect(verdict).to_have_text(SIZE)
    expect(verdict).to_have_attribute("role", "status")
    changed = part(page, 'table.elements tr[data-changed="true"]')
    expect(changed).to_have_count(1)
    expect(changed).to_contain_text("storey2")
    expect(part(page, "details.events")).to_contain_text("storey2 has lost")

    expect(chart).to_have_attribute("data-suspects", "storey2")
    assert "storey2 −" in chart.get_attribute("aria-label")
    assert eventually(lambda: server.count("lab.frame") == 60)
    (point,) = server.get("/api/v1/twins/lab.frame/history", start="slow:59").json()["points"]
    expected = [100 * estimate["value"] for estimate in point["elements"].values()]
    shown = "plot => [plot.data[0].y, plot.data[0].x, plot.layout.shapes]"
    assert eventually(lambda: chart.evaluate(shown)[1] == expected)
    drawn = chart.evaluate(shown)
    assert drawn[0] == ["storey1", "storey2", "storey3"]
    assert [shape["x0"] for shape in drawn[2]] == [
        100 * estimate["lo"] for estimate in point["elements"].values()
    ]

    past = part(page, '[data-quantity="elements-history"]')
    expect(past).to_have_attribute("data-points", "40")
    names = past.evaluate("plot => plot.data.map(t => t.name)")
    assert [n for n in names if n in ("storey2 band", "storey2", "storey2 truth")] == [
        "storey2 band", "storey2", "storey2 truth",
    ]  # fmt: skip
    drawn_names = "plot => plot.data.map(t => t.name)"
    assert eventually(lambda: "storey2 forecast band" in past.evaluate(drawn_names))
    assert page.complaints == []


@pytest.mark.long
def test_where_each_element_is_heading_is_drawn(frames, visit, eventually):
    server, _ = frames
    page = visit(server, FRAME)
    past = part(page, '[data-quantity="elements-history"]')
    expect(past).to_have_attribute("data-forecast", "true", timeout=2 * PATIENCE_MS)

    def as_drawn():
        drawn = past.evaluate("plot => plot.data.map(t => [t.name, [...t.x], [...t.y]])")
        return {name: (x, y) for name, x, y in drawn}

    def as_served():
        answer = server.get("/api/v1/twins/lab.frame/forecast", points=40).json()["points"]
        return {
            f"{name} forecast": (
                [point["slow_time"] for point in answer],
                [100 * point["elements"][name]["value"] for point in answer],
            )
            for name in ("storey1", "storey2", "storey3")
        }

    # A forecast that the page asked for may be one reading older.
    assert eventually(lambda: as_served().items() <= as_drawn().items())
    suspects = part(page, '[data-quantity="elements"]').get_attribute("data-suspects")
    # Bands of all elements would hide one another.
    assert ("storey2 forecast band" in as_drawn()) == ("storey2" in suspects)
    expect(page.locator('#legend [data-key="ahead"]')).to_be_visible()
    assert page.complaints == []


@pytest.mark.long
def test_modes_are_listed_with_their_errors_and_drawn_with_their_shapes(frames, visit):
    server, _ = frames
    page = visit(server, FRAME)
    rows = part(page, "table.modes tbody tr")
    expect(rows).to_have_count(3)
    found = server.get("/api/v1/twins/lab.frame/modes").json()
    for place, mode in enumerate(found["modes"]):
        row = rows.nth(place)
        expect(row.locator("th")).to_have_text(str(place + 1))
        expect(row).to_contain_text(f"{mode['frequency_hz']['value']:.4f}")
        expect(row.locator("svg .shape")).to_have_count(1)
        label = row.locator("svg").get_attribute("aria-label")
        for channel, value in zip(found["channels"], mode["shape"]["re"], strict=True):
            assert f"{channel} {value:.2f}".replace("-", "−") in label
    # The line of rest, from the base up: the first mode leans to one side only.
    points = rows.nth(0).locator("svg .shape").get_attribute("points").split()
    across = [float(point.split(",")[0]) for point in points]
    assert len(across) == 4
    assert across == sorted(across) or across == sorted(across, reverse=True)


@pytest.mark.long
def test_the_page_fits_a_telephone(frames, visit):
    server, _ = frames
    page = visit(server, FRAME, viewport={"width": 390, "height": 800})
    expect(part(page, "table.modes tbody tr")).to_have_count(3)
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
    assert page.complaints == []


@pytest.mark.long
def test_a_twin_may_become_one_of_elements_and_go_back(serving, frame, visit, eventually):
    server, made = serving(), frame(seed=4)
    server.feed([made.epoch(i) for i in range(30)])
    assert eventually(lambda: server.count("lab.frame") == 30)
    page = visit(server, FRAME)
    stiffness = part(page, '[data-quantity="stiffness_change"]')
    expect(stiffness).to_be_visible()
    server.client.put("/api/v1/twins/lab.frame", json=made.registration())
    expect(part(page, ".verdict")).to_have_text(re.compile("No element"))
    expect(stiffness).to_be_hidden()
    server.client.put("/api/v1/twins/lab.frame", json={"changes": "stiffness"})
    expect(stiffness).to_be_visible()
    expect(part(page, ".verdict")).to_have_count(0)


@pytest.mark.long
def test_the_page_says_what_the_weather_does_not_explain(serving, features, visit, eventually):
    server, rng = serving(), np.random.default_rng(2)
    weather = {"names": ["temperature_c"], "train_epochs": 60}
    server.client.put("/api/v1/twins/lab.beam", json={"covariates": weather})
    made = []
    for i in range(80):
        warm = 10.0 * np.sin(i / 5.0)
        lost = 0.97 if i >= 70 else 1.0
        frequency = 3.0 * lost * np.exp(-0.004 * warm + 0.001 * rng.standard_normal())
        message = features(i, frequency_hz=float(frequency), sd=0.003)
        made.append(message.model_copy(update={"covariates": {"temperature_c": warm}}))
    server.feed(made[:50])
    assert eventually(lambda: server.count() == 50)
    page = visit(server, "#lab.beam")
    twin = page.locator('[id="lab.beam"]')
    expect(twin).to_contain_text("learning the effect of temperature_c")
    expect(twin.locator(".pill").first).to_have_text("learning the nominal model")
    server.feed(made[50:])
    expect(twin).to_contain_text("effect of temperature_c removed (linear)")
    said = re.compile(r"Since (69|70|71) s, stiffness change has changed by −[56]\.")
    expect(twin.locator(".reasons")).to_contain_text(said)
    expect(twin.locator("details.events")).to_have_attribute("data-severity", "alarm")
    assert page.complaints == []
