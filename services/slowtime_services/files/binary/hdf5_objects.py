"""Datasets that an HDF5 file holds itself: no other file is opened, and none is met twice.

A file may name others: by external links, by external storage of a dataset (whatever file, read
as numbers), and by virtual datasets. Whoever sends such a file would have this machine read the
others. And groups may be linked into each other, so that paths have no end.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slowtime_services.files.record import RecordError

MOST_OBJECTS = 20_000
"""Groups and datasets of a file that are looked at [1]; each takes some 50 µs."""


def own_datasets(path: Path, file: Any) -> Iterator[Any]:
    """Yield the datasets of an open file, each once, in the order of their names.

    Soft links are passed over: what they lead to in this file is met where it is.

    Raises
    ------
    RecordError
        Where the file names other files, or has more objects than files of records have.
    """
    import h5py

    met: set[Any] = set()
    waiting: list[Any] = [file["/"]]
    while waiting:
        group = waiting.pop()
        inner = []
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise _elsewhere(path, f"{name!r} is a link to {link.filename!r}")
            if not isinstance(link, h5py.HardLink):
                continue
            if len(met) > MOST_OBJECTS:
                raise RecordError(
                    f"{path.name} has more than {MOST_OBJECTS:,} groups and datasets. Save the "
                    "series of one record to a file."
                )
            place = h5py.h5o.get_info(group.id, name.encode("utf-8", "surrogateescape")).addr
            if place in met:
                continue
            met.add(place)
            item = group[name]
            if isinstance(item, h5py.Group):
                inner.append(item)
            elif isinstance(item, h5py.Dataset):
                refuse_elsewhere(path, item)
                yield item
        waiting.extend(reversed(inner))


def refuse_elsewhere(path: Path, item: Any) -> None:
    """Refuse a dataset whose numbers are in other files.

    Raises
    ------
    RecordError
        Naming the dataset and one of these files.
    """
    if item.external:
        raise _elsewhere(path, f"the numbers of {item.name} are in {item.external[0][0]!r}")
    if item.is_virtual:
        for source in item.virtual_sources():
            if source.file_name != ".":
                raise _elsewhere(path, f"{item.name} is a view of {source.file_name!r}")


def stored_bytes(item: Any) -> int:
    """Return the size of a dataset, or of one of its chunks where that is larger [bytes]."""
    chunk = 1
    for side in item.chunks or ():
        chunk *= int(side)
    return int(max(item.size, chunk)) * int(item.dtype.itemsize)


def _elsewhere(path: Path, how: str) -> RecordError:
    return RecordError(
        f"{path.name} points to another file, which is not read: {how:.200}. Copy the numbers "
        "into one file: h5repack, or h5py's copy with expand_external."
    )
