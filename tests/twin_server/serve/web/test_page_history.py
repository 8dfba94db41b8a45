"""Long histories on the page: buckets instead of combs, gaps, renewals, and bounded memory."""

import pytest
from playwright.sync_api import expect

from slowtime_schemas.quantities import RENEWALS

pytestmark = pytest.mark.browser

NOMINAL = {"frequency_hz": 3.0, "damping_ratio": 0.02}
TRACES = "plot => Object.fromEntries(plot.data.map(t => [t.name, [[...t.x], [...t.y]]]))"
RENEWED_AT = 30


def part(page, selector, twin_id="lab.beam"):
    return page.locator(f'[id="{twin_id}"] {selector}')


def chart(page, quantity="stiffness_change", twin_id="lab.beam", **expected):
    plot = part(page, f'[data-quantity="{quantity}"]', twin_id)
    for name, value in expected.items():
        expect(plot).to_have_attribute(f"data-{name}", str(value))
    return plot


def moved(message, by):
    """The same reading, `by` seconds later."""
    ns = round(by * 1e9)
    return message.model_copy(
        update={
            "slow_time": message.slow_time + by,
            "t_ns": message.t_ns + ns,
            "start_ns": message.start_ns + ns,
        }
    )


def renewed(message, count):
    return message.model_copy(update={"covariates": {RENEWALS: float(count)}})


@pytest.fixture(scope="module")
def house(serving, ageing, eventually):
    """A beam that paused, whose true value was unknown for a while, and that was renewed."""
    server = serving()
    body = {
        "nominal": NOMINAL,
        "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
        "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.3}]},
    }
    for name in ("beam", "paused"):
        assert server.client.put(f"/api/v1/twins/lab.{name}", json=body).status_code == 201
    first = [renewed(one, 0) for one in ageing(RENEWED_AT)]
    second = [renewed(one, 1) for one in ageing(20, first=RENEWED_AT)]
    server.feed([*first, *second])
    paused = ageing(40, asset="paused")
    paused[10:15] = [one.model_copy(update={"truth": None}) for one in paused[10:15]]
    server.feed([*paused[:20], *(moved(one, 500.0) for one in paused[20:])])
    assert eventually(lambda: server.count() == 50)
    assert eventually(lambda: server.count("lab.paused") == 40)
    return server


@pytest.mark.long
def test_a_true_value_is_drawn_only_where_it_is_known(house, visit):
    page = visit(house, "#lab.paused")
    traces = chart(page, twin_id="lab.paused", points=40).evaluate(TRACES)
    x, y = traces["truth"]
    assert [i for i, value in enumerate(y) if value is None] == [10, 16]
    assert (x[9], x[11], x[15], x[17]) == (9, 15, 19, 520)
    assert traces["estimate"][1].index(None) == 20, "a pause is drawn as a gap"


@pytest.mark.long
def test_a_renewal_is_marked_and_every_line_stands_in_the_legend(house, visit):
    page = visit(house, "#lab.beam")
    plot = chart(page, points=50, forecast="true")
    shapes = plot.evaluate("plot => plot.layout.shapes.map(s => [s.name, s.x0])")
    assert ["renewed", RENEWED_AT] in shapes
    assert not [name for name, _ in shapes if name == "sudden"]
    assert plot.evaluate(TRACES)["estimate"][1].index(None) == RENEWED_AT
    page.locator(".events summary").click()
    expect(part(page, ".events")).to_contain_text("Structure renewed: from reading 30 on")

    lines = plot.evaluate(
        "plot => [...plot.layout.shapes, ...plot.data].filter(s => s.line?.dash)"
        ".map(s => s.line.color)"
    )
    keys = page.locator("#legend li:visible .key").evaluate_all(
        "keys => keys.flatMap(key => { const style = getComputedStyle(key); "
        "return ['Top', 'Left'].filter(s => style[`border${s}Style`] !== 'none')"
        ".map(s => style[`border${s}Color`]); })"
    )

    def rgb(colour):
        return f"rgb({', '.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))})"

    assert len(set(lines)) == 4  # true value, alarm, threshold, renewal
    assert {rgb(colour) for colour in lines} <= set(keys)
    assert page.complaints == []


@pytest.mark.long
def test_the_axis_has_a_calendar_below_the_time_of_the_structure(house, visit):
    page = visit(house, "#lab.beam", locale="en-GB", timezone_id="UTC")
    ticks = chart(page, points=50).locator(".x-tick")
    expect(ticks.first).to_contain_text("1 Jan, 00:00:00")
    expect(part(page, '[data-quantity="frequency_hz"] .x-title')).to_have_text("time [s]")


@pytest.mark.long
def test_at_a_past_instant_the_alarms_of_that_instant_stand(house, visit):
    page = visit(house, "#lab.beam?at=29")
    expect(part(page, ".answer").first).to_contain_text("Stiffness change is below −10\u202f%")
    page.evaluate("location.hash = '#lab.beam?at=5'")
    expect(part(page, ".instant")).to_have_text("At 5 s")
    expect(part(page, ".answer").first).to_be_hidden()


@pytest.mark.long
def test_a_long_history_is_drawn_in_buckets_that_keep_its_extremes(
    serving, visit, ageing, eventually
):
    server, count = serving(), 3000
    assert server.client.put("/api/v1/twins/lab.beam", json={"nominal": NOMINAL}).is_success
    messages = ageing(count)
    mode = messages[700].modes[0]
    wild = mode.model_copy(
        update={"frequency_hz": mode.frequency_hz.model_copy(update={"value": 3.2})}
    )
    messages[700] = messages[700].model_copy(update={"modes": (wild,)})
    server.feed(messages)
    assert eventually(lambda: server.count() == count)
    page = visit(server, "#lab.beam")
    latest = chart(page, "frequency_hz", points=1000)
    from_latest = latest.evaluate(TRACES)["estimate"][0]
    assert min(value for value in from_latest if value is not None) == 2000
    page.get_by_label("Time shown").select_option("Whole history")
    plot = chart(page, "frequency_hz", points=count)
    traces = plot.evaluate(TRACES)
    assert int(plot.get_attribute("data-buckets")) <= 200
    spread = [value for value in traces["estimate spread"][1] if value is not None]
    assert max(spread) == 3.2
    assert max(value for value in traces["estimate"][1] if value is not None) < 3.1
    expect(page.locator('#legend [data-key="buckets"]')).to_be_visible()
    assert page.complaints == []


@pytest.mark.long
def test_a_forecast_stays_until_a_newer_one_has_come(house, visit):
    page = visit(house, "#lab.beam")
    rows = part(page, ".crossings tbody tr")
    expect(rows).to_have_count(2)
    page.route(
        "**/forecast*",
        lambda route: route.fulfill(
            status=503, headers={"Retry-After": "1"}, json={"detail": "Too busy."}
        ),
    )
    expect(part(page, ".outlook")).to_contain_text(
        "The forecast could not be updated: Too busy."
    )
    expect(rows).to_have_count(2)
    chart(page, forecast="true")


TRAVELS = """async () => {
  const { Twin } = await import('/assets/twin.js');
  const { twins } = await (await fetch('/api/v1/twins')).json();
  const listed = twins.find(({ id }) => id === 'lab.beam');
  const twin = new Twin('lab.beam', () => {}), seen = [];
  twin.load = () => {};
  for (let i = 0; i < 2100; i += 1) {
    twin.arrive({ ...listed, sequence: 100 + i, slow_time: 100 + i, missing_before: 0 });
    if (i === 5) twin.lookAt(twin.points[5]);
    if (i % 500 === 499) seen.push(twin.scene.points.length);
  }
  return [seen, twin.all];
}"""


@pytest.mark.long
def test_a_past_instant_stays_in_sight_while_readings_arrive(house, visit):
    assert visit(house).evaluate(TRAVELS) == [[6, 6, 6, 6], True]


LIVES = """async ([count]) => {
  const { Twin } = await import('/assets/twin.js');
  const { sorted, tracesOf, rangeOf } = await import('/assets/traces.js');
  const { twins } = await (await fetch('/api/v1/twins')).json();
  const listed = twins.find(({ id }) => id === 'lab.beam');
  const twin = new Twin('lab.beam', () => {});
  let asked = 0;
  twin.load = () => { asked += 1; };
  for (let i = 0; i < count; i += 1) {
    twin.arrive({ ...listed, sequence: 100 + i, slow_time: 100 + i, missing_before: 0 });
    twin.happen({ number: 1000 + i, slow_time: 100 + i, kind: 'renewed', details: {} });
  }
  const { scene } = twin, quantity = 'frequency_hz', width = 540;
  const parts = sorted(scene, scene.points, quantity, width);
  const range = rangeOf(scene.points, quantity, parts);
  const traces = tracesOf(scene, quantity, parts, range, width);
  const drawn = traces.reduce((sum, { x }) => sum + x.length, 0);
  return [twin.points.length, twin.events.length, scene.points.length, drawn, asked];
}"""


@pytest.mark.long
def test_after_a_hundred_thousand_live_readings_no_more_is_held_or_drawn(house, visit):
    held, events, shown, drawn, asked = visit(house).evaluate(LIVES, [100_000])
    assert held <= 2000
    assert events == 100
    assert shown == 1000
    assert drawn <= 4000
    assert asked == 0, "what arrives is not fetched again"
