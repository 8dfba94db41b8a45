"""Cuts of an HDF5 file into HDF5 files."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from slowtime_services.files.binary.expansion import refuse_expansion
from slowtime_services.files.binary.hdf5_objects import own_datasets, stored_bytes
from slowtime_services.files.record import RecordError

from .pieces import FEWEST_ROWS, Pieces, edges

SLOWER = 10
"""Times by which a dataset is shorter than the longest that is left out, as where a file is
read whole."""


def cut_hdf5(path: Path, piece_bytes: int, _skip: int | None) -> Pieces:
    """Slices along the time of all datasets that are as long as the longest.

    Raises
    ------
    RecordError
        Where h5py is missing, the file is damaged, or it holds series of several lengths.
    """
    try:
        import h5py
    except ImportError as error:
        raise RecordError(
            f"{path.name} is read by h5py, which is not installed. "
            'Run: pip install "slowtime[hdf5]"'
        ) from error
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise RecordError(f"{path.name} cannot be read as HDF5: {error}") from error
    with file:
        found = [
            item for item in own_datasets(path, file) if item.dtype.kind in "fiub" and item.size
        ]
        refuse_expansion(path, sum(stored_bytes(item) for item in found))
        length = max((max(item.shape) for item in found if item.shape), default=0)
        if length < 2:
            raise RecordError(f"{path.name} holds no dataset of numbers.")
        long = [item for item in found if item.shape and max(item.shape) == length]
        short = [item for item in found if not item.shape or max(item.shape) < length]
        _refuse_several(path, found, length)
        widest = max(item.size // length for item in long)
        row_bytes = sum(item.dtype.itemsize * item.size // length for item in long)
        rows = max(FEWEST_ROWS, 2 * widest, piece_bytes // max(1, row_bytes))
        for first, last in edges(length, rows):

            def write(place: Path, first: int = first, last: int = last) -> None:
                with h5py.File(place, "w") as out:
                    _copy_attributes(file, out)
                    # By them the channels of a piece are named as those of the whole.
                    for item in short:
                        _put(out, item, _slice(item, 0, FEWEST_ROWS // SLOWER))
                    for item in long:
                        _put(out, item, _slice(item, first, last))

            yield write, last / length


def _refuse_several(path: Path, found: list[Any], length: int) -> None:
    other = [
        item
        for item in found
        if item.size > 1 and max(item.shape) != length and SLOWER * max(item.shape) > length
    ]
    if other:
        said = ", ".join(f"{item.name.strip('/')} ({max(item.shape):,})" for item in other[:6])
        raise RecordError(
            f"{path.name} holds series of {length:,} samples and of other lengths: {said}. "
            "Read it whole, and name channels of one length with --channels."
        )


def _slice(item: Any, first: int, last: int) -> Any:
    """Rows of a dataset along its longest side, which is time."""
    if item.size == 1:
        return item[()]
    time = int(np.argmax(item.shape))
    return item[
        tuple(slice(first, last) if n == time else slice(None) for n in range(item.ndim))
    ]


def _put(out: Any, item: Any, values: Any) -> None:
    """Write values under the name of a dataset, with its attributes and those above it."""
    if item.name in out:  # met before, by another link
        return
    made = out.create_dataset(item.name, data=values)
    _copy_attributes(item, made)
    above, its = item.parent, made.parent
    while above.name not in ("/", None) and not its.attrs:
        _copy_attributes(above, its)
        above, its = above.parent, its.parent


def _copy_attributes(item: Any, made: Any) -> None:
    for name in item.attrs:
        # What is no number or text, such as a reference, says nothing of units or rates.
        with contextlib.suppress(TypeError, OSError, ValueError):
            made.attrs[name] = item.attrs[name]
