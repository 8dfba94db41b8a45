import numpy as np
import pytest
import scipy.io
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.degrees_of_freedom import DofMap
from slowtime_services.matrices import (
    MatrixFileError,
    read_dof_map,
    read_matrix,
    write_matrix,
)
from slowtime_services.matrices.nastran_bulk import read_dmig, read_grids
from tests.services.matrices.written_files import write_dmig, write_dof_map
from tests.slowtime.finite_elements.frames import small_tower

MATRIX = assemble(small_tower(2)).stiffness
SMALL = np.array([[4.0, -1.0, 0.0], [-1.0, 3.0, -0.5], [0.0, -0.5, 2.0]])


@pytest.mark.parametrize("ending", [".mtx", ".npz", ".mat", ".h5"])
def test_what_is_written_is_read_again_exactly(tmp_path, ending):
    path = tmp_path / f"k{ending}"
    write_matrix(path, MATRIX, "K")
    np.testing.assert_array_equal(read_matrix(path).toarray(), MATRIX.toarray())


def test_files_of_scipys_own_writers_are_read(tmp_path):
    whole = sparse.csc_array(SMALL)
    scipy.io.hb_write(tmp_path / "k.hb", whole)
    np.testing.assert_allclose(read_matrix(tmp_path / "k.hb").toarray(), SMALL)
    scipy.io.mmwrite(tmp_path / "k.mtx", whole, symmetry="symmetric")
    np.testing.assert_allclose(read_matrix(tmp_path / "k.mtx").toarray(), SMALL)
    scipy.io.savemat(tmp_path / "two.mat", {"K": SMALL, "M": np.eye(3)})
    np.testing.assert_allclose(read_matrix(tmp_path / "two.mat", "M").toarray(), np.eye(3))


def test_a_file_of_several_matrices_wants_a_name(tmp_path):
    path = tmp_path / "two.mat"
    scipy.io.savemat(path, {"K": SMALL, "M": np.eye(3)})
    with pytest.raises(MatrixFileError, match=r"No variable was named, and two.mat holds K, M"):
        read_matrix(path)
    with pytest.raises(MatrixFileError, match=r"'C' was named, and two.mat holds K, M"):
        read_matrix(path, "C")


def test_a_single_triangle_of_calculix_is_mirrored(tmp_path):
    path = tmp_path / "job.sti"
    path.write_text("1 1 4.D0\n2 1 -1.0\n2 2 3.0\n3 2 -0.5\n3 3 2.0\n")
    np.testing.assert_array_equal(read_matrix(path).toarray(), SMALL)
    (tmp_path / "job.dof").write_text("1.1\n1.3\n2.1\n")
    assert read_dof_map(tmp_path / "job.dof").names == ("1 ux", "1 uz", "2 ux")


def test_abaqus_matrix_input_orders_rows_by_node_and_direction(tmp_path):
    path = tmp_path / "job_STIF1.mtx"
    path.write_text(
        "*MATRIX INPUT, NAME=K\n** comment\n"
        "7,2, 7,2, 2.0\n3,1, 3,1, 4.0\n3,1, 3,2, -1.0\n3,2, 3,2, 3.0\n3,2, 7,2, -0.5\n"
    )
    np.testing.assert_array_equal(read_matrix(path).toarray(), SMALL)


def test_dmig_is_read_in_small_large_and_free_fields(tmp_path):
    path = tmp_path / "k.bdf"
    path.write_text(
        "$ a comment\n"
        "GRID           1              0.     1.5     -2.\n"
        "GRID*                  2                         1.5+1             0.D0\n"
        "*                     3.\n"
        "DMIG    KAAX           0       6       1       0\n"
        "DMIG*   KAAX                           1               1\n"
        "*                      1               1           4.0D0\n"
        "*                      1               3          -1.0+0\n"
        "DMIG    KAAX           1       3               1       3     3.0\n"
        "+              2       1   -5.-1\n"
        "DMIG,KAAX,2,1,,2,1,2.0\n"
    )
    matrix, places = read_dmig(path)
    assert places == [("1", 0), ("1", 2), ("2", 0)]
    np.testing.assert_allclose(read_matrix(path).toarray(), SMALL)
    assert read_grids(path) == {"1": (0.0, 1.5, -2.0), "2": (15.0, 0.0, 3.0)}
    assert read_dof_map(path).names == ("1 ux", "1 uz", "2 ux")
    assert matrix.shape == (3, 3)


def test_dmig_written_is_read_again(tmp_path):
    places = [(str(k // 6 + 1), k % 6) for k in range(MATRIX.shape[0])]
    path = tmp_path / "k.pch"
    write_dmig(path, "KAAX", MATRIX, places)
    assert read_dmig(path)[1] == places
    np.testing.assert_allclose(read_matrix(path).toarray(), MATRIX.toarray(), rtol=1e-9)


def test_a_map_written_is_read_again(tmp_path):
    dofs = DofMap(
        node_names=("top", "7"),
        coordinates=np.array([[0.1, 0.2, 1 / 3], [0, 0, 1.0]]),
        node=np.array([0, 0, 1]),
        direction=np.array([0, 5, 2]),
    )
    write_dof_map(tmp_path / "dofs.csv", dofs)
    found = read_dof_map(tmp_path / "dofs.csv")
    assert found.names == dofs.names
    np.testing.assert_array_equal(found.coordinates, dofs.coordinates)


def test_positions_may_stand_in_a_file_of_their_own(tmp_path):
    (tmp_path / "dofs.csv").write_text("node,direction\na,3\nb,3\n")
    (tmp_path / "nodes.csv").write_text("node,x,y,z\nb,1,2,3\n")
    found = read_dof_map(tmp_path / "dofs.csv", tmp_path / "nodes.csv")
    np.testing.assert_array_equal(found.coordinates, [[0, 0, 0], [1, 2, 3]])
    assert found.names == ("a uz", "b uz")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("k.sti", "1 1\n", "2 numbers in its first line"),
        ("k.sti", "0 1 2.0\n", "number 0\\. They must be whole numbers, counted from 1"),
        ("k.sti", "1 1 2.0\n1 2.5 1.0\n", "number 2\\.5\\. They must be whole"),
        ("k.mtx", "%%MatrixMarket matrix nonsense\n", "cannot be read"),
        ("k.xyz", "1", "names no format of matrices"),
        ("k.bdf", "GRID,1,,0.,0.,0.\n", "holds the DMIG matrices none"),
        ("k.npz", "no archive", "cannot be read"),
    ],
)
def test_other_files_are_refused_with_what_to_do(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(MatrixFileError, match=message):
        read_matrix(tmp_path / name)


def test_tables_without_columns_or_with_other_directions_are_refused(tmp_path):
    path = tmp_path / "dofs.csv"
    path.write_text("node,way\n1,ux\n")
    with pytest.raises(MatrixFileError, match="direction is missing"):
        read_dof_map(path)
    path.write_text("node,direction\n1,up\n")
    with pytest.raises(MatrixFileError, match=r"Line 2 of dofs.csv has the direction 'up'"):
        read_dof_map(path)
    path.write_text("node,direction\n1,ux\n1,1\n")
    with pytest.raises(MatrixFileError, match="Give each pair once"):
        read_dof_map(path)
