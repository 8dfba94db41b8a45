"""The process that reads a MATLAB file into a NumPy archive."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from slowtime_services.files.record import RecordError, Values

from .hdf5_objects import own_datasets, stored_bytes
from .mat_expansion import refuse_mat_expansion
from .numpy_arrays import Arrays, refuse_above, unreadable
from .reader_process import bound_resources, save_arrays

HEADING_BYTES = 512
"""Before an HDF5 file's own first bytes, where MATLAB has written one."""
MOST_DIGITS = 24
"""Characters of a number that is written as a text."""
_COMPLEX = ("real", "imag")
"""Fields of a complex number of MATLAB in HDF5."""
SIGNATURE = b"\x89HDF\r\n\x1a\n"


def _read(path: Path, max_bytes: int) -> Arrays:
    if _is_hdf5(path):
        return _read_version_73(path, max_bytes)
    bound_resources(path, max_bytes)
    try:
        sizes = [np.prod(shape, dtype=float) for _, shape, _ in scipy.io.whosmat(path)]
        refuse_above(path, int(8 * sum(sizes)), max_bytes)
        refuse_mat_expansion(path)
        variables = scipy.io.loadmat(path, squeeze_me=False, struct_as_record=True)
    except RecordError:
        raise
    except Exception as error:  # the reader raises whatever a torn file makes it meet
        raise unreadable(path, error) from error
    found: dict[str, Values] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _flatten(name, value, found)
    return found


def _flatten(name: str, value: Any, into: dict[str, Values]) -> None:
    array = np.asarray(value)
    if array.dtype.names and array.size == 1:
        for field in array.dtype.names:
            _flatten(f"{name}.{field}", array[field].flat[0], into)
    elif array.dtype.kind in "fiubc":
        into[name] = array
    elif array.dtype.kind == "U" and array.size == 1 and len(str(array.flat[0])) <= MOST_DIGITS:
        into[name] = array  # a rate may be written as a text


def _is_hdf5(path: Path) -> bool:
    """Whether a file has the signature of HDF5, behind a heading of MATLAB's or at once."""
    with path.open("rb") as file:
        head = file.read(HEADING_BYTES + len(SIGNATURE))
    return head.startswith(SIGNATURE) or head.endswith(SIGNATURE)


def _read_version_73(path: Path, max_bytes: int) -> Arrays:
    try:
        import h5py
    except ImportError as error:
        raise RecordError(
            f"{path.name} is a MATLAB file of version 7.3, which h5py reads. Install it: "
            "pip install 'slowtime[formats]' or pip install h5py. Or save it with -v7."
        ) from error
    bound_resources(path, max_bytes)
    found: dict[str, Values] = {}
    try:
        with h5py.File(path, "r") as file:
            datasets = [item for item in own_datasets(path, file) if _is_numeric(item)]
            refuse_above(path, sum(stored_bytes(item) for item in datasets), max_bytes)
            for item in datasets:
                name = item.name.strip("/").replace("/", ".")
                # MATLAB stores by columns, HDF5 by rows: what is read is transposed.
                values = np.asarray(item[()]).T
                if values.dtype.names == _COMPLEX:
                    values = values["real"] + 1j * values["imag"]
                found[name] = values
    except RecordError:
        raise
    except Exception as error:  # the library says in many ways that a file is torn
        raise unreadable(path, error) from error
    return found


def _is_numeric(item: Any) -> bool:
    if "MATLAB_empty" in item.attrs or item.attrs.get("MATLAB_class") == b"char":
        return False
    numeric = item.dtype.kind in "fiubc" or item.dtype.names == _COMPLEX
    return numeric and not item.name.startswith("/#")


def main(path: str, max_bytes: str, out: str) -> int:
    """Read the file and write its arrays to `out`, or the reason why not."""
    return save_arrays(_read, path, max_bytes, out)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
