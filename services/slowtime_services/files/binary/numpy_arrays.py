"""Named arrays of NumPy files, with a bound on their unpacked size."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from slowtime_services.files.record import RecordError, Values
from slowtime_services.reasons import reason_of

from .expansion import refuse_expansion

Arrays = Mapping[str, Values]
NPY_MAGIC = b"\x93NUMPY"
PICKLE = b"\x80"


def read_npy(path: Path, max_bytes: int) -> Arrays:
    """One array, called ``data``; a structured one gives an array for each of its fields."""
    with path.open("rb") as file:
        begins = file.read(len(NPY_MAGIC))
    if begins and begins != NPY_MAGIC and begins[:1] != PICKLE:
        raise unreadable(path, ValueError(f"it begins with {begins!r}, not {NPY_MAGIC!r}"))
    try:
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a torn header makes it raise whatever parsing Python does
        raise unreadable(path, error) from error
    refuse_above(path, mapped.nbytes, max_bytes)
    if mapped.dtype.names:
        return {name: np.array(mapped[name]) for name in mapped.dtype.names}
    return {"data": np.array(mapped)}


def read_npz(path: Path, max_bytes: int) -> Arrays:
    """All arrays of the archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            refuse_above(path, sum(item.file_size for item in archive.infolist()), max_bytes)
        with np.load(path, allow_pickle=False) as archive:
            members = {name: archive[name] for name in archive.files}
    except RecordError:
        raise
    except Exception as error:  # whatever unpacking and parsing raise
        raise unreadable(path, error) from error
    # What is no array in the archive comes back as bytes.
    return {name: found for name, found in members.items() if isinstance(found, np.ndarray)}


def as_double(values: Values) -> Values:
    """Convert long doubles to doubles; values beyond their range become infinite."""
    if values.dtype.kind != "f" or values.dtype.itemsize <= np.dtype(float).itemsize:
        return values
    with np.errstate(over="ignore"):
        return values.astype(float)


def refuse_above(path: Path, size: int, max_bytes: int) -> None:
    """Refuse arrays that need more memory than allowed, or than the file's size explains."""
    if size > max_bytes:
        raise RecordError(
            f"{path.name} holds {size / 2**20:.0f} MiB; at most {max_bytes / 2**20:.0f} MiB "
            "are read at once. Cut it into several files, or raise max_bytes."
        )
    refuse_expansion(path, size)


def unreadable(path: Path, error: Exception) -> RecordError:
    """Describe a file that cannot be read, and the possible cause."""
    if isinstance(error, MemoryError | RecursionError):
        return RecordError(
            f"{path.name} takes more memory to read than its size explains, or is nested too "
            "deep: it is damaged, or was made to. Save it again, without compression."
        )
    reason = str(error)
    if "ickle" in reason or "Python objects" in reason:
        return RecordError(
            f"{path.name} holds Python objects (a pickle), which can run code when opened and "
            "are never read. Save plain numeric arrays instead."
        )
    reason = reason_of(error).rstrip(".")
    return RecordError(
        f"{path.name} cannot be read as {path.suffix}: {reason}. It "
        "may be cut short, or be another kind of file than its name says."
    )
