"""Matrices written by CalculiX 2.20 and OpenSees 3.7.1, and the frequencies they print.

`written/` and the tutorial's `portal` hold the files and the inputs that made them. Where ccx
is installed, it is run too.
"""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slowtime.finite_elements.eigenvalues import lowest_modes, nominal_modes
from slowtime_services.matrices import (
    MatrixFileError,
    describe_reduced,
    read_matrix,
    read_matrix_model,
)

WRITTEN = Path(__file__).parent / "written"
CALCULIX = WRITTEN / "calculix"
OPENSEES = Path(__file__).parents[3] / "docs/tutorials/parts/portal"
CALCULIX_HZ = (113.1360, 135.8728, 664.2724, 730.9756)
WEAK_CALCULIX_HZ = (107.9758, 129.7023, 640.4588, 715.7218)
"""With the group at the root 10 % softer."""
WEAK_OPENSEES_HZ = (3.186375305, 6.175707529, 8.624317389, 13.69214878)
"""With the columns 10 % softer."""


def written(folder: Path, tmp_path: Path, **matrices: Any) -> Path:
    for file in folder.iterdir():
        shutil.copy(file, tmp_path)
    path = tmp_path / "model.yaml"
    sensors = matrices.pop("sensors", [])
    path.write_text(json.dumps({"slowtime_model": 2, "matrices": matrices, "sensors": sensors}))
    return path


def calculix(tmp_path: Path, **more: Any) -> Path:
    return written(
        CALCULIX,
        tmp_path,
        stiffness="beam.sti",
        mass="beam.mas",
        dofs="beam.dof",
        positions="beam.inp",
        parameters=[{"name": "root", "stiffness": {"file": "weak.sti", "change": -0.1} | more}],
        sensors=[{"channel": "tip", "node": 6, "direction": "uz"}],
    )


def opensees(tmp_path: Path, **more: Any) -> Path:
    group = {"file": "columns.out", "change": -0.1} | more
    return written(
        OPENSEES,
        tmp_path,
        stiffness="K.out",
        mass="M.out",
        dofs="dofs.csv",
        parameters=[{"name": "columns", "stiffness": group}],
        sensors=[{"channel": "top", "node": 3, "direction": "ux"}],
    )


def test_matrices_of_calculix_have_the_frequencies_that_it_prints(tmp_path):
    model = read_matrix_model(calculix(tmp_path))
    dofs: Any = model.matrices.dofs
    np.testing.assert_allclose(
        nominal_modes(model.matrices, 4).frequency_hz, CALCULIX_HZ, rtol=1e-6
    )
    assert dofs.names[:3] == ("2 ux", "2 uy", "2 uz")
    np.testing.assert_allclose(dofs.coordinates[dofs.node_names.index("6")], [1.0, 0.0, 0.0])
    stiffness, mass = model.matrices.at(np.array([-0.1]))
    np.testing.assert_allclose(
        lowest_modes(stiffness, mass, 4).frequency_hz, WEAK_CALCULIX_HZ, rtol=1e-6
    )


def test_matrices_of_opensees_have_the_frequencies_that_it_prints(tmp_path):
    model = read_matrix_model(opensees(tmp_path))
    printed = np.loadtxt(WRITTEN / "opensees/frequencies.txt")
    found = nominal_modes(model.matrices, 6).frequency_hz
    np.testing.assert_allclose(found, printed, rtol=1e-8)
    theta = np.array([-0.1])
    np.testing.assert_allclose(
        lowest_modes(*model.matrices.at(theta), 4).frequency_hz, WEAK_OPENSEES_HZ, rtol=1e-8
    )
    reduced = describe_reduced(model)
    assert reduced.description.dofs[0] == "3 ux"


def test_a_change_of_another_size_or_of_nothing_is_told(tmp_path):
    with pytest.raises(MatrixFileError, match=r"line 1.*Give the relative change"):
        read_matrix_model(calculix(tmp_path, change=0.0))
    with pytest.raises(MatrixFileError, match=r"beam.sti equals the whole matrix"):
        read_matrix_model(calculix(tmp_path, file="beam.sti"))


def test_a_matrix_that_was_appended_to_is_refused(tmp_path):
    twice = (OPENSEES / "K.out").read_text() * 2
    (tmp_path / "K.out").write_text(twice)
    with pytest.raises(MatrixFileError, match=r"36 lines of 18 numbers.*delete the file"):
        read_matrix(tmp_path / "K.out")
    (tmp_path / "K.out").write_text("1 a\n2 3\n")
    with pytest.raises(MatrixFileError, match="not a matrix of numbers"):
        read_matrix(tmp_path / "K.out")


@pytest.mark.skipif(shutil.which("ccx") is None, reason="calculix-ccx is not installed")
def test_the_installed_calculix_writes_what_is_kept(tmp_path):
    shutil.copy(CALCULIX / "beam.inp", tmp_path)
    subprocess.run(["ccx", "beam"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    for ending in (".sti", ".mas"):
        new, kept = (
            read_matrix(tmp_path / f"beam{ending}"),
            read_matrix(CALCULIX / f"beam{ending}"),
        )
        largest = np.abs(kept.data).max()
        np.testing.assert_allclose(new.toarray(), kept.toarray(), atol=1e-9 * largest)
    assert (tmp_path / "beam.dof").read_text() == (CALCULIX / "beam.dof").read_text()
