"""Records that others measured, with known answers, by the plain command."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

TUTORIALS = Path(__file__).parents[3] / "docs/tutorials"


def diagnosed(folder, *words):
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", "diagnose", *words],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "diagnosis/report.json").read_text())


@pytest.mark.data
@pytest.mark.slow
def test_the_silverbox_is_named_from_its_multisines_and_foreseen_beyond_them(tmp_path, data):
    """Of the arrowhead linear models leave 13 mV and more; only the file's facts are told."""
    shutil.copy(TUTORIALS / "silverbox.yaml", tmp_path)
    record = data / "silverbox/SNLS80mV.csv"
    words = ["silverbox.yaml", f"{record}@66.5:82", "--holdout", f"{record}@:65.5"]
    report = diagnosed(tmp_path, *words, "--rate-hz", "610.35")
    first = report["effects"][0]
    # 1.5 % of the motion is left, nine times the noise: a law near it cannot be excluded.
    assert report["verdict"] in ("missing_effect", "undecided")
    assert (first["effect"], first["where"]["id"]) == ("cubic_hardening", "spring")
    assert {rival["effect"] for rival in report["undecided"]} <= {
        "cubic_hardening",
        "sensor_bias",
    }
    # k3 / b of the published fit: 7.2e5 / 1.86e5.
    assert first["parameters"]["k3_n_per_m3"]["value"] == pytest.approx(3.87, rel=0.1)
    with np.load(tmp_path / "diagnosis/holdout.npz") as runs:
        left = {
            name: float(np.sqrt(np.mean((runs[name] - runs["measured"]) ** 2)))
            for name in ("refitted_nominal", "augmented")
        }
    assert left["augmented"] <= 3e-3 < 10e-3 < left["refitted_nominal"]


@pytest.mark.data
@pytest.mark.slow
def test_the_friction_of_a_drive_that_nothing_holds_is_named(tmp_path, data):
    """Only the file's facts are told: what the force is made of, roughly how heavy it is."""
    shutil.copy(TUTORIALS / "emps.yaml", tmp_path)
    learnt, pulses = data / "emps/DATA_EMPS.mat", data / "emps/DATA_EMPS_PULSES.mat"
    words = ["emps.yaml", str(learnt), "--holdout", str(pulses)]
    roles = ["--channel", "force=gtau*vir", "--channel", "x=qm"]
    report = diagnosed(tmp_path, *words, *roles)
    first = report["effects"][0]
    assert report["verdict"] == "missing_effect"
    assert (first["effect"], first["where"]["id"]) == ("coulomb", "guide")
    # Janot, Gautier and Brunot 2019: 20.39 N.
    assert first["parameters"]["friction_n"]["value"] == pytest.approx(20.4, rel=0.05)
    assert [effect["effect"] for effect in report["effects"]] == ["coulomb", "input_bias"]
    assert report["effects"][1]["parameters"]["bias"]["value"] == pytest.approx(3.165, rel=0.05)
    gap = report["gap"]
    assert gap["augmented"] < 0.5 * min(gap["nominal"], gap["refitted_nominal"])
