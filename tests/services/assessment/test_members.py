"""Members and connections of model files, and states at common channels."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from slowtime_services.assessment import StateErrors, members_of, planned_state, read_states
from slowtime_services.matrices import MatrixFileError, read_matrix_model
from slowtime_services.matrices.measured_files import read_modes_file
from tests.slowtime_cli.models.test_finite_elements import modes_file

STOREYS = Path(__file__).parents[3] / "docs/examples/two_storeys.yaml"
E, I, LENGTH = 2.1e11, 1e-6, 3.0


def cantilever(spring=None):
    """A beam that is clamped, or held by a spring about both axes at its foot."""
    held = ["ux", "uy", "uz", "rx", "ry", "rz"]
    given: dict[str, Any] = {
        "slowtime_model": 2,
        "frame": {
            "materials": [{"id": "m", "young_pa": E, "poisson": 0.3, "density_kg_m3": 7850.0}],
            "sections": [
                {"id": "s", "area_m2": 1e-3, "inertia_y_m4": I, "inertia_z_m4": I,
                 "torsion_m4": 2 * I}
            ],
            "nodes": [{"id": "a", "at": [0, 0, 0]}, {"id": "b", "at": [LENGTH, 0, 0]}],
            "elements": [
                {"id": "beam", "between": ["a", "b"], "section": "s", "material": "m",
                 "theory": "euler"}
            ],
            "masses": [{"id": "tip", "node": "b", "mass_kg": 100.0}],
            "supports": [{"node": "a", "directions": held if spring is None else held[:4]}],
            "parameters": [{"name": "beam", "elements": ["beam"]}],
        },
        "sensors": [{"channel": "y", "node": "b", "direction": "uy"}],
    }  # fmt: skip
    if spring is not None:
        given["frame"]["elements"].append(
            {"id": "foot", "kind": "spring", "between": ["base", "a"],
             "rotation_nm_per_rad": [0.0, spring, spring]}
        )  # fmt: skip
        given["frame"]["parameters"].append({"name": "foot", "elements": ["foot"]})
    return given


def read(tmp_path, given):
    path = tmp_path / "model.yaml"
    path.write_text(yaml.safe_dump(given))
    return read_matrix_model(path)


def test_a_loose_end_loses_the_share_that_a_spring_in_the_joint_leaves(tmp_path):
    """Of a joint of stiffness k, k / (k + 4 E I / L) of the fixity is left."""
    spring = 3e5
    members = members_of(read(tmp_path, cantilever()), ends=True)
    # The tip alone holds its rotation by the beam, and is no candidate.
    assert members.kinds == {"beam": "member", "end of beam at a": "connection"}
    lost = 1.0 - spring / (spring + 4 * E * I / LENGTH)
    loose = members.matrices.at(np.array([0.0, -lost]))[0].toarray()
    other = read(tmp_path, cantilever(spring)).matrices.stiffness.toarray()
    # Condense the rotations of the foot, which come first, out of the model with the spring.
    head, tail = other[:2, :2], other[2:, 2:]
    expected = tail - other[2:, :2] @ np.linalg.solve(head, other[:2, 2:])
    np.testing.assert_allclose(loose, expected, rtol=1e-9, atol=1e-6 * expected.max())


def test_springs_are_connections_and_masses_no_members(tmp_path):
    given = cantilever(spring=3e5)
    given["frame"]["masses"][0]["group"] = "load"
    given["frame"]["parameters"].append({"name": "load", "groups": ["load"], "acts_on": "mass"})
    members = members_of(read(tmp_path, given))
    assert members.kinds == {"beam": "member", "foot": "connection"}
    assert members.matrices.mass_parts == (None, None)


def test_a_model_without_members_is_refused(tmp_path):
    given = cantilever()
    given["frame"]["parameters"] = []
    with pytest.raises(MatrixFileError, match="no parameter of the stiffness"):
        members_of(read(tmp_path, given))


def test_states_are_read_at_the_channels_that_both_have(tmp_path):
    model = read_matrix_model(STOREYS)
    one = modes_file(tmp_path / "one.json", model, np.zeros(16))
    body = json.loads(one.read_text())
    # The second file lacks the first channel, and has the others in reverse.
    body["channels"] = body["channels"][:0:-1]
    for mode in body["modes"]:
        shape = mode["shape"]
        norm = np.linalg.norm(shape["re"][1:])
        mode["shape"] = {key: [v / norm for v in shape[key][:0:-1]] for key in shape}
    (tmp_path / "other.json").write_text(json.dumps(body))
    files = [read_modes_file(tmp_path / name) for name in ("one.json", "other.json")]
    before, now = read_states(model, files[0], files[1], StateErrors(0.003, 0.0))
    assert before.channels is not None
    assert before.shapes is not None
    assert now.shapes is not None
    np.testing.assert_array_equal(before.channels, model.sensors[1:])
    np.testing.assert_allclose(before.shapes, now.shapes, atol=1e-12)
    np.testing.assert_allclose(before.relative_sd, np.hypot(1e-4, 0.003))


def test_more_planned_modes_than_the_model_has_are_refused(tmp_path):
    model = read(tmp_path, cantilever())
    with pytest.raises(MatrixFileError, match="7 modes of a model that has 6"):
        planned_state(model, None, 7, frequency_sd=1e-3, shape_sd=0.01)  # type: ignore[arg-type]
