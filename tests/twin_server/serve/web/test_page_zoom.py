"""A chart is zoomed, stays so while readings come, and is saved as a picture or a table."""

import csv
import math

import pytest
from playwright.sync_api import expect

from tests.conftest import PATIENCE_MS

pytestmark = pytest.mark.browser

BODY = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}


def plot(page, quantity):
    return page.locator(f'[id="lab.beam"] .plot[data-quantity="{quantity}"]')


def ranges(page, quantity):
    """What a chart shows, in slow time and in height, and its ticks."""
    found = plot(page, quantity).evaluate(
        "plot => [plot.layout.xaxis.range, plot.layout.yaxis.range, "
        "[...plot.querySelectorAll('.x-tick')].length]"
    )
    return found[0], found[1], found[2]


def begins_at(page, quantity, low, high):
    """Wait until a chart begins between two slow times."""
    page.wait_for_function(
        "([quantity, low, high]) => { const [from] = document.querySelector("
        '`.plot[data-quantity="${quantity}"]`).layout.xaxis.range;'
        " return low <= from && from <= high; }",
        arg=[quantity, low, high],
        timeout=PATIENCE_MS,
    )
    return ranges(page, quantity)[0]


@pytest.fixture
def beam(serving, ageing, visit, eventually):
    server = serving()
    assert server.client.put("/api/v1/twins/lab.beam", json=BODY).status_code == 201
    server.feed(ageing(40))
    assert eventually(lambda: server.count() == 40)
    page = visit(server, "#lab.beam")
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", "40")
    return server, page


def area_of(page, quantity):
    """Where a chart draws now: each drawing makes it anew."""
    return plot(page, quantity).evaluate(
        "plot => plot.querySelector('.area').getBoundingClientRect().toJSON()"
    )


def drag(page, quantity, start=0.4, end=0.7):
    """Draw a horizontal line over a part of a chart, which zooms to it."""
    plot(page, quantity).scroll_into_view_if_needed()
    area = area_of(page, quantity)
    y = area["y"] + area["height"] / 2
    page.mouse.move(area["x"] + start * area["width"], y)
    page.mouse.down()
    page.mouse.move(area["x"] + end * area["width"], y, steps=5)
    page.mouse.up()


def test_a_zoom_holds_on_all_charts_while_readings_come_until_a_double_click(beam, ageing):
    server, page = beam
    whole = ranges(page, "frequency_hz")[0]
    place = whole[0] + 0.4 * (whole[1] - whole[0])
    drag(page, "frequency_hz")
    zoomed = begins_at(page, "frequency_hz", place - 2, place + 2)
    height = ranges(page, "frequency_hz")[1]
    assert begins_at(page, "damping_ratio", place - 2, place + 2) == zoomed
    server.feed(ageing(8, first=40))
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", "48")
    assert ranges(page, "frequency_hz")[:2] == (zoomed, height)
    assert 2 <= ranges(page, "frequency_hz")[2] <= 12
    area = area_of(page, "frequency_hz")
    page.mouse.dblclick(area["x"] + area["width"] / 2, area["y"] + area["height"] / 2)
    begins_at(page, "damping_ratio", whole[0], whole[0])
    assert begins_at(page, "frequency_hz", whole[0], whole[0])[1] > whole[1]
    assert page.complaints == []


def test_what_is_shown_is_saved_as_picture_and_table(beam):
    server, page = beam
    whole = ranges(page, "frequency_hz")[0]
    drag(page, "frequency_hz")
    start, end = begins_at(page, "damping_ratio", whole[0] + 5, whole[1])
    figure = plot(page, "frequency_hz").locator("xpath=..")
    with page.expect_download() as given:
        figure.get_by_role("button", name="PNG").click()
    assert given.value.suggested_filename == "lab.beam Natural frequency.png"
    assert given.value.path().read_bytes().startswith(b"\x89PNG")
    with page.expect_download() as given:
        page.get_by_role("link", name="Readings shown (CSV)").click()
    with given.value.path().open(newline="") as file:
        rows = list(csv.DictReader(file))
    told = server.get("/api/v1/twins/lab.beam/history").json()["points"]
    shown = [one["sequence"] for one in told if start <= one["slow_time"] <= end]
    assert 5 < len(shown) < 20
    assert [int(row["sequence"]) for row in rows] == shown


@pytest.mark.long
def test_a_part_of_a_long_history_is_chosen_and_a_zoom_shows_each_reading_of_it(
    serving, ageing, visit, eventually
):
    server = serving()
    assert server.client.put("/api/v1/twins/lab.beam", json=BODY).status_code == 201
    server.feed(ageing(4000))
    assert eventually(lambda: server.count() == 4000)
    page = visit(server, "#lab.beam")
    shown = page.get_by_label("Time shown")
    expect(shown.locator("option")).to_have_text(
        ["Latest readings", "Last hour", "Whole history"]
    )
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", "1000")
    shown.select_option("Last hour")
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", "3601")
    shown.select_option("Whole history")
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", "4000")
    assert int(plot(page, "frequency_hz").get_attribute("data-buckets")) > 0
    drag(page, "frequency_hz", 0.2, 0.26)
    expect(plot(page, "frequency_hz")).to_have_attribute("data-buckets", "0")
    start, end = ranges(page, "frequency_hz")[0]
    count = math.floor(end) - math.ceil(start) + 1  # one reading a second
    assert 100 < count < 400
    expect(plot(page, "frequency_hz")).to_have_attribute("data-points", str(count))
    assert page.complaints == []
