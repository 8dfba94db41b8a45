"""The page says when a threshold will be reached, and says it anew as readings arrive."""

import re

import pytest
from playwright.sync_api import expect

from slowtime.evolution.life.probability_words import foretold

pytestmark = pytest.mark.browser

TWIN = "/api/v1/twins/lab.beam"
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.25}],
    "forecast": {
        "thresholds": [{"quantity": "stiffness_change", "at": -0.9}],
        "horizon": 100.0,
    },
}


def part(page, selector):
    return page.locator(f'[id="lab.beam"] {selector}')


@pytest.mark.long
def test_time_to_threshold_and_bands_move_as_readings_arrive(
    serving, visit, ageing, eventually
):
    server = serving()
    assert server.client.put(TWIN, json=BODY).status_code == 201
    # Few readings: what they say is learnt twice, and that takes longer than all the rest.
    messages = ageing(64, loss=0.26)
    server.feed(messages[:40])
    assert eventually(lambda: server.count() == 40)
    assert server.client.get(f"{TWIN}/forecast", timeout=300).json()["valid"] is not None
    page = visit(server, "#lab.beam")
    rows = part(page, ".crossings tbody tr")
    expect(rows).to_have_count(2)
    limit, far = rows.nth(0), rows.nth(1)
    expect(limit.locator("th")).to_have_text("Stiffness change below −25\u202f%")
    expect(limit).to_have_attribute("data-source", "alarm")
    expect(far.locator("th")).to_have_text("Stiffness change reaches −90\u202f%")
    expect(far.locator("td").nth(0)).to_have_text("not within the horizon")
    expect(far.locator("td").nth(3)).to_contain_text("by 139 s")
    told = server.get(f"{TWIN}/forecast", points=40).json()
    median = told["crossings"][0]["times"][1]["slow_time"]
    assert 50 < median < 75
    expect(limit.locator("td").nth(1)).to_have_text(f"{foretold(median, told['since']):.6g} s")
    expect(limit).to_have_attribute("aria-label", told["crossings"][0]["sentence"])
    expect(limit.locator("svg.cdf polyline.probability")).to_have_count(1)
    expect(limit.locator("td.laws")).to_contain_text("%")
    expect(part(page, ".outlook > .facts")).to_contain_text(
        "the forecast only extrapolates the trend"
    )

    chart = part(page, '[data-quantity="stiffness_change"]')
    expect(chart).to_have_attribute("data-reached", "true")
    traces = chart.evaluate("plot => plot.data.map(t => [t.name, [...t.x], [...t.y]])")
    lines = {name: (x, y) for name, x, y in traces}
    x, y = lines["time to threshold"]
    assert x[1] == median
    assert y == [-25.0] * 3
    assert max(lines["forecast"][0]) == 139.0
    expect(page.locator('#legend [data-key="reached"]')).to_be_visible()

    server.feed(messages[40:])
    expect(part(page, ".outlook")).to_have_attribute("data-since", "63")
    expect(far.locator("td").nth(3)).to_contain_text("by 163 s")
    expect(limit.locator("td").nth(1)).to_have_text(re.compile(r"^(passed|[56]\d.*)$"))
    expect(chart).to_have_attribute("data-points", "64")
    moved = chart.evaluate("plot => plot.data.find(t => t.name === 'forecast').x[0]")
    assert moved > 63
    assert page.complaints == []
