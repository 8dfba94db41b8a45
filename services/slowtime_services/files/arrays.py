"""Named arrays out of NumPy and MATLAB files, with a bound on what they may unpack to."""

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from .record import RecordError, Values

Arrays = Mapping[str, Values]
NPY_MAGIC = b"\x93NUMPY"
PICKLE = b"\x80"


def read_npy(path: Path, max_bytes: int) -> Arrays:
    """One array, called ``data``; a structured one gives an array for each of its fields."""
    with path.open("rb") as file:
        begins = file.read(len(NPY_MAGIC))
    if begins and begins != NPY_MAGIC and begins[:1] != PICKLE:
        raise _unreadable(path, ValueError(f"it begins with {begins!r}, not {NPY_MAGIC!r}"))
    try:
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a torn header makes it raise whatever parsing Python does
        raise _unreadable(path, error) from error
    _refuse_above(path, mapped.nbytes, max_bytes)
    if mapped.dtype.names:
        return {name: np.array(mapped[name]) for name in mapped.dtype.names}
    return {"data": np.array(mapped)}


def read_npz(path: Path, max_bytes: int) -> Arrays:
    """All arrays of the archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            _refuse_above(path, sum(item.file_size for item in archive.infolist()), max_bytes)
        with np.load(path, allow_pickle=False) as archive:
            members = {name: archive[name] for name in archive.files}
    except RecordError:
        raise
    except Exception as error:  # whatever unpacking and parsing raise
        raise _unreadable(path, error) from error
    # What is no array in the archive comes back as bytes.
    return {name: found for name, found in members.items() if isinstance(found, np.ndarray)}


def read_matlab(path: Path, max_bytes: int) -> Arrays:
    """All numeric variables; those of a struct as ``struct.field``."""
    if h5py.is_hdf5(path):
        return _read_matlab_73(path, max_bytes)
    try:
        sizes = [np.prod(shape, dtype=float) for _, shape, _ in scipy.io.whosmat(path)]
        _refuse_above(path, int(8 * sum(sizes)), max_bytes)
        variables = scipy.io.loadmat(path, squeeze_me=False, struct_as_record=True)
    except RecordError:
        raise
    except Exception as error:  # the reader raises whatever a torn file makes it meet
        raise _unreadable(path, error) from error
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
    elif array.dtype.kind in "fiub":
        into[name] = array


def _read_matlab_73(path: Path, max_bytes: int) -> Arrays:
    found: dict[str, Values] = {}
    try:
        with h5py.File(path, "r") as file:
            datasets = list(_datasets(file))
            _refuse_above(
                path, sum(item.size * item.dtype.itemsize for item in datasets), max_bytes
            )
            for item in datasets:
                name = item.name.strip("/").replace("/", ".")
                # MATLAB stores by columns, HDF5 by rows: what is read is transposed.
                found[name] = np.asarray(item[()]).T
    except RecordError:
        raise
    except Exception as error:  # the library says in many ways that a file is torn
        raise _unreadable(path, error) from error
    return found


def _datasets(group: Any) -> Iterable[Any]:
    for name, item in group.items():
        if item is None or name.startswith("#") or "MATLAB_empty" in item.attrs:
            continue  # None is a link that leads nowhere
        if isinstance(item, h5py.Group):
            yield from _datasets(item)
        elif item.attrs.get("MATLAB_class") != b"char" and item.dtype.kind in "fiub":
            yield item


def _refuse_above(path: Path, size: int, max_bytes: int) -> None:
    if size > max_bytes:
        raise RecordError(
            f"{path.name} holds {size / 2**20:.0f} MiB; at most {max_bytes / 2**20:.0f} MiB "
            "are read at once. Cut it into several files, or raise max_bytes."
        )


def _unreadable(path: Path, error: Exception) -> RecordError:
    reason = str(error)
    if "ickle" in reason or "Python objects" in reason:
        return RecordError(
            f"{path.name} holds Python objects (a pickle), which can run code when opened and "
            "are never read. Save plain numeric arrays instead."
        )
    return RecordError(
        f"{path.name} cannot be read as {path.suffix}: {reason or type(error).__name__}. It "
        "may be cut short, or be another kind of file than its name says."
    )
