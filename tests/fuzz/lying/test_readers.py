"""Lies that a reader refuses before it does anything, told without starting a process."""

import time
from pathlib import Path

import pytest

from slowtime_services.documents.bounds import Bounds, DocumentError, document_text
from slowtime_services.documents.json_documents import read_json
from slowtime_services.documents.toml_documents import read_toml
from slowtime_services.documents.yaml_lines import YamlError, read_with_lines
from slowtime_services.files import RecordError
from slowtime_services.files.binary.expansion import FREE_BYTES, MOST_TIMES, refuse_expansion
from slowtime_services.matrices import MatrixFileError, read_matrix
from slowtime_services.matrices.meshes.conversion import convert_mesh
from slowtime_services.models import read_model
from slowtime_services.problem_files.expressions import Expression, ExpressionError
from tests.slowtime_cli.broken_inputs import INTERNALS

from . import models, records

MOST_S = 2.0
YAML_ALL_THE_SAME = ("long_text", "wrong_items", "empty_items")
"""Lies that are refused as a model, not as YAML."""
QUICK_MATRICES = [
    (".mtx", models.mtx_of_more_rows), (".mtx", models.mtx_of_more_entries),
    (".mtx", models.mtx_of_a_dense_matrix), (".npz", models.npz_of_more_rows),
    (".mat", models.mat_of_nested_cells), (".h5", models.hdf5_of_more_rows),
    (".h5", models.hdf5_of_zeros), (".h5", models.hdf5_with_external_storage),
    (".h5", models.hdf5_with_an_external_link), (".sti", models.calculix_of_far_rows),
    (".sti", models.calculix_of_infinite_rows), (".op4", models.output4_of_more_rows),
    (".op4", models.output4_of_more_numbers), (".pch", models.dmig_of_digits),
]  # fmt: skip


@pytest.fixture(autouse=True)
def quickly():
    began = time.process_time()
    yield
    assert time.process_time() - began < MOST_S


@pytest.mark.parametrize("name", [n for n in models.LIES if n not in YAML_ALL_THE_SAME])
def test_a_lying_yaml_text_is_refused_with_its_line(name):
    with pytest.raises(YamlError) as refused:
        read_with_lines(models.LIES[name])
    assert refused.value.line >= 1
    assert not INTERNALS.search(str(refused.value))


@pytest.mark.parametrize(
    ("nodes", "why"),
    [
        ("[" + "1," * 250_000 + "1]", "not 1"),
        ("[" + "{}," * 150_000 + "{}]", "`id` is missing"),
        ("[{" + ", ".join(f"k{n}: 1" for n in range(20_000)) + "}]", "more than 10,000 keys"),
    ],
    ids=["numbers", "tables", "keys"],
)
def test_a_document_of_faults_is_left_at_the_first_of_each_list(tmp_path, nodes, why):
    path = tmp_path / "m.yaml"
    path.write_text(f"slowtime_model: 1\nname: rig\nnodes: {nodes}\n")
    with pytest.raises(ValueError, match=r"m\.yaml, line 3") as refused:
        read_model(path)
    assert why in str(refused.value)
    assert len(str(refused.value)) < 1_000


def test_a_key_that_stands_twice_names_both_lines():
    with pytest.raises(YamlError, match="stands here twice, first on line 1"):
        read_with_lines("a: 1\nb: 2\na: 3\n")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[" * 200_000, "200,000 levels deep. Allowed: 64"),
        ('{"a":' * 5_000 + "1" + "}" * 5_000, "5,000 levels deep"),
        ("9" * 5000, "5,000 digits"),
        ("-" + "9" * 399, "larger than 1.8e308"),
        ("[1, 1e400]", "`1e400` is not a valid number"),
        ('{"a": 1, "b": 2, "a": 3}', "`a` stands twice"),
        ("[" + "1," * 600_000 + "1]", "600,001 values or lines. Allowed: 500,000"),
        ('{"' * 20_000, "10,000 levels deep"),
        ('"' + "\\" * 300_001, "This is not JSON"),
        ("nul", "This is not JSON: Expecting value, line 1, column 1"),
        (b"\xff\xfe\xff", "not text"),
    ],
    ids=lambda text: str(text)[:12],
)
def test_a_lying_json_text_is_refused(text, why):
    with pytest.raises(DocumentError, match=why) as refused:
        read_json(text)
    assert not INTERNALS.search(str(refused.value))


def test_brackets_within_texts_are_no_levels():
    assert read_json('{"a": "' + "[" * 500 + '\\"{"}')["a"].startswith("[[[")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a = " + "[" * 100_000, "nested too deep"),
        ("a = " + "9" * 5000, "larger than numbers can be"),
        ("a = " + "9" * 401, "Allowed: 64"),
        ("a = 1e400", "larger than numbers can be"),
        (".".join(["a"] * 20_000) + " = 1", "more than 32 parts"),
        ("[" + ".".join(["a"] * 20_000) + "]", "more than 32 parts"),
        ("x = {" + ".".join(["a"] * 20_000) + " = 1}", "more than 32 parts"),
        ("a = 1\na = 2", "This is not TOML"),
        ("# " + "x" * 2_000_000, "Allowed: 1,048,576"),
    ],
    ids=lambda text: text[:12],
)
def test_a_lying_toml_text_is_refused(text, why):
    with pytest.raises(DocumentError, match=why) as refused:
        read_toml(text)
    assert not INTERNALS.search(str(refused.value))


def test_a_file_without_end_is_not_read_to_its_end():
    zeros = Path("/dev/zero")
    if not zeros.exists():
        pytest.skip("no such device")
    with pytest.raises(DocumentError, match="zero is larger than 1 MiB"):
        document_text(zeros, Bounds(most_bytes=1 << 20))


@pytest.mark.parametrize("name", sorted(models.FORMULAS))
def test_a_lying_formula_is_refused(name):
    with pytest.raises(ExpressionError) as refused:
        Expression(models.FORMULAS[name], ("r",))
    assert not INTERNALS.search(str(refused.value))


@pytest.mark.parametrize(
    ("ending", "make"), QUICK_MATRICES, ids=lambda one: getattr(one, "__name__", one)
)
def test_a_lying_matrix_is_refused(tmp_path, ending, make):
    if ending == ".h5":
        pytest.importorskip("h5py")
    path = tmp_path / f"k{ending}"
    make(path)
    with pytest.raises(MatrixFileError, match=r"k\.") as refused:
        read_matrix(path)
    assert not INTERNALS.search(str(refused.value))


@pytest.mark.parametrize(
    ("ending", "name"),
    [(".inp", name) for name in models.ABAQUS] + [(".bdf", name) for name in models.NASTRAN],
)
def test_a_lying_mesh_is_refused_or_of_no_use(tmp_path, ending, name):
    path = tmp_path / f"m{ending}"
    path.write_text((models.ABAQUS if ending == ".inp" else models.NASTRAN)[name])
    if name in models.HARMLESS:
        assert convert_mesh(path).file.frame is not None
        return
    with pytest.raises(MatrixFileError) as refused:
        convert_mesh(path)
    assert not INTERNALS.search(str(refused.value))
    assert "root:" not in str(refused.value), "another file was read"


@pytest.mark.parametrize(
    "make",
    [
        records.hdf5_with_external_storage, records.hdf5_with_an_external_link,
        records.hdf5_with_a_virtual_dataset,
    ],
)  # fmt: skip
def test_an_hdf5_file_does_not_make_us_read_another_file(tmp_path, make):
    h5py = pytest.importorskip("h5py")
    from slowtime_services.files.binary.hdf5_objects import own_datasets

    path = tmp_path / "f.h5"
    make(path)
    with (
        h5py.File(path) as file,
        pytest.raises(RecordError, match=r"points to another file.*(secret\.bin|other\.h5)"),
    ):
        list(own_datasets(path, file))


@pytest.mark.parametrize(
    "make", [records.hdf5_of_groups_within_themselves, records.hdf5_of_links_that_double]
)
def test_a_dataset_with_many_paths_is_met_once(tmp_path, make):
    h5py = pytest.importorskip("h5py")
    from slowtime_services.files.binary.hdf5_objects import own_datasets

    path = tmp_path / "f.h5"
    make(path)
    with h5py.File(path) as file:
        assert [item.shape for item in own_datasets(path, file)] == [(records.ROWS, 2)]


def test_a_file_may_unpack_to_fifty_times_its_size_and_any_file_to_some_mebibytes(tmp_path):
    path = tmp_path / "f.bin"
    path.write_bytes(bytes(1 << 20))
    refuse_expansion(path, MOST_TIMES << 20)
    with pytest.raises(RecordError, match="more than 50 times as much"):
        refuse_expansion(path, (MOST_TIMES << 20) + 1)
    path.write_bytes(b"x")
    refuse_expansion(path, FREE_BYTES)
