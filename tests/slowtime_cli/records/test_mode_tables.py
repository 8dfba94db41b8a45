"""Modes of many channels, as a script and a reader of reports meet them."""

import dataclasses
import json
import re

import numpy as np
import pytest

from slowtime.dynamics.builders import accelerometer, shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.dynamics.simulation import ambient_structure
from slowtime_services.models import write_model

FLOORS = ("floor1", "floor2", "floor3")
CHANNELS = tuple(f"a_{floor}" for floor in FLOORS)


def frame(storey_n_per_m):
    return dataclasses.replace(
        shear_frame([2.0, 2.0, 2.0], [storey_n_per_m] * 3, rayleigh=(0.0, 4e-4)),
        sensors=tuple(accelerometer(floor) for floor in FLOORS),
    )


FRAME = frame(4000.0)


def rows_of_modes(page):
    """Count the rows of the table of modes of a report."""
    body = re.search(r"mistrust</th>.*?<tbody>(.*?)</tbody>", page, re.DOTALL)
    assert body is not None
    return body[1].count("<tr>")


@pytest.fixture
def vibration(tmp_path):
    """Four minutes of a frame's three floors, as a text file with a header."""
    structure = assemble(FRAME)
    rng = np.random.default_rng(5)
    samples = ambient_structure(structure, 9600, 40.0, rng, channels=FLOORS)
    samples = samples + 0.05 * samples.std() * rng.standard_normal(samples.shape)
    path = tmp_path / "frame.csv"
    np.savetxt(path, samples, delimiter=",", header=",".join(CHANNELS), comments="")
    return path


def check(found):
    true = undamped_modes(assemble(FRAME))
    modes = [mode for mode in found["modes"] if mode["kind"] == "structural"]
    assert found["channels"] == list(CHANNELS)
    assert len(modes) == 3
    for mode, hz, shape in zip(modes, true.frequency_hz, true.shapes.T, strict=True):
        frequency = mode["frequency_hz"]
        assert abs(frequency["value"] - hz) < 4 * frequency["sd"] < 0.1
        assert mode["damping_ratio"]["sd"] > 0
        seen = np.array(mode["shape"]["re"]) + 1j * np.array(mode["shape"]["im"])
        assert abs(np.vdot(seen, shape)) / np.linalg.norm(shape) > 0.99
        assert 0 <= mode["quality"] <= 1
    return modes


@pytest.mark.long
def test_a_record_of_many_channels_gives_all_modes_with_shapes_and_errors(run, vibration):
    done = run("identify", vibration, "--rate-hz", "40", "--out", "-")
    assert done.status == 0
    check(done.json)


@pytest.mark.long
def test_a_model_is_compared_mode_by_mode(run, vibration, tmp_path):
    write_model(tmp_path / "model.yaml", frame(3610.0))
    arguments = ("--rate-hz", "40", "--model", "model.yaml", "--out", "-")
    modes = check(run("identify", vibration, *arguments).json)
    assert [mode["model"]["mode"] for mode in modes] == [1, 2, 3]
    for mode in modes:
        assert mode["model"]["difference"] == pytest.approx((4000 / 3610) ** 0.5 - 1, abs=0.01)
        assert mode["model"]["mac"] > 0.99


@pytest.mark.long
def test_a_report_stands_alone_and_shows_every_mode(run, vibration, tmp_path):
    done = run("identify", vibration, "--rate-hz", "40", "--report", "out.html")
    assert done.status == 0
    page = (tmp_path / "out.html").read_text(encoding="utf-8")
    assert rows_of_modes(page) == 3
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page)
    charts = re.findall(r'<script type="application/json">(.*?)</script>', page)
    drawn = [chart for chart in map(json.loads, charts) if "data" in chart]
    spectra, stabilisation, shapes, _ = drawn
    assert len(spectra["layout"]["shapes"]) == 3
    poles = [trace["name"] for trace in stabilisation["data"] if trace.get("yaxis") != "y2"]
    assert sorted(poles) == ["mode", "other pole"]
    assert [trace["x"] for trace in shapes["data"]] == [list(CHANNELS)] * 3


def test_what_does_not_go_together_is_said(refused, vibration):
    said = refused(
        "identify", vibration, "--rate-hz", "40", "--window-s", "9", "--report", "a.html"
    )
    assert "--window-s follows the first mode" in said
    said = refused(
        "identify", vibration, "--rate-hz", "40", "--method", "peak", "--report", "a.html"
    )
    assert "go with --method modes" in said


@pytest.mark.long
@pytest.mark.parametrize("method", ["bayes", "efdd", "fdd"])
def test_other_methods_find_the_same_modes(run, vibration, tmp_path, method):
    flags = ("--rate-hz", "40", "--method", method, "--out", "found.json")
    done = run("identify", vibration, *flags, "--report", "out.html")
    assert done.status == 0
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    structural = [mode for mode in found["modes"] if mode["kind"] == "structural"]
    assert [mode["method"] for mode in structural] == [method] * 3
    true = undamped_modes(assemble(FRAME)).frequency_hz
    for mode, hz in zip(structural, true, strict=True):
        frequency, damping = mode["frequency_hz"], mode["damping_ratio"]
        assert abs(frequency["value"] - hz) < 4 * frequency["sd"] < 0.2
        assert (damping["value"] == damping["sd"] == 0) == ("no_damping" in mode["flags"])
        assert ("no_damping" in mode["flags"]) == (method == "fdd")
    page = (tmp_path / "out.html").read_text(encoding="utf-8")
    assert rows_of_modes(page) == 3
    assert ("Stabilisation" in page) == (method == "bayes")
    said = re.sub(r"[A-Za-z0-9+/=]{1000,}", "", page)  # without the packed library
    assert len(said) < 0.5 * len(page)
    assert not re.search(r"\bnan\b", said, re.IGNORECASE)
