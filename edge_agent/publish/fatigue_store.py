"""Keeps the newest fatigue message of each boot on disk.

The sums only grow, so that the newest message of a boot holds all that earlier ones said: a
twin that takes the newest of each boot counts each cycle once, however often it is told.
"""

import contextlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path

logger = logging.getLogger(__name__)

SUFFIX = ".fatigue"
MOST_BOOTS = 256
"""Boots whose sums are kept; beyond, the oldest go."""


class FatigueStore:
    """Messages of all boots in a folder."""

    def __init__(self, folder: Path, boot: str) -> None:
        self._folder, self._boot = folder, boot
        self._turn = 0

    def put(self, payload: bytes) -> None:
        """Keep the newest of this boot, whole on the disk before it is named."""
        path = self._folder / f"{self._boot}{SUFFIX}"
        partial = path.with_suffix(".partial")
        try:
            with partial.open("wb") as file:
                file.write(payload)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
            for old in self._paths()[:-MOST_BOOTS]:
                old.unlink(missing_ok=True)
        except OSError:
            # Without a disk the structure is still worth listening to.
            logger.exception("Fatigue of this boot is sent but could not be stored.")

    def all(self) -> Iterator[bytes]:
        """Read the stored messages of all boots; files that cannot be read are left out."""
        for path in self._paths():
            kept = _read(path)
            if kept is not None:
                yield kept

    def turn(self) -> bytes | None:
        """Read the stored messages of one boot at a time, to publish each again in turn.

        Files that cannot be read are passed over; None where there is no other.
        """
        paths = self._paths()
        for _ in paths:
            self._turn = (self._turn + 1) % len(paths)
            kept = _read(paths[self._turn])
            if kept is not None:
                return kept
        return None

    def _paths(self) -> list[Path]:
        # Names of boots sort by their beginning, unless a user gives them.
        found = []
        for path in self._folder.glob(f"*{SUFFIX}"):
            with contextlib.suppress(OSError):  # removed meanwhile
                found.append((path.stat().st_mtime_ns, path.name, path))
        return [path for *_, path in sorted(found)]


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError as error:
        logger.warning("The fatigue message %s cannot be read: %s", path, error)
        return None
