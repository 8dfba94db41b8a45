"""The page in a real Chromium, over a real server with a real history."""

import functools
import itertools
import re

import pytest
from playwright.sync_api import expect

from slowtime.evolution import Reason
from twin_server.history.states import (
    LEARNING,
    NO_DAMPING,
    NO_MODE,
    NOT_REPRESENTABLE,
    sentences,
)

pytestmark = pytest.mark.browser

REFUSED = "net::ERR_CONNECTION_REFUSED"
BEAM = "#lab.beam"
CHARTS = ("frequency_hz", "damping_ratio", "stiffness_change", "mass_change")


def plot(page, quantity, twin_id="lab.beam"):
    return page.locator(f'[id="{twin_id}"] [data-quantity="{quantity}"]')


def drawn(page, quantity, twin_id="lab.beam"):
    """Wait until `quantity` is drawn, and give its traces by name."""
    expect(plot(page, quantity, twin_id)).to_have_attribute("data-assumed", re.compile(".+"))
    traces = plot(page, quantity, twin_id).evaluate(
        "plot => plot.data.map(t => ({name: t.name, x: [...t.x], y: [...t.y], "
        "symbol: t.marker && t.marker.symbol}))"
    )
    return {trace["name"]: trace for trace in traces}


def has(page, quantity, name, value, twin_id="lab.beam"):
    where = plot(page, quantity, twin_id)
    expect(where).to_have_attribute(f"data-{name}", str(value))


def history(server, twin_id="lab.beam"):
    return server.get(f"/api/v1/twins/{twin_id}/history", max_points=10_000).json()["points"]


def filled(server, messages, eventually, twin_id="lab.beam"):
    before = server.count(twin_id)
    server.feed(messages)
    assert eventually(lambda: server.count(twin_id) == before + len(messages))


def overflow(page):
    return page.evaluate("document.documentElement.scrollWidth - window.innerWidth")


def test_the_page_shows_the_history_to_the_last_number_and_asks_nobody_else(server, visit):
    page = visit(server, BEAM)
    has(page, "stiffness_change", "points", 300)
    has(page, "stiffness_change", "forecast", "true")
    points = history(server)

    stiffness = drawn(page, "stiffness_change")
    expected = [p["stiffness_change"] for p in points]
    assert stiffness["estimate"]["x"] == [p["slow_time"] for p in points]
    assert stiffness["estimate"]["y"] == [100 * e["value"] for e in expected]
    around = [100 * e["lo"] for e in expected] + [100 * e["hi"] for e in reversed(expected)]
    assert stiffness["95 % band"]["y"] == around
    assert stiffness["truth"]["y"] == [100 * p["truth"]["stiffness_change"] for p in points]
    assert stiffness["forecast"]["x"][0] >= points[-1]["slow_time"]

    frequency = drawn(page, "frequency_hz")
    assert frequency["estimate"]["y"] == [p["frequency_hz"]["value"] for p in points]
    assert "95 % band" in frequency
    assert drawn(page, "mass_change").keys() == {"truth"}
    has(page, "mass_change", "assumed", "true")

    assert page.complaints == []
    assert {url for url in page.requested if not url.startswith(("data:", server.url))} == set()


@pytest.mark.long
def test_every_number_is_said_in_words_with_its_unit(server, visit):
    page = visit(server, BEAM)
    has(page, "stiffness_change", "points", 300)
    last = history(server)[-1]["stiffness_change"]
    label = plot(page, "stiffness_change").get_attribute("aria-label")
    assert label.startswith("Stiffness change, 300 readings from 0 s to 299 s: last −")
    assert f"{abs(100 * last['value']):.2f}\u202f%, 95 % interval" in label
    twin = page.locator('[id="lab.beam"]')
    expect(twin).to_contain_text("Beam")
    expect(twin).to_contain_text("reading 299 at 299 s")
    expect(twin).to_contain_text("mass is assumed constant")
    expect(twin.locator(".events summary")).to_contain_text("): Registered by request")
    titles = [plot(page, quantity).locator(".y-title").text_content() for quantity in CHARTS]
    assert titles == ["frequency [Hz]", "damping ratio [%]", "change [%]", "change [%]"]
    for quantity in CHARTS:
        assert plot(page, quantity).locator(".x-title").text_content() == "time [s]"
        assert plot(page, quantity).locator(".y-tick").count() >= 3


@pytest.mark.long
def test_what_arrives_is_drawn_from_the_stream_without_a_reload(
    serving, visit, ageing, eventually
):
    server = serving()
    filled(server, ageing(30), eventually)
    page = visit(server, BEAM)
    has(page, "frequency_hz", "points", 30)
    page.evaluate("window.untouched = true")
    asked = len([url for url in page.requested if "/history" in url])
    filled(server, ageing(5, first=30), eventually)
    has(page, "frequency_hz", "points", 35)
    assert len([url for url in page.requested if "/history" in url]) == asked
    expect(page.locator('[id="lab.beam"]')).to_contain_text("reading 34")
    expect(page.locator('[id="lab.beam"]')).to_contain_text("last seen")
    assert page.evaluate("window.untouched")


def test_a_hostile_name_is_shown_and_not_obeyed(serving, visit, ageing, eventually):
    server = serving()
    name = '<img src=x onerror="window.hacked=1"><script>window.hacked=1</script>'
    body = {"name": name, "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
    assert server.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    filled(server, ageing(3), eventually)
    page = visit(server, BEAM)
    has(page, "stiffness_change", "points", 3)
    expect(page.locator("h2", has_text="onerror")).to_have_text(name)
    page.goto(f"{server.url}/#")
    expect(page.locator(".card .name")).to_have_text(name)
    page.goto(f"{server.url}/#/twins/lab.beam")  # no twin's address: the fleet
    expect(page.locator(".card .name")).to_have_text(name)
    expect(page.locator("#unknown")).to_be_hidden()
    page.goto(f"{server.url}/#<img src=x onerror=window.hacked=1>")
    expect(page.locator("#unknown")).to_contain_text("There is no twin <img")
    assert page.locator("img, main script").count() == 0
    assert page.evaluate("window.hacked") is None
    assert page.complaints == []


@pytest.mark.long
def test_without_twins_the_page_says_what_to_do_and_a_first_twin_appears_by_itself(
    serving, visit, ageing, eventually
):
    server = serving()
    page = visit(server)
    expect(page.locator("#empty")).to_contain_text("slowtime edge --simulate tower")
    filled(server, ageing(25), eventually)
    page.get_by_role("link", name="lab.beam").click()
    expect(page.locator('[id="lab.beam"] h2')).to_have_text("lab.beam")
    expect(page.locator("#empty")).to_be_hidden()
    has(page, "frequency_hz", "points", 25)


@pytest.mark.long
def test_a_server_that_is_gone_is_said_to_be_and_found_again(
    serving, visit, ageing, eventually, tmp_path
):
    database = tmp_path / "kept.sqlite"
    server = serving(database)
    filled(server, ageing(25), eventually)
    page = visit(server, BEAM)
    has(page, "frequency_hz", "points", 25)
    server.stop.set()
    server.thread.join(60)
    expect(page.locator("#connection")).to_have_text("connection lost, trying again")
    expect(page.locator("#lost")).to_contain_text("Connection lost, trying again.")
    has(page, "frequency_hz", "points", 25)
    again = serving(database, port=int(server.url.rsplit(":", 1)[1]))
    filled(again, ageing(5, first=25), eventually)
    expect(page.locator("#connection")).to_have_text("live")
    expect(page.locator("#lost")).to_be_hidden()
    has(page, "frequency_hz", "points", 30)
    assert [text for text in page.complaints if REFUSED not in text] == []


@pytest.mark.long
def test_what_is_not_valid_is_drawn_apart_and_explained(
    serving, visit, ageing, features, eventually
):
    server = serving()
    nominal = {"frequency_hz": 3.0, "damping_ratio": 0.02}
    for asset, changes in (("beam", "stiffness"), ("both", "both")):
        body = {"changes": changes, "nominal": nominal, "damping_coefficient_sd": 0.5}
        if asset == "beam":
            body["alarms"] = [{"quantity": "stiffness_change", "below": -0.15}]
        server.client.put(f"/api/v1/twins/lab.{asset}", json=body)
    filled(server, [*ageing(20), features(20, frequency_hz=1.5)], eventually)
    filled(server, ageing(20, asset="both", loss=0.0), eventually, "lab.both")
    page = visit(server, BEAM, viewport={"width": 1200, "height": 1400})

    has(page, "stiffness_change", "invalid", 1)
    has(page, "stiffness_change", "points", 20)
    odd = drawn(page, "stiffness_change")["not valid"]
    assert odd["symbol"] == ["triangle-down-open"]
    assert odd["y"][0] > -40.0, "one wild reading flattens all the others"
    twin = page.locator('[id="lab.beam"]')
    expect(twin.locator(".pill").first).to_have_text("not valid")
    expect(twin.locator(".reasons")).to_contain_text("outside the recommended range")
    expect(page.locator('[data-key="invalid"]')).to_be_visible()
    expect(page.locator('[data-key="limit"]')).to_be_visible()
    limits = "plot => plot.layout.shapes.map(shape => shape.y0)"
    assert plot(page, "stiffness_change").evaluate(limits) == [-15.0]
    assert plot(page, "frequency_hz").evaluate(limits) == []

    page.goto(f"{server.url}/#lab.both")
    has(page, "mass_change", "inseparable", 20, "lab.both")
    has(page, "mass_change", "bands", 0, "lab.both")
    both = page.locator('[id="lab.both"]')
    expect(both.locator(".pill").first).to_have_text(
        "mass and stiffness not separately identifiable"
    )
    expect(page.locator('[data-key="inseparable"]')).to_be_visible()
    has(page, "frequency_hz", "points", 20, "lab.both")


@pytest.mark.long
def test_the_page_tells_the_reasons_apart_that_say_nothing_against_the_frequency(server, visit):
    page = visit(server, BEAM)
    judged = {
        bit: page.evaluate(
            "async text => (await import('/assets/words.js'))"
            ".standing({valid: false, reasons: [text]})",
            sentences(bit)[0],
        )
        for bit in (*map(int, Reason), NO_MODE, LEARNING, NO_DAMPING, NOT_REPRESENTABLE)
    }
    alike = (Reason.NOT_SEPARABLE, Reason.DAMPING_UNKNOWN, Reason.DAMPING_UNCERTAIN, NO_DAMPING)
    expected = dict.fromkeys(judged, "invalid") | dict.fromkeys(map(int, alike), "inseparable")
    assert judged == expected | {LEARNING: "learning"}


@pytest.mark.long
def test_lost_features_break_the_line_and_its_band(
    serving, visit, ageing, eventually, settings
):
    impatient = settings.healing.model_copy(update={"absent_patience_s": 0.1})
    server = serving(healing=impatient)
    whole = ageing(30)
    filled(server, whole[:12] + whole[18:], eventually)
    page = visit(server, BEAM)
    has(page, "frequency_hz", "points", 24)
    has(page, "frequency_hz", "bands", 2)
    assert drawn(page, "frequency_hz")["estimate"]["y"].index(None) == 12


@pytest.mark.long
def test_on_a_phone_nothing_is_wider_than_the_screen(server, visit):
    phone = {"width": 390, "height": 844}
    page = visit(
        server, BEAM, viewport=phone, has_touch=True, is_mobile=True, color_scheme="dark"
    )
    has(page, "stiffness_change", "points", 300)
    assert overflow(page) <= 0
    for quantity in CHARTS:
        box = plot(page, quantity).locator("svg.drawing").bounding_box()
        assert box["x"] >= 0
        assert 300 < box["width"] <= 390
    assert page.complaints == []


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_and_lines_stand_out_from_their_ground(server, visit, scheme):
    page = visit(server, BEAM, color_scheme=scheme)

    @functools.cache
    def colour(name):
        return page.evaluate(
            "name => getComputedStyle(document.documentElement).getPropertyValue(name).trim()",
            f"--{name}",
        )

    words = [("ink", "faint", "invalid", "inseparable"), ("paper", "card")]
    pairs = [*itertools.product(*words), *((s, f"{s}-back") for s in ("good", "warn", "bad"))]
    lines = itertools.product(("estimate", "ahead", "truth"), ("card",))
    assert {pair for pair in pairs if contrast(*map(colour, pair)) < 4.5} == set()
    assert {pair for pair in lines if contrast(*map(colour, pair)) < 3.0} == set()
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(20, 23, 26)") == (scheme == "dark")


@pytest.mark.long
def test_a_twin_that_is_deleted_leaves_the_page(serving, visit, ageing, eventually):
    server = serving()
    filled(server, ageing(3), eventually)
    page = visit(server, BEAM)
    expect(page.locator("section.twin")).to_have_count(1)
    assert server.client.delete("/api/v1/twins/lab.beam").status_code == 204
    expect(page.locator("section.twin")).to_have_count(0)
    expect(page.locator("#unknown")).to_contain_text("There is no twin lab.beam.")
