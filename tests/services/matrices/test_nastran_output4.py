"""OUTPUT4 files: written by pyYeti 1.4.7, by hand from the format, and by slowtime.

`written/pyyeti` holds what `write_with_pyyeti` made. Where pyYeti is installed, it is run too.
"""

import dataclasses
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from slowtime.finite_elements.assembly import assemble
from slowtime.finite_elements.eigenvalues import lowest_modes, nominal_modes
from slowtime_services.matrices import (
    MatrixFileError,
    read_dof_map,
    read_matrix,
    read_matrix_model,
    write_matrix,
    write_output4,
)
from slowtime_services.matrices.nastran_output4 import read_output4
from tests.slowtime.finite_elements.frames import line_of_beams, small_tower

WRITTEN = Path(__file__).parent / "written/pyyeti"
STIFFNESS = np.array(
    [
        [4.0e6, -1.0e6, 0.0, 0.0, 1.0 / 3.0],
        [-1.0e6, 3.0e6, -0.5e6, 0.0, 0.0],
        [0.0, -0.5e6, 2.0e-107, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0 / 3.0, 0.0, 0.0, 0.0, 7.0e12],
    ]
)
RECTANGLE = np.array([[0.0, 1.5, 0.0], [2.5, -3.5, 0.0]])
RECEPTANCE = STIFFNESS + 1j * np.eye(5)
LAYOUTS = ("dense", "bigmat", "nonbigmat")


def write_with_pyyeti(folder: Path) -> None:
    from pyyeti.nastran import op4  # type: ignore[import-not-found]

    matrices = {"KAA": STIFFNESS, "ROWS": RECTANGLE, "H": RECEPTANCE, "MAA": np.eye(5)}
    for layout in LAYOUTS:
        op4.write(str(folder / f"{layout}.op4"), matrices, sparse=layout, binary=False)
        for order, name in (("<", "little"), (">", "big")):
            path = folder / f"{layout}_{name}.op4"
            op4.write(str(path), matrices, sparse=layout, binary=True, endian=order)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("ending", ["", "_little", "_big"])
def test_files_of_pyyeti_are_read_exactly(layout, ending):
    path = WRITTEN / f"{layout}{ending}.op4"
    np.testing.assert_array_equal(read_matrix(path, "KAA").toarray(), STIFFNESS)
    np.testing.assert_array_equal(read_matrix(path, "maa").toarray(), np.eye(5))
    rows = read_matrix(path, "ROWS", square=False).toarray()
    np.testing.assert_array_equal(rows, RECTANGLE)
    with pytest.raises(MatrixFileError, match=r"H of .* has form 6 and type 4.*real"):
        read_matrix(path, "H")
    with pytest.raises(MatrixFileError, match=r"'K' was named.*KAA, ROWS, H, MAA.*variable"):
        read_matrix(path, "K")
    with pytest.raises(MatrixFileError, match=r"No variable was named.*KAA, ROWS, H, MAA"):
        read_matrix(path)


def test_the_installed_pyyeti_writes_what_is_kept(tmp_path):
    pytest.importorskip("pyyeti")
    write_with_pyyeti(tmp_path)
    for path in sorted(WRITTEN.iterdir()):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("binary", [True, False])
def test_pyyeti_reads_what_is_written(tmp_path, layout, binary):
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    stiffness = assemble(small_tower(2)).stiffness
    path = tmp_path / "k.op4"
    both = {"KAA": stiffness, "ROWS": sparse.csr_array(RECTANGLE)}
    write_output4(path, both, layout=layout, binary=binary)
    found = op4.read(str(path))
    np.testing.assert_array_equal(found["kaa"], stiffness.toarray())
    np.testing.assert_array_equal(found["rows"], RECTANGLE)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("binary", [True, False])
def test_what_is_written_is_read_again_exactly(tmp_path, layout, binary):
    stiffness = assemble(small_tower(2)).stiffness
    both = {"KAA": stiffness, "SMALL": sparse.csr_array(STIFFNESS)}
    path = tmp_path / "k.op4"
    write_output4(path, both, layout=layout, binary=binary)
    np.testing.assert_array_equal(read_matrix(path, "KAA").toarray(), stiffness.toarray())
    np.testing.assert_array_equal(read_matrix(path, "SMALL").toarray(), STIFFNESS)


def test_a_full_column_of_many_rows_is_cut_into_packed_strings(tmp_path):
    column = sparse.csr_array(np.arange(1.0, 20001.0)[:, None])
    path = tmp_path / "c.op4"
    write_output4(path, {"C": column}, layout="nonbigmat")
    assert (read_matrix(path, square=False) - column).nnz == 0
    tall = sparse.csr_array(([2.0], ([69999], [0])), shape=(70000, 1))
    with pytest.raises(MatrixFileError, match=r"70000 rows.*65535; choose bigmat"):
        write_output4(path, {"C": tall}, layout="nonbigmat")
    write_output4(path, {"C": tall})
    assert read_matrix(path, square=False)[69999, 0] == 2.0


def records(*bodies: bytes) -> bytes:
    marks = [struct.pack("<i", len(body)) for body in bodies]
    return b"".join(mark + body + mark for mark, body in zip(marks, bodies, strict=True))


def test_single_precision_is_read_from_words_of_four_bytes(tmp_path):
    head = struct.pack("<4i", 2, 2, 6, 1) + b"K       "
    first = struct.pack("<3i", 1, 1, 2) + struct.pack("<2f", 2.0, -1.0)
    second = struct.pack("<4i", 2, 0, 3, 3 * 65536 + 1) + struct.pack("<2f", -1.0, 4.0)
    end = struct.pack("<3i", 3, 1, 1) + struct.pack("<f", 1.0)
    path = tmp_path / "single.op4"
    path.write_bytes(records(head, first, second, end))
    np.testing.assert_array_equal(read_matrix(path).toarray(), [[2.0, -1.0], [-1.0, 4.0]])


def test_integers_of_eight_bytes_come_with_reals_of_eight_bytes(tmp_path):
    head = struct.pack("<4q", 2, -2, 6, 1) + b"STIF    F       "
    first = struct.pack("<5q", 1, 0, 4, 3, 1) + struct.pack("<2d", 2.0, -1.0)
    second = struct.pack("<5q", 2, 0, 4, 3, 1) + struct.pack("<2d", -1.0, 4.0)
    end = struct.pack("<3q", 3, 1, 1) + struct.pack("<d", 1.0)
    path = tmp_path / "i64.op4"
    path.write_bytes(records(head, first, second, end))
    np.testing.assert_array_equal(
        read_matrix(path, "STIFF").toarray(), [[2.0, -1.0], [-1.0, 4.0]]
    )


def test_text_of_fortran_with_d_and_with_bare_exponents_is_read(tmp_path):
    path = tmp_path / "text.op4"
    path.write_text(
        "       2       2       1       2KAA     1P,3D23.16\n"
        "       1       1       2\n"
        " 1.0000000000000000D+00-2.5000000000000000D+03\n"
        "       2       2       1\n"
        " 3.0000000000000000-101\n"
        "       3       1       1\n"
        " 1.0000000000000000D+00\n"
    )
    found = read_matrix(path).toarray()
    np.testing.assert_array_equal(found, [[1.0, -2500.0], [-2500.0, 3.0e-101]])


def test_wide_integers_of_large_matrices_are_read(tmp_path):
    path = tmp_path / "wide.op4"
    path.write_text(
        f"{2:16}{-10000001:16}{2:8}{2:8}MATD    1P,3E23.16|I16\n{1:8}{0:8}{4:8}\n"
        f"{3:8}{10000000:8}\n{5.5:23.16E}\n{3:8}{1:8}{1:8}\n{1.0:23.16E}\n"
    )
    found = read_matrix(path, square=False)
    assert found.shape == (10000001, 2)
    assert found.nnz == 1
    assert found[9999999, 0] == 5.5


@pytest.mark.parametrize("name", ["bigmat.op4", "dense_little.op4", "nonbigmat_big.op4"])
def test_files_cut_anywhere_are_refused_or_whole(tmp_path, name):
    whole = (WRITTEN / name).read_bytes()
    path = tmp_path / "cut.op4"
    refused = 0
    for end in range(1, len(whole) - 1, 7):
        path.write_bytes(whole[:end])
        try:
            found = read_output4(path, "KAA")
        except MatrixFileError:
            refused += 1
            continue
        np.testing.assert_array_equal(found.toarray(), STIFFNESS)
    assert refused > len(whole) // 14


def test_rows_outside_of_the_matrix_are_refused(tmp_path):
    path = tmp_path / "bad.op4"
    text = (
        (WRITTEN / "bigmat.op4").read_text().replace("       3       1\n", "       3       9\n")
    )
    path.write_text(text)
    with pytest.raises(MatrixFileError, match=r"5 rows and 5 columns.*damaged"):
        read_output4(path, "MAA")


def test_a_name_of_nine_letters_is_refused(tmp_path):
    with pytest.raises(MatrixFileError, match=r"'stiffness'.*one to eight"):
        write_matrix(tmp_path / "k.op4", sparse.csr_array(STIFFNESS), "stiffness")


def test_matrices_over_all_points_go_with_the_bulk_data(tmp_path):
    frame = line_of_beams(3, parameters=())
    held = nominal_modes(assemble(frame), 3).frequency_hz
    free = assemble(dataclasses.replace(frame, supports=()))
    write_output4(tmp_path / "kgg.op4", {"KGG": free.stiffness, "MGG": free.mass})
    cards = [f"GRID,{k + 1},,{x:.6f},0.,0." for k, x in enumerate(frame.coordinates[:, 0])]
    (tmp_path / "m.bdf").write_text("\n".join(reversed(cards)) + "\n")
    model = {
        "slowtime_model": 2,
        "matrices": {
            "stiffness": {"file": "kgg.op4", "variable": "KGG"},
            "mass": {"file": "kgg.op4", "variable": "MGG"},
            "dofs": "m.bdf",
            "held": [{"node": 1}],
        },
        "sensors": [{"channel": "tip", "node": 4, "direction": "uz"}],
    }
    (tmp_path / "model.yaml").write_text(json.dumps(model))
    read = read_matrix_model(tmp_path / "model.yaml")
    found = lowest_modes(read.matrices.stiffness, read.matrices.mass, 3).frequency_hz
    np.testing.assert_allclose(found, held, rtol=1e-9)


def test_scalar_points_have_one_row(tmp_path):
    path = tmp_path / "m.bdf"
    path.write_text("GRID,12,,1.,0.,0.\nSPOINT,3,THRU,4\nSPOINT,20\n")
    assert read_dof_map(path).names[:3] == ("3 ux", "4 ux", "12 ux")
    assert read_dof_map(path).size == 9
    path.write_text("SOL 103\n")
    with pytest.raises(MatrixFileError, match=r"neither DMIG nor GRID"):
        read_dof_map(path)
