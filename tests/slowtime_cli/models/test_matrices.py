"""The verbs `reduce` and `place`: small models and places of sensors from matrix files."""

import json
from typing import Any

import numpy as np
import pytest

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime_services.matrices import read_reduced, write_matrix
from tests.services.matrices.written_files import write_dof_map
from tests.slowtime.finite_elements.frames import small_tower

MODEL: Any = assemble(small_tower(4))


@pytest.fixture
def model(tmp_path):
    held = [{"node": f"0.{c}"} for c in range(4)]
    write_matrix(tmp_path / "K.npz", _whole(MODEL.stiffness))
    write_matrix(tmp_path / "M.npz", _whole(MODEL.mass))
    parameters = []
    for k, (name, part) in enumerate(zip(MODEL.names, MODEL.stiffness_parts, strict=True)):
        write_matrix(tmp_path / f"{k}.npz", _whole(part))
        parameters.append({"name": name, "stiffness": f"{k}.npz", "prior_sd": 0.2})
    write_dof_map(tmp_path / "dofs.csv", MODEL.dofs)
    values = {
        "slowtime_model": 2,
        "matrices": {
            "stiffness": "K.npz",
            "mass": "M.npz",
            "dofs": "dofs.csv",
            "parameters": parameters,
            "held": held,
        },
        "sensors": [{"channel": "top", "node": "4.0", "direction": "ux"}],
    }
    path = tmp_path / "tower.yaml"
    path.write_text(json.dumps(values))
    return path


def _whole(matrix):
    """Over all degrees of freedom, the held ones without stiffness or mass."""
    return (MODEL.expansion @ matrix @ MODEL.expansion.T).tocsr()


def test_a_tower_is_reduced_and_its_error_stated(run, model, tmp_path):
    out = tmp_path / "r.npz"
    done = run("model", "reduce", model, "--modes", 6, "--out", "-", "--out", out)
    body = json.loads(done.out)
    np.testing.assert_allclose(
        body["frequency_hz"], nominal_modes(MODEL, 6).frequency_hz, rtol=1e-7
    )
    assert body["degrees_of_freedom"] == MODEL.size
    assert body["error"]["frequency"] < 1e-3
    assert read_reduced(out).size == body["coordinates"]


def test_the_band_of_the_sensors_sets_the_number_of_modes(run, model):
    frequency = nominal_modes(MODEL, 8).frequency_hz
    done = run(
        "model",
        "reduce",
        model,
        "--band-hz",
        frequency[4] * 1.001 / 1.5,
        "--setting",
        "trials=0",
    )
    assert len(done.out.splitlines()) == 1 + int(np.sum(frequency < frequency[4] * 1.001))


def test_places_beat_evenly_spread_ones_and_keep_what_is_there(run, model):
    found = json.loads(
        run(
            "model",
            "place",
            model,
            "--sensors",
            4,
            "--modes",
            5,
            "--setting",
            "criterion=variance",
            "--out",
            "-",
        ).out
    )
    assert len(found["sensors"]) == 4
    own = np.mean([one["posterior_sd"] for one in found["parameters"]])
    even = np.mean([one["evenly_spread_sd"] for one in found["parameters"]])
    assert own < even < 0.2
    kept = json.loads(
        run("model", "place", model, "--sensors", 3, "--modes", 5, "--keep", "--out", "-").out
    )
    assert kept["sensors"][0] == {"site": "top", "directions": ""}


def test_sites_together_have_a_sensor_in_every_direction(run, model):
    found = json.loads(
        run(
            "model", "place", model, "--sensors", 2, "--modes", 5, "--out", "-",
            "--together", "--direction", "ux", "--direction", "uy",
        ).out
    )  # fmt: skip
    assert [one["directions"] for one in found["sensors"]] == ["ux uy", "ux uy"]
    assert not any(one["site"].startswith("0.") for one in found["sensors"])
