"""`slowtime diagnose`, as a script meets it."""

import json
import subprocess
import sys

import numpy as np
import pytest

from slowtime_services.models import read_description, write_model
from tests.services.diagnose.slide import CUBIC, RATE_HZ, SAMPLES, SLIDE, arrays_of

T = np.arange(SAMPLES) / RATE_HZ


@pytest.fixture
def model(tmp_path):
    write_model(tmp_path / "slide.yaml", SLIDE)
    return "slide.yaml"


def diagnosed(folder, *arguments):
    """Run it as a process of its own: thrice as fast, for no shapes are checked there."""
    words = [sys.executable, "-m", "slowtime_cli", "diagnose", "--patience", "3600"]
    words += map(str, arguments)
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)


def save(path, **arrays):
    np.savez(path, **arrays)


def table(path, arrays):
    rows = np.column_stack([T, *arrays.values()])
    header = ",".join(["t", *arrays])
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")


@pytest.mark.gate
def test_a_missing_effect_is_named_with_its_size_and_closes_the_gap(tmp_path, model):
    table(tmp_path / "learn.csv", arrays_of(SLIDE, 1))
    save(tmp_path / "judge.npz", rate_hz=RATE_HZ, **arrays_of(SLIDE, 2))
    done = diagnosed(
        tmp_path, model, "learn.csv", "--holdout", "judge.npz", "--quick", "--out", "found"
    )
    assert done.returncode == 0
    assert done.stderr == "note: judge.npz does not say when it begins: taken to be time 0.\n"
    assert done.stdout.startswith(
        "missing effect: Cubic hardening (cubic_hardening) at element j"
    )
    report = json.loads((tmp_path / "found/report.json").read_text())
    (effect,) = report["effects"]
    k3 = effect["parameters"]["k3_n_per_m3"]
    assert abs(k3["value"] - CUBIC["k3_n_per_m3"]) < 5 * k3["sd"] < 0.05 * k3["value"]
    gap = report["gap"]
    assert gap["on"] == "holdout"
    assert gap["augmented"] < 2 * gap["noise_floor"] < 0.1 * gap["refitted_nominal"]
    with np.load(tmp_path / "found/holdout.npz") as runs:
        assert runs["augmented"].shape == (SAMPLES, 2)
    augmented = read_description(tmp_path / "found/augmented.yaml")
    assert augmented.effects[0]["effect"] == "cubic_hardening"
    assert "cubic hardening" in (tmp_path / "found/report.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["constant", "missing"])
def test_a_channel_that_fails_is_named_beside_the_effect(tmp_path, model, fault):
    arrays = arrays_of(SLIDE, 1)
    if fault == "constant":
        arrays["a"] = np.full(SAMPLES, 1.5)
    else:
        arrays["x"][200:260] = np.nan
    save(tmp_path / "r.npz", t=T, **arrays)
    done = diagnosed(tmp_path, model, "r.npz", "--out", "found")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "found/report.json").read_text())
    assert [finding["fault"] for finding in report["findings"]] == [fault]
    assert {e["effect"] for e in report["effects"]} == {"cubic_hardening", "sensor_dropout"}
    assert report["gap"]["on"] == "tail"


@pytest.mark.slow
def test_a_healthy_rig_lacks_nothing(tmp_path, model):
    for seed in (3, 4):
        save(tmp_path / f"{seed}.npz", t=T, **arrays_of(SLIDE, seed, effects=()))
    done = diagnosed(tmp_path, model, "3.npz", "--holdout", "4.npz")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "diagnosis/report.json").read_text())
    assert (report["verdict"], report["effects"]) == ("nothing_missing", [])


@pytest.mark.slow
def test_two_seconds_claim_nothing_that_is_not_there(tmp_path, model):
    healthy = arrays_of(SLIDE, 5, effects=())
    for name, part in (("r.npz", slice(100)), ("h.npz", slice(100, 200))):
        save(tmp_path / name, rate_hz=RATE_HZ, **{k: x[part] for k, x in healthy.items()})
    done = diagnosed(tmp_path, model, "r.npz", "--holdout", "h.npz")
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "diagnosis/report.json").read_text())
    assert report["verdict"] in ("nothing_missing", "parameters_only", "undecided")


def test_records_that_cannot_be_meant_are_refused_in_a_sentence(tmp_path, model, refused):
    arrays = arrays_of(SLIDE, 1)
    save(tmp_path / "mm.npz", t=T, **(arrays | {"x": 1e3 * arrays["x"]}))
    save(tmp_path / "deaf.npz", t=T, x=arrays["x"], a=arrays["a"])
    save(tmp_path / "short.npz", t=T[:90], **{k: v[:90] for k, v in arrays.items()})
    assert "--channel x=x/1000" in refused("diagnose", model, "mm.npz")
    assert "no channel called 'u'" in refused("diagnose", model, "deaf.npz")
    assert "at least 192" in refused("diagnose", model, "short.npz")
    save(tmp_path / "r.npz", t=T, **arrays)
    assert "prove nothing" in refused("diagnose", model, "r.npz", "--holdout", "r.npz@2:5")
    (tmp_path / "file").touch()
    assert "with --out" in refused("diagnose", model, "r.npz", "--out", "file/found")
    assert "is no part of it" in refused("diagnose", model, "mm.npz@50:")
    assert "does not exist" in refused("diagnose", model, "nowhere.npz")
    assert "maps no channel" in refused("diagnose", model, "mm.npz", "--channel", "x")
    assert not (tmp_path / "diagnosis").exists()


def test_a_model_without_sensors_is_refused(tmp_path, text, refused):
    lines = [
        "slowtime_model: 1", "nodes:", "  - {id: m, mass_kg: 1}", "elements:",
        "  - {id: j, between: [base, m], stiffness_n_per_m: 1}",
    ]  # fmt: skip
    model = text(lines, "bare.yaml")
    save(tmp_path / "r.npz", t=T, x=T)
    assert "lists no sensors" in refused("diagnose", model, "r.npz")


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        ("round", "No shape of a surface is called 'round'"),
        ("odd,even", "contradict each other"),
    ],
)
def test_a_shape_of_a_surface_that_there_is_not_is_refused_before_the_search(
    tmp_path, model, shape, told
):
    save(tmp_path / "learn.npz", rate_hz=RATE_HZ, **arrays_of(SLIDE, 1))
    done = diagnosed(tmp_path, model, "learn.npz", "--setting", f"surface={shape}")
    assert done.returncode == 2
    assert told in " ".join(done.stderr.replace("│", " ").split())
