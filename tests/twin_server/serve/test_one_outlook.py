"""Every place that tells of a twin's future tells the same: value, instant, horizon."""

import json

import pytest
from click.testing import CliRunner

from slowtime.evolution.life.probability_words import probability_in_words
from slowtime_cli.__main__ import app
from slowtime_services.client import Client

TWIN, LIMIT, AHEAD = "lab.beam", -0.2, 80.0
BODY = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": LIMIT}],
    "limit_states": [
        {
            "kind": "threshold",
            "name": "softer",
            "quantity": "stiffness_change",
            "below": LIMIT,
            "accepted": 0.9,
        }
    ],
    "costs": {
        "currency": "EUR",
        "time_unit": "slow_time",
        "failure": 900.0,
        "repair": 40.0,
        "inspection": 1.0,
    },
    "decision": {
        "failure": {"quantity": "stiffness_change", "below": LIMIT},
        "horizon": AHEAD,
    },
}


@pytest.fixture(scope="module", params=[1, 2])
def server(serving, ageing, eventually, request):
    """A beam that may reach its limit within the horizon, and a composite of it alone."""
    server = serving()
    assert server.client.put(f"/api/v1/twins/{TWIN}", json=BODY).status_code == 201
    server.feed(ageing(60, loss=0.1, sd=0.02, seed=request.param))
    assert eventually(lambda: server.count() == 60)
    for name, failing in (("states", {}), ("limits", {"quantity": "stiffness_change"})):
        whole = {"kind": "line", "members": [TWIN], "tree": {"series": [TWIN]}}
        if failing:
            whole["failing"] = {TWIN: {**failing, "at": LIMIT}}
        assert server.client.put(f"/api/v1/composites/lab.{name}", json=whole).is_success
    # Once past outlooks are kept, the spread of the futures stays as it is.
    assert server.get(f"/api/v1/twins/{TWIN}/forecast").json()["points"]
    assert eventually(lambda: "slowtime_twin_forecasts_due 0" in server.get("/metrics").text)
    return server


def from_rest(server):
    """Value, instant and horizon of each answer that has them as numbers."""
    found = {}
    told = server.get(f"/api/v1/twins/{TWIN}/forecast").json()
    crossing = told["crossings"][0]
    found["crossing"] = crossing["within"], told["since"], crossing["horizon"]
    found["bands"] = crossing["within"], told["since"], told["horizon"]
    found["last band"] = crossing["within"], told["since"], told["points"][-1]["slow_time"]
    risk = server.get(f"/api/v1/twins/{TWIN}/risk").json()
    state = risk["limit_states"][0]
    found["risk"] = state["within"]["value"], risk["since"], risk["horizon"]
    last = state["points"][-1]
    found["survival"] = 1.0 - last["survival"]["value"], risk["since"], last["slow_time"]
    plan = server.get(f"/api/v1/twins/{TWIN}/plan").json()
    found["plan"] = plan["failure"]["within"], plan["since"], plan["horizon"]["slow_time"]
    for name in ("states", "limits"):
        whole = server.get(f"/api/v1/composites/lab.{name}").json()
        part = whole["twins"][0]["failure"]
        found[f"composite {name}"] = part["value"], part["since"], part["horizon"]
        ahead = part["since"] + whole["failure"]["horizon"]
        found[f"whole {name}"] = whole["failure"]["value"], part["since"], ahead
    return found


def from_commands(server):
    """Likewise of what the commands and the typed client give."""
    found = {}
    where = ["--server", server.url, "--asset", TWIN, "--out", "-"]
    told = {}
    for verb in ("forecast", "risk", "plan"):
        ran = CliRunner().invoke(app, [verb, *where])
        assert ran.exit_code == 0, ran.output
        told[verb] = json.loads(ran.stdout)
    crossing = told["forecast"]["crossings"][0]
    found["forecast"] = crossing["within"], told["forecast"]["since"], crossing["horizon"]
    state = told["risk"]["limit_states"][0]
    found["risk"] = state["within"]["value"], told["risk"]["since"], told["risk"]["horizon"]
    plan = told["plan"]
    found["plan"] = plan["failure"]["within"], plan["since"], plan["horizon"]["slow_time"]
    with Client(server.url) as client:
        typed = client.forecast(TWIN)
        crossing = typed.crossings[0]
        found["typed"] = crossing.within, typed.since, crossing.horizon
    return found


def test_every_answer_tells_the_same_value_instant_and_horizon(server):
    found = from_rest(server) | from_commands(server)
    value, since, horizon = found["crossing"]
    assert 0.02 < value < 0.98
    assert (since, horizon) == (59.0, 59.0 + AHEAD)
    for place, told in found.items():
        assert told == pytest.approx((value, since, horizon), abs=1e-12), place


def lines_of(verb, server):
    """Rows of what a command writes for other programs: tab-separated, with a heading."""
    ran = CliRunner().invoke(app, [verb, "--server", server.url, "--asset", TWIN])
    assert ran.exit_code == 0, ran.output
    head, *rows = [line.split("\t") for line in ran.stdout.splitlines()]
    return [dict(zip(head, row, strict=True)) for row in rows], ran.stderr


def test_lines_and_files_for_other_programs_tell_them_too(server, tmp_path):
    told = server.get(f"/api/v1/twins/{TWIN}/forecast", points=20).json()
    crossing, last = told["crossings"][0], told["points"][-1]
    bands, said = lines_of("forecast", server)
    assert float(bands[-1]["slow_time"]) == told["horizon"] == crossing["horizon"]
    for part in ("value", "sd", "lo", "hi"):
        # Lines are written with nine digits.
        assert float(bands[-1][part]) == pytest.approx(last["stiffness_change"][part], rel=1e-8)
    assert crossing["sentence"] in " ".join(said.split())
    states, said = lines_of("risk", server)
    assert float(states[0]["within"]) == pytest.approx(crossing["within"], rel=1e-8)
    assert f"{told['since']:g}" in said
    out = tmp_path / "forecast.json"
    where = ["--server", server.url, "--asset", TWIN, "--out", str(out)]
    assert CliRunner().invoke(app, ["forecast", *where]).exit_code == 0
    assert json.loads(out.read_text()) == told


def test_the_sentences_tell_them_too(server):
    value, since, horizon = from_rest(server)["crossing"]
    words = probability_in_words(value)
    twin = server.get(f"/api/v1/twins/{TWIN}").json()
    findings = {one["kind"]: one["text"] for one in twin["conclusion"]["findings"]}
    told = [
        findings["limit_near"],
        findings["risk_rising"],
        server.get(f"/api/v1/twins/{TWIN}/forecast").json()["crossings"][0]["sentence"],
        server.get(f"/api/v1/twins/{TWIN}/risk").json()["limit_states"][0]["sentence"],
    ]
    for sentence in told:
        assert words in sentence
        assert f"{since:g}" in sentence
        assert f"{horizon:g}" in sentence
    assert words in server.get(f"/api/v1/twins/{TWIN}/plan").json()["sentence"] or (
        "Cannot decide" in server.get(f"/api/v1/twins/{TWIN}/plan").json()["sentence"]
    )


def test_the_track_record_is_the_same_by_route_client_and_command(server):
    record = server.get(f"/api/v1/twins/{TWIN}/forecast/record").json()
    (bands,) = [
        one
        for one in record["quantities"]["stiffness_change"]["coverage"]
        if one["stated"] == 0.95
    ]
    assert record["kept"] == len(record["outlooks"]) > 10
    assert 0 < bands["held"] <= bands["count"]
    assert f"of {bands['count']} values foretold, {bands['held']} lay" in record["sentences"][0]
    told = server.get(f"/api/v1/twins/{TWIN}/forecast").json()
    assert told["record"] == record["sentences"]
    # No horizon has passed yet.
    assert record["thresholds"]["count"] == 0
    assert told["crossings"][0]["record"] is None
    with Client(server.url) as client:
        typed = client.track_record(TWIN)
        assert client.forecast(TWIN).record == typed.sentences == tuple(record["sentences"])
    assert [one.held for one in typed.quantities["stiffness_change"].coverage] == [
        one["held"] for one in record["quantities"]["stiffness_change"]["coverage"]
    ]
    _, said = lines_of("forecast", server)
    assert record["sentences"][0] in " ".join(said.split())


SHOWN = """panel => Object.fromEntries([".outlook", ".risk", ".plan"].map((part) =>
  [part, panel.querySelector(part).dataset.since]))"""


@pytest.mark.browser
def test_the_page_tells_them_too_and_moves_on_with_all_of_them_at_once(
    server, visit, ageing, eventually
):
    value, since, horizon = from_rest(server)["crossing"]
    page = visit(server, f"#{TWIN}")
    panel = page.locator(f'[id="{TWIN}"]')
    panel.locator(".plan[data-since]").wait_for()
    assert panel.evaluate(SHOWN) == dict.fromkeys((".outlook", ".risk", ".plan"), f"{since:g}")
    told = server.get(f"/api/v1/twins/{TWIN}/forecast").json()["crossings"][0]
    row = panel.locator(".crossings tr[data-of]").first
    assert row.get_attribute("aria-label") == told["sentence"]
    within = row.locator("td").nth(3).text_content()
    assert f"{100 * value:.0f}" in within
    assert f"{horizon:g}" in within
    state = server.get(f"/api/v1/twins/{TWIN}/risk").json()["limit_states"][0]
    shown = panel.locator('.risk tr[data-state="softer"]')
    assert shown.get_attribute("aria-label") == state["sentence"]
    assert float(shown.locator("td").nth(3).text_content()) == pytest.approx(value, rel=0.05)
    record = server.get(f"/api/v1/twins/{TWIN}/forecast/record").json()
    track = panel.locator(".track .plot[data-points]")
    track.wait_for()
    assert track.get_attribute("data-points") == "4"  # one for each central interval
    assert panel.locator(".track .facts").text_content() == " ".join(record["sentences"])
    # While readings come, all three are of one instant at every moment that is looked at.
    count = server.count()
    server.feed(ageing(6, loss=0.0, sd=0.02, seed=9, first=count))
    seen = []

    def moved():
        seen.append(panel.evaluate(SHOWN))
        return seen[-1][".plan"] == f"{count + 5:g}"

    assert eventually(moved)
    assert all(len(set(each.values())) == 1 for each in seen)
    assert page.complaints == []
