"""`forecast` and `whatif`: what REST answers, of a file or of a running server."""

import json
import threading

import numpy as np
import pytest

from slowtime_schemas.answers import plans as plan_models
from slowtime_schemas.answers.forecasts import ForecastModel
from slowtime_services.bus import MemoryBus
from twin_server.__main__ import run as run_server
from twin_server.serve.routes import simulations
from twin_server.settings import TwinSettings

NOMINAL = ("--nominal-hz", 5, "--nominal-damping", 0.01)
LOAD = (
    "--load",
    "harmonic",
    "--amplitude",
    0.5,
    "--frequency-hz",
    4.5,
    "--setting",
    "draws=20",
)


@pytest.fixture
def softening(tmp_path, monkeypatch):
    """A text of frequencies that lose 0.3 % of their stiffness an epoch, 60 of them."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    lines = ["slow_time,frequency_hz,frequency_sd,damping_ratio,damping_sd"]
    for i in range(60):
        frequency = 5.0 * np.sqrt(1 - 0.003 * i) + 0.003 * rng.standard_normal()
        lines.append(f"{i},{frequency:.6f},0.003,0.011,0.001")
    (tmp_path / "frequencies.csv").write_text("\n".join(lines) + "\n")
    return "frequencies.csv"


@pytest.fixture
def server(tmp_path):
    """A running twin server, without twins that have features."""
    stop, ready, urls = threading.Event(), threading.Event(), []

    def told(url):
        urls.append(url)
        ready.set()

    settings = TwinSettings(database=tmp_path / "twin.sqlite", port=0)
    bus = MemoryBus()
    more = {"bus": bus, "stop": stop, "ready": told}
    thread = threading.Thread(target=run_server, args=(settings,), kwargs=more)
    thread.start()
    assert ready.wait(60)
    yield urls[0]
    stop.set()
    thread.join(60)
    bus.close()


def test_a_forecast_says_where_it_is_heading_and_when_a_threshold_is_reached(run, softening):
    done = run(
        "twin", "forecast", softening, *NOMINAL, "--threshold", -0.24, "--out", "ahead.json"
    )
    assert done.status == 0, done.err
    with open("ahead.json") as file:
        body = json.load(file)
    ForecastModel.model_validate(body)
    assert body["since"] == 59.0
    median = body["crossings"][0]["times"][1]["slow_time"]
    assert median == pytest.approx(80.0, abs=6.0)
    head, *rows = done.out.splitlines()
    assert head.split("\t") == ["slow_time", "quantity", "value", "sd", "lo", "hi"]
    assert len(rows) == 20
    assert "note: Stiffness change at −24 %: 10 %: by" in done.err
    told = body["crossings"][0]
    assert told["median"] == median
    assert told["within"] + told["beyond"] == pytest.approx(1.0)
    cdf = told["cdf"]
    assert np.interp(median, cdf["slow_time"], cdf["probability"]) == pytest.approx(
        0.5, abs=0.03
    )
    assert cdf["probability"][-1] == told["within"]
    likeliest, share = next(iter(told["laws"].items()))
    assert f"note: degradation laws by evidence: {likeliest} {100 * share:.0f} %" in done.err
    never = run("twin", "forecast", softening, *NOMINAL, "--threshold", -0.9, "--out", "-")
    assert never.json["crossings"][0]["times"][0]["slow_time"] is None


def test_what_if_runs_the_twin_of_the_last_epoch(run, softening):
    done = run("twin", "whatif", softening, *NOMINAL, *LOAD, "--duration", 2, "--out", "-")
    assert done.status == 0, done.err
    simulations.SimulationModel.model_validate(done.json)
    (frequency,) = done.json["today"]["frequencies_hz"]
    assert frequency["value"] == pytest.approx(5.0 * np.sqrt(1 - 0.003 * 59), rel=0.003)
    assert done.json["today"]["damping_ratios"][0]["value"] == pytest.approx(0.011, rel=0.02)
    lines = run("twin", "whatif", softening, *NOMINAL, *LOAD, "--duration", 2).out.splitlines()
    assert lines[0].split("\t")[:4] == ["t_s", "load", "mass_value", "mass_sd"]
    assert len(lines) == 1 + len(done.json["t_s"])


@pytest.mark.parametrize(
    ("kind", "needed"),
    [
        ("harmonic", "--amplitude and --frequency-hz"),
        ("step", "--amplitude"),
        ("white", "--psd"),
    ],
)
def test_a_load_without_its_numbers_names_the_options(run, kind, needed):
    done = run("twin", "whatif", __file__, "--load", kind)
    assert done.status == 2
    assert f"--load {kind} needs {needed}. Give" in done.err


def test_a_recorded_load_is_read_from_a_file(run, softening):
    np.savetxt("quake.csv", np.sin(np.arange(200) / 9.0), header="base", fmt="%.6f")
    shaken = ("--load", "recorded", "--record", "quake.csv", "--rate-hz", 100)
    done = run(
        "twin", "whatif", softening, *NOMINAL, *shaken, "--setting", "draws=20", "--out", "-"
    )
    assert done.status == 0, done.err
    np.testing.assert_allclose(done.json["load"], np.sin(np.arange(200) / 9.0), atol=1e-6)
    assert done.json["rate_hz"] == 100.0


def test_a_registration_of_its_own_brings_mass_and_thresholds(run, softening):
    nominal = {"mass_kg": 2.0, "damping_n_s_per_m": 1.3, "stiffness_n_per_m": 1973.9}
    limits = {"thresholds": [{"quantity": "stiffness_change", "at": -0.3}]}
    known = {"offline.record": {"nominal": nominal, "forecast": limits}}
    with open("twins.json", "w") as file:
        json.dump(known, file)
    told = run("twin", "forecast", softening, "--registration", "twins.json", "--out", "-").json
    assert [one["source"] for one in told["crossings"]] == ["registration"]
    pushed = (
        "--load",
        "step",
        "--amplitude",
        10,
        "--setting",
        "on=mass",
        "--setting",
        "draws=20",
    )
    asked = ("--registration", "twins.json", *pushed, "--setting", "quantity=displacement")
    out = run("twin", "whatif", softening, *asked, "--out", "-").json["outputs"]["mass"]
    still = 10.0 / (1973.9 * (1 - 0.003 * 59))
    assert np.mean(out["value"]) == pytest.approx(still, rel=0.1)


def test_a_running_server_is_asked_and_its_refusal_is_told(run, server, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    beam = ("--server", server, "--asset", "lab.beam")
    done = run("twin", "forecast", *beam)
    assert done.status == 2
    assert "No twin is called lab.beam" in done.err
    done = run("twin", "whatif", *beam, *LOAD)
    assert done.status == 2
    assert "No twin is called lab.beam" in done.err
    away = run("twin", "forecast", "--server", "http://127.0.0.1:1", "--asset", "lab.beam")
    assert "did not answer" in away.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            (
                "twin",
                "forecast",
            ),
            "Give SOURCE, or --server URL",
        ),
        (("twin", "forecast", "frequencies.csv", "--server", "http://x"), "exclude each other"),
        (("twin", "forecast", "--server", "http://x"), "--server needs --asset"),
        (
            ("twin", "forecast", "frequencies.csv", "--setting", "quantity=mass_change"),
            "without a threshold",
        ),
        (
            ("twin", "forecast", "frequencies.csv", "--nominal-damping", "0.1"),
            "goes with --nominal-hz",
        ),
        (("twin", "whatif", "frequencies.csv", "--load", "recorded"), "needs --record"),
        (("twin", "whatif", "frequencies.csv", "--load", "harmonic"), "amplitude"),
        (
            ("twin", "whatif", "frequencies.csv", *LOAD, "--setting", "channel=a"),
            "go with --load recorded",
        ),
        (
            ("twin", "whatif", "frequencies.csv", *LOAD, "--setting", "on=mass"),
            "nominal.mass_kg",
        ),
    ],
)
def test_what_cannot_be_asked_is_refused_with_what_to_do(refused, softening, arguments, says):
    assert says in refused(*arguments)


REGISTERED = {
    "nominal": {"frequency_hz": 5.0, "damping_ratio": 0.01},
    "costs": {"failure": 900.0, "repair": 40.0, "inspection": 1.0, "time_unit": "slow_time"},
    "decision": {
        "failure": {"quantity": "stiffness_change", "below": -0.3},
        "horizon": 60.0,
        "inspection": {"sd": 0.01},
    },
}


def test_a_plan_says_what_to_do(run, softening, tmp_path):
    (tmp_path / "twins.json").write_text(json.dumps({"lab.tower": REGISTERED}))
    done = run("twin", "plan", softening, "--registration", "twins.json", "--out", "plan.json")
    assert done.status == 0, done.err
    body = json.loads((tmp_path / "plan.json").read_text())
    plan_models.PlanModel.model_validate(body)
    assert body["valid"]
    # It reaches the limit at about reading 100, well within the horizon: not for nothing.
    assert body["failure"]["within"] > 0.9
    assert body["options"][0]["name"] != "nothing"
    assert f"note: {body['sentence']}" in done.err
    head, *rows = done.out.splitlines()
    assert head.split("\t") == ["option", "now", "value", "lo", "hi", "failures"]
    assert len(rows) == len(body["options"])


def test_a_plan_of_a_fleet_is_that_of_the_server(run, server):
    done = run("twin", "plan", "--server", server, "--fleet", "--out", "-")
    assert done.status == 0, done.err
    assert done.json["assets"] == []
    assert "nothing can be ranked" in done.err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("frequencies.csv",), "Give --registration"),
        (("--fleet",), "--fleet needs --server"),
        ((), "Give SOURCE"),
    ],
)
def test_a_plan_of_nothing_is_refused(run, softening, arguments, text):
    done = run("twin", "plan", *arguments)
    assert done.status == 2
    assert text in done.err
