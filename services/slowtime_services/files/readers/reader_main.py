"""The process that runs one reader and writes what it finds to a NumPy archive."""

import importlib
import logging
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from slowtime_services.files.binary.numpy_arrays import refuse_above, unreadable
from slowtime_services.files.binary.reader_process import REFUSED, bound_resources, save
from slowtime_services.files.record import RecordError
from slowtime_services.plugins.discovery import find
from slowtime_services.reasons import reason_of

from . import OWN
from .found import Found

YEAR_NS = 31_557_600 * 10**9
LATEST_NS = 2**63 - 1
"""The latest time that nanoseconds since 1970 in 64 bits hold, in the year 2262."""


def main(path: str, max_bytes: str, out: str, module: str, kind: str) -> int:
    """Read a file by `module` and write the result to `out`, or the reason for failure."""
    logging.disable()  # what a library would log of a damaged file is said once, below
    warnings.simplefilter("ignore")  # of libraries, on what they would like changed in others
    try:
        found = _read(module, Path(path), int(max_bytes), kind)
    except RecordError as error:
        sys.stderr.write(f"{error}\n")
        return REFUSED
    save(out, *found.to_json())
    return 0


def _function(module: str) -> Callable[[Path, int], Any]:
    """Take a reader's function: of a module of this room, or of an installed part."""
    if module.startswith(OWN):
        read: Callable[[Path, int], Any] = find("slowtime.readers", module[len(OWN) :]).load()
    else:
        read = importlib.import_module(f"{__package__}.{module}").read
    return read


def _read(module: str, path: Path, max_bytes: int, kind: str) -> Found:
    try:
        read = _function(module)
        bound_resources(path, max_bytes)
        found = read(path, max_bytes)
        if not isinstance(found, Found):
            # No TypeError: of those, users are told no words of the code.
            raise ValueError(f"it gave a {type(found).__name__}, not what a file holds (Found)")
    except RecordError:
        raise
    except (MemoryError, RecursionError) as error:
        raise unreadable(path, error) from error
    except Exception as error:  # libraries say in many ways that a file is torn
        reason = reason_of(error).rstrip(".")
        raise RecordError(
            f"{path.name} is {kind} by its first bytes or its name, but cannot be read: "
            f"{reason}. It may be cut short or damaged."
        ) from error
    for one in found.series:
        if one.start_ns is not None and abs(one.start_ns) > LATEST_NS:
            raise RecordError(
                f"{path.name} is {kind} whose {one.name} begins {one.start_ns / YEAR_NS:+.0f} "
                "years from 1970. Allowed: up to 292. It may be damaged: correct its start."
            )
    refuse_above(path, sum(one.values.nbytes for one in found.series), max_bytes)
    return found


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
