"""`slowtime identify --input`: modal tests from the command line."""

import csv
import json

import numpy as np
import pytest

from tests.slowtime.identification.modal_fit.structures import blows, frame, response_to

RATE = 128.0


@pytest.fixture(scope="module")
def samples():
    """Five blows at the top of a frame, the second of which bounces."""
    rng = np.random.default_rng(1)
    at = np.array([1.0, 9.0, 9.1, 17.0, 25.0, 33.0])
    force = blows(at, np.array([100.0, 90, 40, 110, 95, 105]), RATE, 42.0, 0.02)
    responses = response_to(frame(3), np.column_stack([force, 0 * force]), RATE)
    force = force + 0.02 * rng.standard_normal(len(force))
    return force, responses + 0.05 * rng.standard_normal(responses.shape)


@pytest.fixture
def record(samples, tmp_path):
    force, responses = samples
    path = tmp_path / "hits.csv"
    time = np.arange(len(force)) / RATE
    np.savetxt(
        path, np.column_stack([time, force, responses]), delimiter=",", fmt="%.6f", comments="",
        header="t_s,force [N],a1 [m/s^2],a2 [m/s^2],a3 [m/s^2]",
    )  # fmt: skip
    return path


FLAGS = ("--input", "force", "--band-hz", 1, 14)


def test_a_hammer_test_gives_modes_masses_and_files(run, record):
    done = run(
        "identify", record, *FLAGS, "--setting", "driving_point=a3=force", "--frf", "h.json",
        "--out", "modes.json", "--report", "modes.html",
    )  # fmt: skip
    assert done.status == 0
    assert "4 blows of 5 used" in done.err
    assert "rejected: double hit" in done.err
    with open("modes.json") as file:
        found = json.load(file)
    assert found["channels"] == ["a1", "a2", "a3"]
    true = frame(3)
    for k, mode in enumerate(found["modes"]):
        hz = mode["frequency_hz"]
        assert abs(hz["value"] - true.frequency_hz[k]) < 4.5 * hz["sd"] < 0.01
        assert mode["method"] == "maximum_likelihood"
    with open("h.json") as file:
        body = json.load(file)
    for k, mode in enumerate(body["modes"]):
        mass = mode["modal_mass"]
        assert abs(mass["value"] - 1 / true.shapes[2, k] ** 2) < 6 * mass["sd"]
    assert len(body["response"]["re"]) == len(body["frequency_hz"]) == len(body["fitted"]["im"])
    with open("modes.html") as file:
        page = file.read()
    assert "Frequency responses" in page
    assert "multiple coherence" in page
    assert "Stabilisation" in page


def test_frequency_responses_are_read_by_pyuff_as_they_were(run, record):
    pyuff = pytest.importorskip("pyuff")
    done = run(
        "identify",
        record,
        *FLAGS,
        "--frf",
        "h.uff",
        "--out",
        "modes.uff",
        "--setting",
        "decay_s=2",
    )
    assert done.status == 0
    run(
        "identify",
        record,
        *FLAGS,
        "--frf",
        "h.json",
        "--out",
        "x.json",
        "--setting",
        "decay_s=2",
    )
    with open("h.json") as file:
        body = json.load(file)
    sets = pyuff.UFF("h.uff").read_sets()
    responses = [one for one in sets if one["func_type"] == 4]
    assert len(responses) == 3
    assert [one["func_type"] for one in sets].count(6) == 3
    first = (
        np.array(body["response"]["re"])[:, 0, 0]
        + 1j * np.array(body["response"]["im"])[:, 0, 0]
    )
    np.testing.assert_allclose(responses[0]["data"], first, rtol=1e-9)
    np.testing.assert_allclose(responses[0]["x"], body["frequency_hz"], rtol=1e-4)
    assert responses[0]["id1"] == "a1 over force"
    assert len(pyuff.UFF("modes.uff").read_sets()) == 3


def test_a_table_of_frequency_responses_has_a_row_a_line(run, record):
    assert run("identify", record, *FLAGS, "--frf", "h.csv", "--out", "m.json").status == 0
    with open("h.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0][:4] == ["frequency_hz", "re a1/force", "im a1/force", "sd a1/force"]
    assert float(rows[1][0]) >= 1.0
    assert float(rows[-1][0]) <= 14.0


def test_an_earthquake_is_told_by_the_unit_of_its_input(run, tmp_path):
    rng = np.random.default_rng(2)
    structure = frame(3, damping=0.03)
    ground = np.convolve(rng.standard_normal(6400), np.ones(6) / 6, "same")
    ground *= np.exp(-0.5 * ((np.arange(6400) / RATE - 15) / 7) ** 2)
    factors = structure.shapes.sum(axis=0)[None]
    heard = response_to(structure, ground[:, None], RATE, factors=factors)
    heard = heard + 0.002 * rng.standard_normal(heard.shape)
    np.savetxt(
        tmp_path / "quake.csv", np.column_stack([ground, heard]), delimiter=",", comments="",
        header="ground [m/s^2],a1 [m/s^2],a2 [m/s^2],a3 [m/s^2]",
    )  # fmt: skip
    done = run(
        "identify", tmp_path / "quake.csv", "--rate-hz", RATE, "--input", "ground",
        "--band-hz", 1, 14, "--out", "-",
    )  # fmt: skip
    assert done.status == 0
    assert "excitation by base" in done.err
    hz = [mode["frequency_hz"]["value"] for mode in done.json["modes"]]
    np.testing.assert_allclose(hz, structure.frequency_hz, rtol=2e-3)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (("--frf", "h.uff"), "together with --input"),
        (("--input", "force", "--window-s", 5), "for one whole record"),
        (("--input", "force,a1,a2,a3"), "leave at least one channel as a response"),
        (("--input", "nothing"), "nothing"),
        ((*FLAGS, "--setting", "driving_point=b=force"), "give RESPONSE=INPUT"),
        (
            ("--input", "force,a1", "--setting", "excitation=hammer"),
            "has one input, and 2 were given",
        ),
    ],
)
def test_what_cannot_be_done_is_said(run, record, flags, says):
    done = run("identify", record, *flags)
    assert done.status == 2
    assert says in done.err


@pytest.mark.parametrize("name", ["h.uff", "h.csv", "h.json"])
def test_responses_that_were_written_give_the_same_modes(run, record, name):
    assert run("identify", record, *FLAGS, "--frf", name, "--out", "a.json").status == 0
    done = run("identify", name, "--out", "b.json", "--report", "b.html", "--frf", "again.uff")
    assert done.status == 0
    with open("a.json") as first, open("b.json") as second:
        before, after = json.load(first), json.load(second)
    assert after["channels"] == before["channels"] == ["a1", "a2", "a3"]
    assert len(after["modes"]) == 3
    for one, other in zip(before["modes"], after["modes"], strict=True):
        sd = np.hypot(one["frequency_hz"]["sd"], other["frequency_hz"]["sd"])
        assert abs(one["frequency_hz"]["value"] - other["frequency_hz"]["value"]) < 5 * sd


def test_options_of_records_are_refused_for_frequency_responses(run, record):
    run("identify", record, *FLAGS, "--frf", "h.uff", "--out", "a.json")
    done = run("identify", "h.uff", "--setting", "frf_kind=acceleration", "--window-s", 3)
    assert done.status == 2
    assert "--window-s goes with records in time" in done.err


@pytest.mark.parametrize("lead_s", [0.1, 0.0])
def test_a_record_that_begins_with_its_blow_is_used(run, tmp_path, lead_s):
    rng = np.random.default_rng(0)
    force = blows(np.array([1.0]), np.array([100.0]), RATE, 40.0, 0.02)
    motion = response_to(frame(3), np.column_stack([force, 0 * force]), RATE)
    force = force + 0.02 * rng.standard_normal(len(force))
    motion = motion + 0.05 * rng.standard_normal(motion.shape)
    begins = int(np.argmax(force > 1)) - round(lead_s * RATE)
    found = []
    for first in (0, begins):
        rows = np.column_stack([force, motion])[first:]
        table = np.column_stack([np.arange(len(rows)) / RATE, rows])
        head = "t_s,force [N],a1 [m/s^2],a2 [m/s^2],a3 [m/s^2]"
        path = tmp_path / "one.csv"
        np.savetxt(path, table, delimiter=",", fmt="%.6f", comments="", header=head)
        done = run(
            "identify", path, *FLAGS, "--setting", "excitation=hammer", "--out", "one.json"
        )
        assert done.status == 0, done.err
        with open("one.json") as file:
            found.append(json.load(file)["modes"])
    assert len(found[0]) == len(found[1]) == 3
    for one, other in zip(*found, strict=True):
        apart = one["frequency_hz"]["value"] - other["frequency_hz"]["value"]
        assert abs(apart) < 2 * one["frequency_hz"]["sd"]
