"""The verbs on finite-element models: reduced files, updating from modes, simulation."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime_services.matrices import read_any_description, read_matrix_model

PORTAL = Path(__file__).parents[3] / "docs/tutorials/parts/portal"
CHANGE = np.array([-0.1, 0.05])
SENSORS = [(2, "ux"), (3, "uy"), (3, "uz"), (4, "uy")]


@pytest.fixture
def portal(tmp_path):
    """A model of the portal's matrices, with a hammer."""
    shutil.copytree(PORTAL, tmp_path / "portal")
    values = {
        "slowtime_model": 2,
        "matrices": {
            "stiffness": "portal/K.out",
            "mass": "portal/M.out",
            "dofs": "portal/dofs.csv",
            "parameters": [
                {
                    "name": name,
                    "stiffness": {"file": f"portal/{name}.out", "change": -0.1},
                    "prior_sd": 0.2,
                }
                for name in ("columns", "girder")
            ],
        },
        "inputs": [
            {"channel": "f", "kind": "force", "node": 2, "direction": "ux", "unit": "N"}
        ],
        "sensors": [
            {"channel": f"a{node}{way}", "node": node, "direction": way}
            for node, way in SENSORS
        ],
    }
    path = tmp_path / "portal.yaml"
    path.write_text(json.dumps(values))
    return path


def modes_file(path, model, change, *, sd=1e-4, channels=None):
    """Exact modes of the changed model, with small standard deviations."""
    stiffness, mass = model.matrices.at(change)[:2]
    modes = lowest_modes(stiffness, mass, 5)
    seen = model.matrices.rows(model.sensors) @ modes.shapes
    body: dict[str, Any] = {
        "slowtime_modes": 1,
        "record": "r.npz",
        "rate_hz": 64.0,
        "channels": channels or model.channels,
        "duration_s": 600.0,
        "assumptions": [],
        "modes": [
            {
                "frequency_hz": {"value": f, "sd": sd * f},
                "damping_ratio": {"value": 0.01, "sd": 0.001},
                "correlation": 0.0,
                "shape": {
                    "re": (shape / np.linalg.norm(shape)).tolist(),
                    "im": [0.0] * len(shape),
                    "sd": [0.002] * len(shape),
                },
                "kind": "structural",
                "quality": 1.0,
                "snr_db": None,
                "method": "modes",
                "span_s": [0.0, 600.0],
                "flags": [],
            }
            for f, shape in zip(modes.frequency_hz.tolist(), seen.T, strict=True)
        ],
    }
    path.write_text(json.dumps(body))
    return path


def test_groups_are_updated_from_a_modes_file(run, portal, tmp_path):
    model = read_matrix_model(portal)
    modes = modes_file(tmp_path / "modes.json", model, CHANGE)
    body = json.loads(run("model", "update", portal, modes, "--out", "-").out)
    assert body["shapes"]["sd_factor"] == 1.0
    assert body["shapes"]["chi_square"] < body["shapes"]["numbers"]
    found = np.array([one["change"] for one in body["parameters"]])
    sd = np.array([one["sd"] for one in body["parameters"]])
    np.testing.assert_allclose(found, CHANGE, atol=0.002)
    assert (np.abs(found - CHANGE) < 2 * sd).all()
    assert (sd < 0.01).all()
    for one in body["modes"]:
        assert one["updated_hz"] == pytest.approx(one["measured_hz"], rel=1e-4)
        before = abs(one["as_given_hz"] - one["measured_hz"])
        assert before > 10 * abs(one["updated_hz"] - one["measured_hz"])
    assert body["p_value"] > 0.5
    printed = run("model", "update", portal, modes).out
    assert "columns" in printed


def test_what_frequencies_alone_do_not_determine_is_listed(run, portal, tmp_path):
    model = read_matrix_model(portal)
    names = [f"other {k}" for k in range(4)]
    modes = modes_file(tmp_path / "modes.json", model, CHANGE, sd=0.2, channels=names)
    body = json.loads(run("model", "update", portal, modes, "--out", "-").out)
    assert body["not_determined"]
    assert all(one["ratio"] > 0.3 for one in body["parameters"])


def test_a_model_that_cannot_explain_the_modes_says_so(run, portal, tmp_path):
    model = read_matrix_model(portal)
    modes = modes_file(tmp_path / "modes.json", model, CHANGE)
    values = json.loads(modes.read_text())
    values["modes"][2]["frequency_hz"]["value"] *= 1.04
    modes.write_text(json.dumps(values))
    done = run("model", "update", portal, modes, "--frequency-error", 0)
    assert "does not explain the modes" in done.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"modes": []}, "has no structural mode"),
        ({"slowtime_modes": 7}, "is not a valid modes file"),
    ],
)
def test_other_files_are_refused(refused, portal, tmp_path, change, words):
    model = read_matrix_model(portal)
    modes = modes_file(tmp_path / "modes.json", model, CHANGE)
    modes.write_text(json.dumps(json.loads(modes.read_text()) | change))
    assert words in refused("model", "update", portal, modes)


@pytest.mark.parametrize("ending", ["json", "yaml"])
def test_a_reduced_model_file_is_simulated_as_its_original_is(run, portal, tmp_path, ending):
    small = tmp_path / f"small.{ending}"
    run("model", "reduce", portal, "--modes", 12, "--setting", "coordinates=60", "--out", small)
    rng = np.random.default_rng(3)
    np.savez(tmp_path / "in.npz", f=rng.standard_normal(500), rate_hz=200.0)
    found = []
    for model in (small, portal):
        out = tmp_path / "out.npz"
        run("simulate", "--model", model, "--input", tmp_path / "in.npz", "--out", out)
        with np.load(out) as archive:
            found.append(np.array([archive[f"a{node}{way}"] for node, way in SENSORS]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6, atol=1e-9)
    assert read_any_description(small).dofs[:4] == tuple(f"{n} {w}" for n, w in SENSORS)


def cantilever(joints):
    """Twenty beams on a soft spring at the tip, one of three places for joints."""
    return {
        "slowtime_model": 2,
        "frame": {
            "materials": [{"id": "steel", "young_pa": 2.1e11, "density_kg_m3": 7850.0}],
            "sections": [
                {"id": "bar", "shape": "rectangle", "width_m": 0.04, "height_m": 0.03}
            ],
            "nodes": [{"id": f"n{k}", "at": [0.1 * k, 0.0, 0.0]} for k in range(21)],
            "elements": [
                {
                    "id": f"e{k}",
                    "between": [f"n{k}", f"n{k + 1}"],
                    "section": "bar",
                    "material": "steel",
                    "theory": "euler",
                    "orientation": [0.0, 1.0, 0.0],
                }
                for k in range(20)
            ],
            "supports": [{"node": "n0"}],
            "parameters": [
                {"name": "root", "elements": [f"e{k}" for k in range(10)]},
                {"name": "tip", "elements": [f"e{k}" for k in range(10, 20)]},
            ],
        },
        "joints": joints,
        "inputs": [
            {
                "channel": "f", "kind": "force", "node": "n12", "direction": "uz",
                "unit": "N", "hold": "first",
            }
        ],
        "sensors": [
            {"channel": f"a{k}", "node": f"n{k}", "direction": "uz"} for k in (5, 10, 15, 20)
        ],
        "tolerance": {"stiffness": 0.02, "damping": 0.2, "mass": 0.0},
        "band_hz": 60.0,
    }  # fmt: skip


@pytest.mark.long
def test_a_hardening_joint_of_a_frame_is_named_and_sized_from_accelerations(run, tmp_path):
    free = {"direction": "uz"}
    joints = [
        {"id": "stop", "between": ["base", "n20"], "stiffness_n_per_m": 2000.0,
         "damping_n_s_per_m": 1.0, **free},
        {"id": "middle", "between": ["base", "n10"], **free},
        {"id": "quarter", "between": ["base", "n15"], **free},
    ]  # fmt: skip
    given = cantilever(joints)
    law = {"effect": "cubic_hardening", "element": "stop", "k3_n_per_m3": 1e8}
    (tmp_path / "given.yaml").write_text(json.dumps(given))
    (tmp_path / "truth.yaml").write_text(json.dumps(given | {"effects": [law]}))
    rng = np.random.default_rng(7)
    band = scipy.signal.butter(4, [3, 60], "band", fs=500.0, output="sos")
    force = 150.0 * scipy.signal.sosfilt(band, rng.standard_normal(4000))
    np.savez(tmp_path / "in.npz", f=force, rate_hz=500.0)
    run("simulate", "--model", "truth.yaml", "--input", "in.npz", "--out", "y.npz")
    with np.load(tmp_path / "y.npz") as clean:
        noisy = {
            name: clean[name] + 0.01 * clean[name].std() * rng.standard_normal(4000)
            for name in ("a5", "a10", "a15", "a20")
        }
    np.savez(tmp_path / "record.npz", f=force, rate_hz=500.0, **noisy)
    done = run("diagnose", "given.yaml", "record.npz", "--out", "found")
    assert done.status == 0, done.err
    (effect,) = json.loads((tmp_path / "found/report.json").read_text())["effects"]
    assert (effect["effect"], effect["where"]["id"]) == ("cubic_hardening", "stop")
    found = effect["parameters"]["k3_n_per_m3"]
    assert abs(found["value"] - 1e8) < 4 * found["sd"] < 2e6
