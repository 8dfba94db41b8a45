"""The verb `convert`: from a mesh to natural frequencies."""

import json

import numpy as np
import pytest

BEAM = (
    "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,2.,0.,0.\nCBAR,1,1,1,2,0.,1.,0.\n"
    "CBAR,2,1,2,3,0.,1.,0.\nPBAR,1,1,.01,8.3-6,8.3-6,1.4-5\nMAT1,1,2.1+11,,.3,7850.\n"
    "SPC1,1,123456,1\n"
)


def test_a_mesh_becomes_a_model_whose_frequencies_are_printed(tmp_path, run):
    (tmp_path / "beam.bdf").write_text(BEAM)
    out = tmp_path / "beam.yaml"
    said = run("model", "convert", tmp_path / "beam.bdf", "--out", out, "--parameters").out
    assert "3 nodes, 2 elements, 0 masses, 1 supports" in said
    body = json.loads(run("model", "reduce", out, "--modes", "2", "--out", "-").out)
    assert body["parameters"] == ["PBAR 1"]
    speed = np.sqrt(2.1e11 * 8.3e-6 / (7850.0 * 0.01))
    # Two cubic elements: the first frequency is 0.05 % above the closed form.
    assert body["frequency_hz"][0] == pytest.approx(
        1.8751040687**2 / (2 * np.pi) * speed / 4.0, rel=1e-3
    )


def test_a_model_without_parameters_is_reduced_too(tmp_path, run):
    (tmp_path / "beam.bdf").write_text(BEAM)
    run("model", "convert", tmp_path / "beam.bdf", "--out", tmp_path / "beam.yaml")
    body = json.loads(
        run("model", "reduce", tmp_path / "beam.yaml", "--modes", "3", "--out", "-").out
    )
    assert body["parameters"] == []
    assert body["error"]["frequency"] < 1e-9
