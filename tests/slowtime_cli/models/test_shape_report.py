"""Reports of finite-element models show mode shapes in space, measured over model."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from slowtime_services.matrices import read_matrix_model
from tests.slowtime_cli.models.test_finite_elements import CHANGE, modes_file, portal

__all__ = ["portal"]

TOWER = Path(__file__).parents[3] / "docs/examples/lattice_tower.yaml"


def scene_in(path):
    text = path.read_text(encoding="utf-8")
    found = re.search(
        r'<div class="scene"><script type="application/json">(.*?)</script>', text
    )
    assert found is not None
    return json.loads(found[1])


def test_the_report_of_a_reduction_holds_its_modes(run, tmp_path):
    frequencies = json.loads(
        run("model", "reduce", TOWER, "--modes", 6, "--setting", "trials=0", "--out", "-").out
    )
    run(
        "model",
        "reduce",
        TOWER,
        "--modes",
        6,
        "--setting",
        "trials=0",
        "--report",
        "shapes.html",
    )
    scene = scene_in(tmp_path / "shapes.html")
    assert [mode["model_hz"] for mode in scene["modes"]] == frequencies["frequency_hz"]
    assert len(scene["nodes"]) == 28
    # The lowest mode sways: the head moves farthest, and the feet not at all.
    moved = np.linalg.norm(scene["modes"][0]["wire"]["re"], axis=1)
    assert moved.argmax() >= 24
    assert not moved[:4].any()


def test_the_report_of_an_update_holds_measured_modes_over_those_of_the_updated_model(
    run, portal, tmp_path
):
    model = read_matrix_model(portal)
    modes = modes_file(tmp_path / "modes.json", model, CHANGE)
    run("model", "update", portal, modes, "--report", "updated.html")
    scene = scene_in(tmp_path / "updated.html")
    # The feet have no rows in these matrices, so that no line of a column is drawn.
    assert (scene["names"], scene["groups"]) == (["2", "3", "4"], ["girder"])
    both = [mode for mode in scene["modes"] if mode["measured_hz"]]
    assert len(both) == 5
    for mode in both:
        assert mode["model_hz"] == pytest.approx(mode["measured_hz"], rel=1e-3)
        assert mode["mac"] > 0.999
    assert "Modal assurance criterion" in (tmp_path / "updated.html").read_text()


def test_identified_modes_are_drawn_over_those_of_a_model_in_space(run, tmp_path):
    run(
        "model",
        "reduce",
        TOWER,
        "--band-hz",
        12,
        "--setting",
        "trials=0",
        "--out",
        "small.json",
    )
    flags = ["--duration", 120, "--rate-hz", 40, "--seed", 3, "--noise"]
    run("simulate", "--model", "small.json", *flags, "--out", "record.npz")
    run("identify", "record.npz", "--method", "modes", "--model", "small.json", "--report",
        "modes.html")  # fmt: skip
    scene = scene_in(tmp_path / "modes.html")
    both = [mode for mode in scene["modes"] if mode["points"]]
    assert len(both) >= 5
    lowest = both[0]
    assert lowest["measured_hz"] == pytest.approx(lowest["model_hz"], rel=0.02)
    assert lowest["mac"] > 0.95
    # Twelve nodes have two sensors each.
    assert len(lowest["points"]["nodes"]) == 12


def test_a_geometry_file_places_the_channels_of_a_record_without_a_model(run, tmp_path):
    rng = np.random.default_rng(5)
    t = np.arange(8000) / 50.0
    force = rng.standard_normal((2, len(t)))
    shapes = np.array([[0.4, 1.0, 0.1], [1.0, -0.4, 0.3]])
    motion = np.zeros((len(t), 3))
    for f, shape, push in zip((2.0, 7.0), shapes, force, strict=True):
        decay = np.exp(-0.02 * 2 * np.pi * f * t[:500]) * np.sin(2 * np.pi * f * t[:500])
        motion += np.convolve(push, decay)[: len(t), None] * shape
    motion += 0.01 * rng.standard_normal(motion.shape)
    np.savez(tmp_path / "record.npz", rate_hz=50.0, a=motion[:, 0], b=motion[:, 1],
             c=motion[:, 2])  # fmt: skip
    (tmp_path / "points.csv").write_text(
        "channel,x,y,z,direction\na,0,0,3,+X\nb,0,0,6,+X\nc,0,0,6,-Y\n"
    )
    run("identify", "record.npz", "--method", "modes", "--geometry", "points.csv", "--report",
        "modes.html")  # fmt: skip
    scene = scene_in(tmp_path / "modes.html")
    assert scene["nodes"] == [[0, 0, 3], [0, 0, 6]]
    first = next(mode for mode in scene["modes"] if abs(mode["measured_hz"] - 2.0) < 0.1)
    moved = np.array(first["wire"]["re"])
    np.testing.assert_allclose(moved[0, 0] / moved[1, 0], 0.4, atol=0.03)
    np.testing.assert_allclose(moved[1, 1] / moved[1, 0], -0.1, atol=0.03)
