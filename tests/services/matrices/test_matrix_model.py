import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import nominal_modes
from slowtime.finite_elements.reduction import BasisSettings, reduce_modal
from slowtime_schemas.files.model_v2 import LineModelFile, ModelFile2, migrated
from slowtime_services.matrices import (
    MatrixFileError,
    read_matrix_model,
    read_reduced,
    write_matrix,
    write_reduced,
)
from tests.services.matrices.written_files import write_dof_map
from tests.slowtime.finite_elements.frames import small_tower

FRAME = small_tower(3)
FREE: Any = assemble(dataclasses.replace(FRAME, supports=()))


@pytest.fixture
def folder(tmp_path):
    write_matrix(tmp_path / "K.mtx", FREE.stiffness)
    write_matrix(tmp_path / "all.h5", FREE.mass, "M")
    for name, part in zip(FREE.names, FREE.stiffness_parts, strict=True):
        write_matrix(tmp_path / "all.h5", part, name)
    write_dof_map(tmp_path / "dofs.csv", FREE.dofs)
    return tmp_path


def text(**more):
    values: dict[str, Any] = {
        "slowtime_model": 2,
        "matrices": {
            "stiffness": "K.mtx",
            "mass": {"file": "all.h5", "variable": "M"},
            "dofs": "dofs.csv",
            "parameters": [
                {"name": n, "stiffness": {"file": "all.h5", "variable": n}, "prior_sd": 0.2}
                for n in FREE.names
            ],
            "held": [{"node": f"0.{c}"} for c in range(4)],
        },
        "sensors": [
            {"channel": "a", "node": "3.0", "direction": "ux"},
            {"channel": "b", "node": "2.1", "line": [0.6, 0.0, 0.8]},
        ],
    }
    for key, value in more.items():
        values["matrices"][key] = value
    return json.dumps(values)


def test_a_model_of_files_is_the_model_that_wrote_them(folder):
    (folder / "m.yaml").write_text(text())
    read = read_matrix_model(folder / "m.yaml")
    expected = assemble(FRAME)
    np.testing.assert_allclose(
        nominal_modes(read.matrices, 8).frequency_hz,
        nominal_modes(expected, 8).frequency_hz,
        rtol=1e-9,
    )
    theta = np.array([0.1, -0.2, 0.3])
    np.testing.assert_allclose(
        read.matrices.at(theta)[0].toarray(), expected.at(theta)[0].toarray(), rtol=1e-9
    )
    assert read.channels == ("a", "b")
    assert read.sensors[1, FREE.dofs.find("2.1", "uz")] == 0.8
    np.testing.assert_array_equal(read.prior_sd, 0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": "none.mtx"}, "There is no file"),
        ({"mass": "all.h5"}, "No variable was named"),
        ({"parameters": [{"name": "p"}]}, "neither `stiffness` nor `mass`"),
        ({"held": [{"node": "9"}]}, "Node '9', direction 'ux' was given"),
        ({"dofs": None, "held": []}, "`sensors` need `dofs`"),
        ({"spring": 1}, "spring"),
    ],
)
def test_models_that_cannot_be_read_say_what_to_do(folder, change, message):
    (folder / "m.yaml").write_text(text(**change))
    with pytest.raises(MatrixFileError, match=message):
        read_matrix_model(folder / "m.yaml")


def test_a_file_of_version_1_is_one_of_version_2_without_matrices(folder):
    first = {
        "slowtime_model": 1,
        "nodes": [{"id": "m", "mass_kg": 2.0}],
        "elements": [{"id": "k", "between": ["base", "m"], "stiffness_n_per_m": 100.0}],
    }
    model = ModelFile2.model_validate(migrated(first)).root
    assert isinstance(model, LineModelFile)
    assert model.nodes[0].id == "m"
    assert first["slowtime_model"] == 1
    (folder / "one.yaml").write_text(json.dumps(first))
    with pytest.raises(MatrixFileError, match="has neither `matrices` nor `frame`"):
        read_matrix_model(folder / "one.yaml")
    with pytest.raises(ValidationError, match="Give one of the two"):
        ModelFile2.model_validate({"slowtime_model": 2, "matrices": None})


def test_a_reduced_model_written_is_read_again(tmp_path):
    reduced = reduce_modal(assemble(FRAME), BasisSettings(modes=6, coordinates=30))
    write_reduced(tmp_path / "r.npz", reduced)
    found = read_reduced(tmp_path / "r.npz")
    theta = np.array([0.2, -0.1, 0.3])
    one, other = reduced.modes(theta, 6), found.modes(theta, 6)
    np.testing.assert_array_equal(one.eigenvalue, other.eigenvalue)
    rows = np.random.default_rng(1).standard_normal((2, FREE.size))
    np.testing.assert_array_equal(reduced.sense(rows), found.sense(rows))
    assert found.error == reduced.error
    np.savez(tmp_path / "other.npz", a=np.ones(2))
    with pytest.raises(MatrixFileError, match="`slowtime model reduce --out` wrote"):
        read_reduced(tmp_path / "other.npz")
