"""`slowtime diagnose --history`, as a script meets it."""

import json

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "Give a MODEL and at least one RECORD of it, --history"),
        (("--history", "none.sqlite"), "There is no file none.sqlite"),
        (("--history", "h.csv", "--asset", "a.b"), "holds one history: leave --asset out"),
        (("h.csv", "--history", "h.csv"), "takes no MODEL and no RECORD"),
        (("--history", "h.csv"), "no column of the value"),
        (("--history", __file__), "file is not a database"),
    ],
)
def test_what_cannot_be_is_said(run, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "h.csv").write_text("t,f\n0,1\n")
    done = run("diagnose", *arguments)
    assert done.status == 2
    assert says in " ".join(done.err.split())


@pytest.mark.slow
def test_a_table_says_what_it_follows(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    time = np.arange(300) * 3600.0
    warmth = 10.0 + 8.0 * np.sin(2 * np.pi * time / 86400.0) + 2.0 * rng.standard_normal(300)
    frequency = 3.2 * (1 - 0.0008 * (warmth - 10.0)) + 0.002 * rng.standard_normal(300)
    table = np.column_stack([time, frequency, np.full(300, 0.002), warmth])
    names = "slow_time,frequency_hz,frequency_hz_sd,temperature_c"
    np.savetxt("h.csv", table, delimiter=",", header=names, comments="")
    done = run("diagnose", "--history", "h.csv", "--out", "found")
    assert done.status == 0
    assert done.out.startswith("missing effect: Frequency follows temperature_c")
    report = json.loads((tmp_path / "found/report.json").read_text())
    (effect,) = report["effects"]
    slope = effect["parameters"]["slope"]
    assert effect["effect"] == "temperature_linear"
    assert slope["value"] == pytest.approx(-0.08, abs=4 * slope["sd"])
    assert "temperature_c" in (tmp_path / "found/report.html").read_text()
