"""Each view of the page as people meet it: fleet, twin at any instant, what-if, recordings."""

import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.record import RecordingWriter
from twin_server.settings import DiagnoseSettings, GapSettings

pytestmark = pytest.mark.browser

LOSS = (0.0, -0.08, 0.0)
FELL = 40
"""Epoch from which a storey of the frame has lost stiffness."""
PHONE, DESK = {"width": 375, "height": 800}, {"width": 1200, "height": 900}
VIEWS = {
    "fleet": ("#", '.card[data-twin="lab.frame"] .spark'),
    "state": ("#lab.frame", 'table.modes .moving, [data-quantity="elements"] svg.drawing'),
    "diagnosis": ("#lab.frame/diagnosis", ".diagnosis .orders"),
    "recordings": ("#recordings", '[data-recording="kept.mcap"]'),
}
LOOKS = [("light", DESK), ("dark", PHONE), ("dark", DESK), ("light", PHONE)]


@pytest.fixture(scope="module")
def house(serving, frame, ageing, eventually, tmp_path_factory):
    """A server with a frame that has weakened, a beam beyond its limit, and a recording."""
    folder = tmp_path_factory.mktemp("kept")
    server = serving(diagnose=DiagnoseSettings(recordings=folder), gap=GapSettings(every_s=0.0))
    made = frame(seed=2)
    bodies = {
        "lab.beam": {
            "name": "Beam",
            "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
            "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
        },
        "lab.calm": {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}},
        "lab.frame": made.registration(name="Frame"),
    }
    for twin_id, body in bodies.items():
        assert server.client.put(f"/api/v1/twins/{twin_id}", json=body).status_code == 201
    server.feed([made.epoch(i, LOSS if i >= FELL else (0.0, 0.0, 0.0)) for i in range(60)])
    server.feed(ageing(40))
    server.feed(ageing(30, asset="calm", loss=0.0))
    for twin_id, count in (("lab.frame", 60), ("lab.beam", 40), ("lab.calm", 30)):
        assert eventually(lambda i=twin_id, n=count: server.count(i) == n)
    with RecordingWriter(folder / "kept.mcap") as writer:
        for message in ageing(5, asset="other"):
            writer.write(FEATURES, "lab", "other", encode(message), message.t_ns)
    return server


PLANNED = {
    "name": "Turm", "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "costs": {"failure": 1e6, "repair": 4e4, "inspection": 2e3, "time_unit": "slow_time"},
    "decision": {
        "failure": {"quantity": "stiffness_change", "below": -0.5},
        "horizon": 60.0, "inspection": {"name": "visit", "sd": 0.02},
    },
}  # fmt: skip
"""A twin of which is to be decided when it is repaired."""


def part(page, selector, twin_id="lab.frame"):
    return page.locator(f'[id="{twin_id}"] {selector}')


def overflow(page):
    return page.evaluate("document.documentElement.scrollWidth - window.innerWidth")


@pytest.mark.long
def test_the_fleet_says_of_each_twin_what_matters_the_urgent_first(house, visit, ageing):
    page = visit(house)
    cards = page.locator(".card")
    expect(cards).to_have_count(3)
    names = cards.evaluate_all("all => all.map(card => card.dataset.twin)")
    assert names == ["lab.beam", "lab.frame", "lab.calm"]
    beam, frame, calm = cards.nth(0), cards.nth(1), cards.nth(2)
    low = "Stiffness change is below −10\u202f%"
    expect(beam.locator(".alarm")).to_have_text(f"▲ {low}; {OFFLINE}")
    expect(frame.locator(".alarm")).to_have_text(f"△ storey2 has changed; {OFFLINE}")
    expect(frame).to_contain_text("Change of storey2")
    expect(calm.locator(".alarm")).to_have_text(f"○ {OFFLINE}")
    expect(calm.locator(".pill").nth(0)).to_have_text("✓ valid")
    expect(calm.locator(".pill").nth(1)).to_have_text("○ agent offline")
    expect(calm.locator(".seen")).to_have_text(re.compile(r"last seen \d+ (s|min) ago"))
    expect(page.locator(".fleet > .verdict")).to_have_text(
        "Is anything wrong? Yes: act now. 1 of 3: the limit of an alarm is passed: Beam "
        f"({low}). 3 of 3: {OFFLINE}: Beam, lab.calm, Frame. 1 of 3: elements have changed: "
        "Frame (storey2 has changed)."
    )
    expect(page.locator(".summary")).to_contain_text(
        "3 twins · 1 with an alarm · 1 changed · 3 valid"
    )
    expect(calm.locator(".sparkplace")).to_have_attribute("data-points", "30")
    house.feed(ageing(4, asset="calm", first=30, loss=0.0))
    expect(calm.locator(".sparkplace")).not_to_have_attribute("data-points", "30")
    assert page.complaints == []


OFFLINE = "the sensor agent is offline, so nothing new is known"
CALM = {"slow_time": 1.0, "valid": True, "reasons": [], "registration": {}, "raised": []}
LEARNS = "4 of 5: still learning the reference: t1, t2, t3 and 1 more."
ANSWERS = [
    ([], "good", "No. The twin has a valid estimate, no alarm and no unexplained change."),
    ([("no", [])], "good", "No. All 2 twins have a valid estimate, no alarm and no"),
    ([("cannot_say", ["agent_offline"])], "waiting", "Cannot say. 1 of 2: the sensor agent"),
    ([("cannot_say", ["learning"])] * 4, "waiting", f"Cannot say. {LEARNS}"),
    ([("watch", ["limit_near", "agent_offline"])], "waiting", "Possibly: keep watching. 1"),
    ([("cannot_say", ["not_valid"]), ("act", ["risk_too_high"])], "bad", "Yes: act now. "),
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(("others", "mood", "sentence"), ANSWERS)
def test_the_fleet_answers_in_words_whether_anything_is_wrong(
    house, visit, others, mood, sentence
):
    told = [
        {"answer": answer, "findings": [{"kind": kind, "text": "."} for kind in kinds]}
        for answer, kinds in [("no", []), *others]
    ]
    states = [CALM | {"id": f"t{i}", "conclusion": one} for i, one in enumerate(told)]
    answer = "async (all) => (await import('/assets/conclusion.js')).fleetConclusion(all)"
    said = visit(house).evaluate(answer, states)
    assert said[0] == mood
    assert said[1].startswith(f"Is anything wrong? {sentence}")


@pytest.mark.long
def test_at_a_past_instant_everything_shows_that_instant(house, visit):
    page = visit(house, "#lab.frame")
    verdict = part(page, ".verdict")
    expect(verdict).to_contain_text("storey2 has lost")
    slider = page.get_by_role("slider", name="Selected time")
    slider.focus()
    for _ in range(10):
        page.keyboard.press("PageDown")
    expect(part(page, ".instant")).to_have_text("At 29 s")
    expect(slider).to_have_attribute("aria-valuetext", "At 29 s")
    page.keyboard.press("ArrowRight")
    expect(part(page, ".instant")).to_have_text("At 30 s")
    expect(verdict).to_have_text("No element has changed significantly.")
    expect(part(page, ".state")).to_contain_text("reading 30 at 30 s")
    expect(part(page, ".events")).not_to_contain_text("storey2 has lost")
    expect(part(page, "table.modes caption")).to_have_text("Modes at 30 s")
    then = house.get("/api/v1/twins/lab.frame/modes", at="slow:30").json()["modes"]
    rows = part(page, "table.modes tbody tr")
    for row, mode in enumerate(then):
        expect(rows.nth(row)).to_contain_text(f"{mode['frequency_hz']['value']:.4f}")
    expect(part(page, ".outlook")).to_have_attribute("data-since", "30")
    chart = part(page, '[data-quantity="frequency_hz"]')
    expect(chart).to_have_attribute("data-points", "31")
    drawn = chart.evaluate(
        "plot => [plot.data.find(t => t.name === 'what came after').x, plot.layout.shapes]"
    )
    assert (drawn[0][0], drawn[0][-1]) == (30, 59)
    assert [(line["x0"], line["x1"]) for line in drawn[1]] == [(30, 30)]

    page.wait_for_function("() => location.hash === '#lab.frame?at=30'")
    page.reload()
    expect(part(page, ".instant")).to_have_text("At 30 s")
    page.get_by_role("button", name="Now").click()
    expect(verdict).to_contain_text("storey2 has lost")
    expect(part(page, ".instant")).to_have_text("Now: 59 s")
    page.wait_for_function("() => location.hash === '#lab.frame'")
    assert page.complaints == []


@pytest.mark.long
def test_who_travels_is_not_thrown_back_to_the_last_halt(house, visit):
    page = visit(house, "#lab.frame?at=29")
    instant = part(page, ".instant")
    expect(instant).to_have_text("At 29 s")
    # What the address says between two halts, when the list of twins comes in again.
    page.evaluate("history.replaceState(null, '', '#lab.frame?at=41')")
    for _ in range(2):
        page.wait_for_event("response", lambda answer: answer.url.endswith("/api/v1/twins"))
    page.evaluate("new Promise(requestAnimationFrame)")
    expect(instant).to_have_text("At 29 s")
    page.evaluate("location.hash = '#lab.frame?at=30'")
    expect(instant).to_have_text("At 30 s")
    assert page.complaints == []


@pytest.mark.long
def test_shapes_move_until_they_are_held(house, visit):
    page = visit(house, "#lab.frame")
    shape = part(page, "table.modes .moving").first
    expect(shape).to_be_visible()
    where = "shape => shape.getAttribute('points')"
    before = shape.evaluate(where)
    page.wait_for_function(
        "before => document.querySelector('.modes .moving').getAttribute('points') !== before",
        arg=before,
    )
    expect(part(page, ".moves")).to_contain_text("slower than the real motion")
    page.get_by_role("button", name="Stop the animation").click()
    held = shape.evaluate(where)
    page.evaluate("new Promise(done => setTimeout(done, 120))")
    assert shape.evaluate(where) == held
    page.emulate_media(reduced_motion="reduce")
    page.reload()
    expect(page.get_by_role("button", name="Animate the shapes")).to_be_visible()
    page.emulate_media(reduced_motion="no-preference")


@pytest.mark.long
def test_what_if_a_load_came_is_answered_with_bands(house, visit):
    page = visit(house, "#lab.frame")
    part(page, ".whatif summary").click()
    form = part(page, ".whatif form")
    form.get_by_label("Load").select_option("harmonic")
    expect(form.get_by_label("acting at")).to_contain_text("floor2")
    form.get_by_label("frequency").fill("2.0")
    form.get_by_label("duration").fill("4")
    form.get_by_label("response shown").select_option("displacement")
    form.get_by_role("button", name="Simulate").click()
    answer = part(page, ".whatif .answer")
    expect(answer.locator(".told")).to_contain_text("Peak")
    load = {"kind": "harmonic", "amplitude": 1.0, "frequency_hz": 2.0}
    order = {"load": load, "on": "base", "quantity": "displacement", "duration_s": 4.0}
    told = house.client.post("/api/v1/twins/lab.frame/simulate", json=order, timeout=300).json()
    nodes = list(told["outputs"])
    assert answer.locator("select option").all_text_contents() == nodes
    drawn = answer.locator(".plot").evaluate("plot => plot.data.map(t => [t.name, [...t.y]])")
    response = told["outputs"][nodes[-1]]
    assert drawn[1] == ["response", response["value"]]
    assert drawn[0] == ["95 % band", response["lo"] + response["hi"][::-1]]
    assert answer.locator(".y-title").text_content() == "displacement [m]"
    assumed = answer.locator("p").last
    expect(assumed).to_have_text(re.compile(r"^(Assumed: [^.]+\. ?)+$"))
    form.get_by_label("duration").fill("100000")
    form.get_by_role("button", name="Simulate").click()
    expect(part(page, ".whatif [role=alert]")).to_contain_text("samples")


@pytest.mark.long
def test_a_recording_is_given_got_played_and_deleted(house, visit, ageing, tmp_path):
    page = visit(house, "#recordings")
    expect(page.locator('[data-recording="kept.mcap"]')).to_contain_text(
        "lab.other: 5 features"
    )
    wrong, right = tmp_path / "no recording.mcap", tmp_path / "my day.mcap"
    wrong.write_bytes(b"#!/bin/sh")
    with RecordingWriter(right) as writer:
        for message in ageing(20, asset="new"):
            writer.write(FEATURES, "lab", "new", encode(message), message.t_ns)
    page.get_by_label("Upload a recording").set_input_files(wrong)
    alert = page.locator(".recordings > [role=alert]")
    expect(alert).to_contain_text("is not taken in")
    page.get_by_label("Upload a recording").set_input_files(right)
    card = page.locator('[data-recording="my-day.mcap"]')
    expect(card).to_contain_text("lab.new: 20 features")
    expect(alert).to_be_hidden()
    with page.expect_download() as given:
        card.get_by_role("link", name="Download").click()
    assert given.value.path().read_bytes() == right.read_bytes()
    card.get_by_role("button", name="Replay").click()
    expect(card.locator(".replay .pill")).to_have_text("done")
    expect(card.locator(".replay")).to_contain_text("20 of 20 features are in the twins.")
    page.on("dialog", lambda dialog: dialog.accept())
    card.get_by_role("button", name="Delete").click()
    expect(card).to_have_count(0)
    assert house.client.delete("/api/v1/twins/lab.new").status_code == 204
    refused = [text for text in page.complaints if "422" not in text]
    assert refused == []


def test_what_is_under_way_is_listed_and_cancelled(house, visit):
    page = visit(house, "#recordings")
    listed = page.locator(".under-way")
    expect(listed).to_contain_text("Nothing is under way for your sites.")
    kept = "/api/v1/recordings/kept.mcap/replay"
    assert house.client.post(kept, json={"speed": 1e-3}).status_code == 202
    replay = listed.locator('[data-holding="replays"]')
    expect(replay).to_contain_text("kept.mcap")
    expect(replay).to_contain_text(re.compile(r"replays · began \d+ s ago"))
    expect(listed.locator(".heading")).to_have_text(re.compile(r"1 of \d+ replays"))
    replay.get_by_role("button", name="Cancel").click()
    expect(replay).to_have_count(0)
    told = house.client.get("/api/v1/recordings").json()["recordings"]
    assert [one["replay"]["state"] for one in told if one["name"] == "kept.mcap"] == ["stopped"]
    house.client.delete("/api/v1/twins/lab.other")  # whose first features may have come


def test_the_keyboard_reaches_everything(house, visit):
    page = visit(house)
    expect(page.locator(".card")).to_have_count(3)

    def tab(count):
        said = []
        for _ in range(count):
            page.keyboard.press("Tab")
            said.append(
                page.evaluate(
                    "(document.activeElement.ariaLabel || document.activeElement.innerText)"
                    ".trim().split('\\n')[0]"
                )
            )
        return said

    reached = tab(7)
    assert reached == [
        "slowtime", "Fleet", "Recordings", "Language", "Beam", "Frame", "lab.calm",
    ]  # fmt: skip
    outline = (
        page.locator(".card").nth(2).evaluate("card => getComputedStyle(card).outlineStyle")
    )
    assert outline == "solid"
    page.keyboard.press("Enter")
    expect(part(page, ".timeline", "lab.calm")).to_be_visible()
    page.locator("h1 a").focus()
    reached = tab(10)
    assert reached[3:] == [
        "State", "Diagnosis", "Larger charts", "History as JSON", "Readings shown (CSV)",
        "as Parquet", "Selected time",
    ]  # fmt: skip
    handle = "Stiffness change: move the limit to see when the forecast reaches it"
    assert tab(6) == ["PNG", "PNG", handle, "PNG", "PNG", "Simulate a load"]
    assert tab(4) == [
        "Limits: none",
        "Costs: none, so no maintenance plan is made",
        "Changes of limits, costs, recorded events and other settings",
        "Repairs and inspections: none recorded",
    ]
    assert tab(1)[0].startswith("1 event")


@pytest.mark.long
def test_the_page_follows_one_twin_and_lets_it_go(house, visit, eventually):
    def clients():
        return re.findall(r"live_clients (\d+)", house.get("/metrics").text)

    assert eventually(lambda: clients() == ["0"])
    page = visit(house, "#lab.beam")
    expect(part(page, ".timeline", "lab.beam")).to_be_visible()
    assert clients() == ["1"]
    page.goto(f"{house.url}/#lab.calm")
    expect(part(page, ".timeline", "lab.calm")).to_be_visible()
    expect(page.locator("section.twin")).to_have_count(1)
    assert eventually(lambda: clients() == ["1"])
    page.goto(f"{house.url}/#")
    assert eventually(lambda: clients() == ["0"])


KEPT = """async () => {
  const { Twin } = await import('/assets/twin.js');
  const { Fleet } = await import('/assets/fleet.js');
  const { twins: [listed] } = await (await fetch('/api/v1/twins')).json();
  const twin = new Twin('lab.beam', () => {}), fleet = new Fleet();
  twin.load = () => { twin.points = twin.points.slice(-1000); };
  const next = (sequence) => ({ ...listed, sequence, slow_time: sequence });
  for (let i = 0; i < 5000; i += 1) {
    twin.arrive(next(i));
    twin.happen({ number: i, slow_time: i, kind: 'alarm' });
    if (i % 10) continue;
    fleet.hear([next(i)]);
    fleet.cards.get('lab.beam').points.push({ x: i, value: 0, lo: 0, hi: 0 });
  }
  return [twin.points.length, twin.events.length, fleet.cards.get('lab.beam').points.length];
}"""


@pytest.mark.long
def test_what_the_page_keeps_of_an_endless_stream_is_bounded(house, visit):
    points, events, spark = visit(house).evaluate(KEPT)
    assert points <= 2001
    assert events == 100
    assert spark <= 402


@pytest.mark.long
def test_a_history_that_did_not_come_is_asked_for_again(house, visit):
    page = visit(house)
    torn = iter([True])

    def once(route):
        return route.fulfill(status=500) if next(torn, False) else route.continue_()

    page.route("**/history?max_points=1000", once)
    page.goto(f"{house.url}/#lab.beam")
    chart = part(page, '[data-quantity="frequency_hz"]', "lab.beam")
    expect(chart).to_have_attribute("data-points", "40")
    expect(part(page, ".reasons", "lab.beam")).to_be_hidden()


def looked_at(page, house, view, scheme, window):
    """Findings of axe that keep people out, and pixels too wide."""
    place, shown = VIEWS[view]
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    page.set_viewport_size(window)
    page.goto(f"{house.url}/{place}")
    expect(page.locator(shown).first).to_be_visible()
    return keeps_out(page), max(0, overflow(page))


def keeps_out(page):
    """Findings of axe that keep people out."""
    return [
        (one["id"], node["target"], node.get("failureSummary"))
        for one in Axe().run(page).response["violations"]
        for node in one["nodes"]
        if one["impact"] in ("serious", "critical")
    ]


@pytest.mark.long
@pytest.mark.parametrize(("view", "look"), [("fleet", LOOKS[0]), ("state", LOOKS[1])])
def test_nothing_of_a_view_keeps_people_out(house, visit, view, look):
    assert looked_at(visit(house), house, view, *look) == ([], 0)


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("look", LOOKS)
def test_nothing_of_any_view_in_any_look_keeps_people_out(house, visit, view, look):
    assert looked_at(visit(house), house, view, *look) == ([], 0)


GERMAN = {
    "fleet": ("?lang=de#", ".verdict", "Liegt eine Störung vor? Ja: jetzt handeln."),
    "state": ("?lang=de#lab.frame", "table.modes caption", "Moden des letzten Messwerts"),
    "diagnosis": ("?lang=de#lab.frame/diagnosis", ".orders", "Finden, was dem Modell fehlt"),
    "recordings": ("?lang=de#recordings", "h2", "Aufzeichnungen"),
}


@pytest.mark.long
@pytest.mark.parametrize("view", GERMAN)
def test_a_view_speaks_german(house, visit, view):
    place, where, words = GERMAN[view]
    page = visit(house)
    page.emulate_media(reduced_motion="reduce")
    page.goto(f"{house.url}/{place}")
    expect(page.locator(f"main {where} >> visible=true").first).to_contain_text(words)
    assert page.locator("html").get_attribute("lang") == "de"
    assert keeps_out(page) == []
    assert overflow(page) <= 0
    assert page.complaints == []


@pytest.mark.long
def test_the_plan_speaks_german(house, visit, ageing, eventually):
    body = house.client.put("/api/v1/twins/lab.plan", json=PLANNED)
    assert body.status_code == 201, body.text
    house.feed(ageing(60, asset="plan"))
    assert eventually(lambda: house.count("lab.plan") == 60)
    page = visit(house)
    page.goto(f"{house.url}/?lang=de#lab.plan")
    plan = part(page, ".plan", "lab.plan")
    expect(plan.locator("caption")).to_have_text("Optionen, die günstigste zuerst")
    expect(plan.locator("thead th").nth(2)).to_contain_text("erwartete Kosten")
    expect(plan.locator(".sentence")).to_contain_text("erwartete Kosten")
    expect(plan.locator("tbody th").filter(has_text="jetzt reparieren")).to_have_count(1)
    expect(plan.locator("[lang=en]")).to_have_count(0)
    expect(plan.locator(".y-title")).to_contain_text("Kosten bis dahin")
    value = part(page, "figcaption strong", "lab.plan").first
    expect(value).to_contain_text(re.compile(r"^\d,\d+\u202fHz$"))
    assert keeps_out(page) == []
    house.client.delete("/api/v1/twins/lab.plan")


def test_the_language_is_chosen_by_the_menu_and_remembered(house, visit):
    page = visit(house, locale="de-AT")
    menu = page.locator("#language")
    expect(page.locator("html")).to_have_attribute("lang", "de")
    expect(menu.locator("option")).to_have_text(["Deutsch", "English"])
    menu.select_option("en")
    expect(page.locator("nav a").first).to_have_text("Fleet")
    expect(page.locator("html")).to_have_attribute("lang", "en")
    page.goto(house.url)
    expect(page.locator("#language")).to_have_value("en")
    expect(page.locator("nav a").first).to_have_text("Fleet")
    assert page.complaints == []


SPARK = """async (points) => {
  const { sparkline } = await import('/assets/sparkline.js');
  const svg = sparkline(points, '');
  const heights = (name) => svg.querySelector(name).getAttribute('points')
    .split(' ').map((xy) => +xy.split(',')[1]);
  return [heights('polygon'), heights('polyline')];
}"""


def test_a_small_picture_holds_wide_bands_but_for_single_ones(house, visit):
    # Bands ten times as wide as the line moves, and one of a thousand times.
    values = [0.1 * (i % 2) for i in range(40)]
    points = [{"x": i, "value": v, "lo": v - 1, "hi": v + 1} for i, v in enumerate(values)]
    points[20] |= {"lo": -100.0, "hi": 100.0}
    band, line = visit(house).evaluate(SPARK, points)
    bottom, top = 53.0, 3.0  # edges of the picture [px]
    cut = [y for y in band if y >= bottom or y <= top]
    assert len(cut) == 2, "only the single wide reading is cut off"
    assert max(line) - min(line) > 1.0, "the line is not flattened"


WIDENED = """async ([crossing]) => {
  const { widened } = await import('/assets/traces.js');
  const stiffness_change = { lo: -0.2, hi: -0.1 };
  const point = (slow_time) => ({ slow_time, assumed: [], stiffness_change });
  const times = [{ slow_time: 5 }, { slow_time: crossing.median }, { slow_time: null }];
  const crossings = [{ quantity: 'stiffness_change', threshold: crossing.threshold, times }];
  const forecast = { points: [point(2), point(3)], crossings };
  return widened([-16, 0], { points: [point(0), point(1)], forecast }, 'stiffness_change');
}"""


def test_a_chart_shows_a_threshold_that_is_likely_reached_and_near(house, visit):
    page = visit(house)

    def low(threshold, median):
        return page.evaluate(WIDENED, [{"threshold": threshold, "median": median}])[0]

    assert low(-0.3, 9.0) < -30.0
    assert low(-0.3, None) == -20.0, "not within the horizon: as far as the forecast"
    assert low(-0.9, 9.0) == -20.0, "too far: readings would be flattened"
