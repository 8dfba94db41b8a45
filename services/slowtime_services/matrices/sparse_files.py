"""Readers and writers of one sparse matrix, in the formats that programs exchange."""

import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy import sparse

from slowtime_services.files.binary.expansion import refuse_expansion, unpacked_bound
from slowtime_services.files.binary.hdf5_objects import own_datasets, stored_bytes
from slowtime_services.files.binary.mat_expansion import refuse_mat_expansion
from slowtime_services.files.record import RecordError
from slowtime_services.reasons import reason_of

from .bounds import (
    MOST_EMPTY_ROWS,
    MOST_EMPTY_ROWS_ALONE,
    refuse_empty_rows,
    refuse_packed_text,
)
from .coordinate_text import is_coordinate_text, read_coordinate_text, read_dense_text
from .errors import MatrixFileError
from .nastran_bulk import BULK, read_dmig
from .nastran_output4 import OUTPUT4, read_output4
from .nastran_output4_writing import write_output4

HARWELL = (".rb", ".rua", ".rsa", ".hb", ".psa", ".pua")
NUMERIC_CLASSES = (
    "sparse", "double", "single", "logical", "int8", "int16", "int32", "int64", "uint8",
    "uint16", "uint32", "uint64",
)  # fmt: skip
"""Classes of MATLAB that matrices have; cells and structs may be nested without end."""
HDF5 = (".h5", ".hdf5", ".hdf")
MATRIX_MARKET = (".mtx", ".mm")
TEXT = (".sti", ".mas", ".dam", ".txt", ".coo", ".mtx")
DENSE_TEXT = ".out"
FORMATS = (
    "Matrix Market (.mtx), SciPy (.npz), MATLAB (.mat), HDF5 (.h5), Harwell-Boeing (.rb, .hb), "
    "CalculiX (.sti, .mas), Abaqus (.mtx), Nastran DMIG (.bdf, .dat, .pch) and OUTPUT4 (.op4), "
    "OpenSees (.out)"
)
MOST_BYTES = 4 << 30
"""Largest file [bytes]: a matrix of 1e6 degrees of freedom of solids has about 1e8 entries."""


def read_matrix(
    path: Path, name: str | None = None, *, square: bool = True
) -> sparse.csr_array:
    """Read one matrix.

    Parameters
    ----------
    path
        File, of a format that its ending says.
    name
        Of the variable, group or matrix in it; needed where the file has several.
    square
        Whether it has to be square; one triangle of it is mirrored then.

    Returns
    -------
    The matrix. Where only one triangle is in the file, the other one is added.

    Raises
    ------
    MatrixFileError
        Where it is none of these formats, damaged, or the name does not exist.
    """
    if not path.is_file():
        raise MatrixFileError(f"There is no file {path}. Check the path in the model file.")
    if path.stat().st_size > MOST_BYTES:
        raise MatrixFileError(f"{path.name} is larger than {MOST_BYTES >> 30} GiB.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of readers, on numbers that are refused below
            found = _read(path, name)
    except MatrixFileError:
        raise
    except RecordError as error:
        raise MatrixFileError(str(error)) from error
    except Exception as error:  # readers raise whatever a damaged file makes them meet
        raise MatrixFileError(
            f"{path.name} cannot be read: {reason_of(error)} Export it again; formats are "
            f"{FORMATS}."
        ) from error
    found = found if square or sparse.issparse(found) else np.atleast_2d(found)
    if found.ndim != 2 or (square and found.shape[0] != found.shape[1]):
        raise MatrixFileError(
            f"{path.name} holds a matrix of shape {found.shape}. Give a square matrix."
        )
    if found.dtype.kind == "c":
        raise MatrixFileError(
            f"{path.name} holds complex numbers. Give real stiffness, mass or damping."
        )
    if not isinstance(found, np.ndarray):
        most = MOST_EMPTY_ROWS if square else MOST_EMPTY_ROWS_ALONE
        refuse_empty_rows(path.name, found.shape, found.nnz, most=most)
    whole = sparse.csr_array(found, dtype=np.float64)
    return mirrored(whole) if square else whole


def mirrored(matrix: sparse.csr_array) -> sparse.csr_array:
    """Matrix with both triangles, from one or both.

    Parameters
    ----------
    matrix
        The matrix as it was in the file.

    Returns
    -------
    The whole matrix.
    """
    lower, upper = sparse.tril(matrix, -1), sparse.triu(matrix, 1)
    if (lower.nnz > 0) == (upper.nnz > 0):
        return matrix
    return sparse.csr_array(matrix + (lower if lower.nnz else upper).T)


def _read(path: Path, name: str | None) -> Any:
    suffix = path.suffix.lower()
    if suffix == ".gz":
        refuse_packed_text(path)
        suffix = Path(path.stem).suffix.lower()
    if suffix in MATRIX_MARKET and not is_coordinate_text(path):
        return _from_matrix_market(path)
    if suffix == DENSE_TEXT:
        return read_dense_text(path)
    if suffix in TEXT:
        return read_coordinate_text(path)
    if suffix == ".npz":
        with zipfile.ZipFile(path) as archive:
            refuse_expansion(path, sum(member.file_size for member in archive.infolist()))
        return sparse.load_npz(path)
    if suffix == ".mat":
        return _from_matlab(path, name)
    if suffix in HDF5:
        return _from_hdf5(path, name)
    if suffix in HARWELL:
        return scipy.io.hb_read(path, spmatrix=False)
    if suffix in BULK:
        return read_dmig(path, name)[0]
    if suffix in OUTPUT4:
        return read_output4(path, name)
    raise MatrixFileError(
        f"{path.name} ends in {suffix or 'nothing'}, which names no format of matrices. "
        f"Formats are {FORMATS}."
    )


def _from_matrix_market(path: Path) -> Any:
    """Read a file whose heading agrees with its size."""
    rows, columns, entries, form, *_ = scipy.io.mminfo(path)
    size = path.stat().st_size
    # An entry takes at least `1 1` and an end of line, or a digit and an end of line.
    shortest = 4 if form == "coordinate" else 2
    if shortest * entries > unpacked_bound(size):
        raise MatrixFileError(
            f"{path.name} states {entries:,} entries and has {size:,} bytes: it is damaged or "
            "was made to fill memory. Export it again."
        )
    if form == "coordinate":
        refuse_empty_rows(path.name, (rows, columns), entries)
    return scipy.io.mmread(path)


def _from_matlab(path: Path, name: str | None) -> Any:
    with path.open("rb") as file:
        if b"MATLAB 7.3" in file.read(128):
            return _from_hdf5(path, name)
    refuse_mat_expansion(path)
    kinds = {found: kind for found, _, kind in scipy.io.whosmat(path)}
    chosen = _chosen(path, list(kinds), name)
    if kinds[chosen] not in NUMERIC_CLASSES:
        raise MatrixFileError(
            f"{chosen!r} of {path.name} is of class {kinds[chosen]}. Allowed: sparse or full "
            "matrices of numbers."
        )
    return scipy.io.loadmat(path, variable_names=[chosen], spmatrix=False)[chosen]


def _from_hdf5(path: Path, name: str | None) -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MatrixFileError(
            f"{path.name} is an HDF5 file. Install what reads it: pip install 'slowtime[hdf5]'."
        ) from error
    with h5py.File(path, "r") as file:
        chosen = _chosen(path, [key for key in file if not key.startswith("#")], name)
        own = {item.name: item for item in own_datasets(path, file)}
        inside = [item for key, item in own.items() if key.split("/")[1] == chosen]
        refuse_expansion(path, sum(stored_bytes(item) for item in inside))
        if f"/{chosen}" in own:
            return np.asarray(own[f"/{chosen}"][()])
        found = file[chosen]
        keys = {
            key.rpartition("/")[2]: np.asarray(item[()]).ravel()
            for key, item in own.items()
            if key.rpartition("/")[0] == f"/{chosen}"
        }
        if {"row", "col", "data"} <= set(keys):
            shape = tuple(found.attrs.get("shape", (int(keys["row"].max()) + 1,) * 2))
            places = (keys["row"], keys["col"])
            refuse_empty_rows(path.name, tuple(int(side) for side in shape), len(keys["data"]))
            return sparse.coo_array((keys["data"], places), shape=shape)
        first, starts = ("ir", "jc") if "ir" in keys else ("indices", "indptr")
        if not {"data", first, starts} <= set(keys):
            raise MatrixFileError(
                f"{chosen!r} of {path.name} has the members {', '.join(keys)}. Allowed are "
                "data, indices and indptr; data, row and col; or data, ir and jc."
            )
        size = len(keys[starts]) - 1
        # Rows and columns may be exchanged: the matrices are symmetric.
        return sparse.csr_array(
            (keys["data"], keys[first].astype(int), keys[starts].astype(int)),
            shape=(size, size),
        )


def _chosen(path: Path, names: list[str], name: str | None) -> str:
    if name is None and len(names) == 1:
        return names[0]
    if name not in names:
        asked = "No variable was named" if name is None else f"The variable {name!r} was named"
        raise MatrixFileError(
            f"{asked}, and {path.name} holds {', '.join(names) or 'none'}. Name one, as in "
            f"`{{file: {path.name}, variable: {names[0] if names else 'K'}}}`."
        )
    return name


def write_matrix(path: Path, matrix: sparse.csr_array, name: str = "matrix") -> None:
    """Write one matrix in the format that the ending of the file says.

    Parameters
    ----------
    path
        File that ends in .mtx, .npz, .mat, .h5 or .op4 (binary, sparse).
    name
        Of the variable, group or matrix, in MATLAB, HDF5 and OUTPUT4 files.

    Raises
    ------
    MatrixFileError
        Where the ending is another one.
    """
    suffix = path.suffix.lower()
    if suffix == ".mtx":
        scipy.io.mmwrite(path, sparse.coo_array(matrix), precision=17)
    elif suffix == ".npz":
        sparse.save_npz(path, sparse.csr_matrix(matrix))
    elif suffix == ".mat":
        scipy.io.savemat(path, {name: sparse.csc_matrix(matrix)}, do_compression=True)
    elif suffix in HDF5:
        _to_hdf5(path, matrix, name)
    elif suffix in OUTPUT4:
        write_output4(path, {name: matrix})
    else:
        raise MatrixFileError(
            f"{path.name} ends in {suffix or 'nothing'}. Matrices are written to .mtx, .npz, "
            ".mat, .h5 or .op4."
        )


def _to_hdf5(path: Path, matrix: sparse.csr_array, name: str) -> None:
    import h5py

    with h5py.File(path, "a") as file:
        if name in file:
            del file[name]
        group = file.create_group(name)
        group.attrs["shape"] = matrix.shape
        for key in ("data", "indices", "indptr"):
            group.create_dataset(key, data=getattr(matrix, key), compression="gzip")
