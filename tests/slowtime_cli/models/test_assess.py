"""The verb `assess`: members named from two modes files, limits before measuring."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from slowtime_services.matrices import read_matrix_model
from tests.slowtime_cli.models.test_finite_elements import modes_file
from tests.slowtime_cli.models.test_shape_report import scene_in

STOREYS = Path(__file__).parents[3] / "docs/examples/two_storeys.yaml"
NOTHING = np.zeros(16)


@pytest.fixture
def model():
    return read_matrix_model(STOREYS)


@pytest.fixture
def before(tmp_path, model):
    return modes_file(tmp_path / "before.json", model, NOTHING, sd=1e-3)


def losing(model, member, share):
    return np.where(np.array(model.matrices.names) == member, -share, NOTHING)


def test_a_softer_column_is_named_and_drawn(run, tmp_path, model, before):
    now = modes_file(tmp_path / "now.json", model, losing(model, "c13", 0.3), sd=1e-3)
    states = ("--before", before, "--now", now)
    done = run("assess", STOREYS, *states, "--report", "a.html")
    assert "Changed: c13 has lost 30" in done.err
    assert "\nset\tname" in "\n" + done.out
    run("assess", STOREYS, *states, "--out", "a.json")
    body = json.loads((tmp_path / "a.json").read_text())
    assert body["verdict"] == "changed"
    ((suspect,),) = body["sets"]
    assert (suspect["name"], suspect["kind"]) == ("c13", "member")
    assert suspect["loss"] == pytest.approx(0.3, abs=0.01)
    assert [mode["mac"] > 0.9 for mode in body["modes"]] == [True] * 5
    changes = scene_in(tmp_path / "a.html")["changes"]
    assert set(changes) == set(model.matrices.names)
    assert changes["c13"]["value"] == pytest.approx(-0.3, abs=0.02)
    assert changes["c13"]["hi"] < 0.0
    assert changes["g13"] == {"value": 0.0, "sd": 0.0, "lo": 0.0, "hi": 0.0}


def test_a_loose_end_of_a_beam_is_named(run, tmp_path, before):
    text = re.sub(r"(id: g21, .*?)}", r"\1, released: [[], [ry, rz]]}", STOREYS.read_text())
    (tmp_path / "loose.yaml").write_text(text)
    loose = read_matrix_model(tmp_path / "loose.yaml")
    now = modes_file(tmp_path / "now.json", loose, NOTHING, sd=1e-3)
    done = run("assess", STOREYS, "--before", before, "--now", now, "--ends", "--out", "-")
    (suspects,) = json.loads(done.out)["sets"]
    named = {one["name"]: one for one in suspects}
    # Which end of a beam is a hinge hardly matters to the frame.
    assert "end of g21 at n22" in named
    assert set(named) <= {"g21", "end of g21 at n21", "end of g21 at n22"}
    assert named["end of g21 at n22"]["kind"] == "connection"
    assert named["end of g21 at n22"]["loss"] > 0.9


def test_the_same_modes_are_unchanged(run, before):
    done = run("assess", STOREYS, "--before", before, "--now", before, "--out", "-")
    body = json.loads(done.out)
    assert body["verdict"] == "unchanged"
    assert body["sets"] == []
    assert abs(body["common_change"]["value"]) < 1e-6


def test_states_without_common_modes_are_said_to_be_not_comparable(
    run, tmp_path, model, before
):
    body = json.loads(before.read_text())
    for mode in body["modes"]:
        mode["frequency_hz"]["value"] *= 3.0
    (tmp_path / "other.json").write_text(json.dumps(body))
    done = run("assess", STOREYS, "--before", before, "--now", tmp_path / "other.json")
    assert "not comparable" in done.err


def test_without_a_present_state_the_smallest_losses_are_planned(run, tmp_path, before):
    coarse = ("--setting", "frequency_sd=0.01", "--setting", "shape_sd=0.05")
    body = json.loads(run("assess", STOREYS, "--modes", 6, *coarse, "--out", "-").out)
    losses = {one["name"]: one["loss"] for one in body["limits"]}
    assert len(losses) == 16
    done = run("assess", STOREYS, "--before", before)
    assert "found with 90% probability" in done.err
    (row,) = (line for line in done.out.splitlines() if line.startswith("c13\t"))
    assert 0.02 < float(row.split("\t")[2]) < losses["c13"] / 1.3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--now", "before.json"), "--now needs --before"),
        ((), "Give either --before"),
        (("--modes", "4", "--before", "before.json"), "Give either --before"),
        (("--modes", "4", "--report", "a.html"), "--report needs --before and --now"),
    ],
)
def test_arguments_that_do_not_belong_together_are_refused(refused, before, arguments, said):
    assert said in refused("assess", STOREYS, *arguments)


def test_places_for_damage_print_the_limits_of_each_member(run):
    planned = [
        "--sensors", 6, "--modes", 6, "--direction", "ux", "--direction", "uy",
        "--setting", "criterion=detection", "--setting", "frequency_sd=0.001",
        "--setting", "shape_sd=0.01", "--setting", "power=0.8",
    ]  # fmt: skip
    body = json.loads(run("model", "place", STOREYS, *planned, "--out", "-").out)
    losses = {one["name"]: one["loss"] for one in body["limits"]}
    assert len(losses) == 16
    assert 0.03 < min(losses.values()) < max(losses.values()) < 0.12
    spread = max(one["evenly_spread_loss"] for one in body["limits"])
    assert max(losses.values()) < 0.95 * spread
    done = run("model", "place", STOREYS, *planned)
    assert "found between two measurements with 80% probability, at 5% false alarms" in done.err
    assert f"Largest: {100 * max(losses.values()):.1f} %" in done.err
    assert "\nname\tloss\tevenly_spread_loss\talike\n" in done.out
