"""Keeps damaged bytes of a spool in files, and which features were in them."""

import itertools
import logging
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from pathlib import Path

from .spool_records import Damage

logger = logging.getLogger(__name__)

SUFFIX = ".damaged"
MOST_BYTES = 16 * 2**20
"""Of all files of damaged bytes together; beyond, the oldest are deleted."""


class DamagedBytes:
    """Damaged bytes of the segments of one spool.

    The damaged bytes of a segment are copied to ``SEGMENT.OFFSET.damaged`` beside it, for
    whoever wants to look at them; the segment itself is left as it is until the twin has
    acknowledged it.

    Parameters
    ----------
    most_bytes
        Of all copies together.
    """

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        self._found: dict[tuple[Path, int, int], tuple[str, Damage]] = {}
        self._features = 0

    @property
    def features(self) -> int:
        """Number of features found damaged since the spool was opened."""
        return self._features

    def found(self, segment: Path, boot: str, data: bytes, damage: Damage) -> None:
        """Note damage, and copy its bytes aside; known damage is not noted again."""
        # A disk that fails goes on failing: damage that has grown is noted with what is new.
        known = [
            (key, part)
            for key, (_, part) in self._found.items()
            if key[0] == segment and (part.begin == damage.begin or _shared(part, damage))
        ]
        if any(p.first <= damage.first and damage.last <= p.last for _, p in known):
            return
        lost = _shared(damage, damage)
        self._features += lost - sum(_shared(part, damage) for _, part in known)
        for key, part in known:
            del self._found[key]
            damage = damage._replace(
                first=min(part.first, damage.first), last=max(part.last, damage.last)
            )
        self._note(segment, boot, damage)
        logger.error(
            "%s: bytes %d to %d are damaged; features %s of boot %s were in them and are lost. "
            "The bytes are kept in %s. Check the disk.",
            segment.name,
            damage.begin,
            damage.end,
            f"{damage.first} to {damage.last}" if lost else "none",
            boot,
            self._folder,
        )
        self._set_aside(segment, data[damage.begin : damage.end], damage.begin)

    def read_again(self, segment: Path, sequences: Sequence[int]) -> None:
        """Take back that features are damaged, given all that can be read, ascending."""
        for key, (boot, part) in list(self._found.items()):
            read = bisect_left(sequences, part.first), bisect_right(sequences, part.last)
            if key[0] != segment or read[0] == read[1]:
                continue
            # A disk that failed, or a file that was away, may give them after all.
            del self._found[key]
            gaps = (part.first - 1, *sequences[slice(*read)], part.last + 1)
            for before, after in itertools.pairwise(gaps):
                if after - before > 1:
                    self._note(segment, boot, part._replace(first=before + 1, last=after - 1))

    def ranges(self, boot: str) -> list[tuple[int, int]]:
        """First and last of each range of features of `boot` that is damaged, ascending."""
        return sorted(
            (damage.first, damage.last)
            for of_boot, damage in self._found.values()
            if of_boot == boot and damage.last >= damage.first
        )

    def forget(self, segment: Path) -> None:
        """Delete the notes on a segment that was acknowledged or dropped."""
        for key in [key for key in self._found if key[0] == segment]:
            del self._found[key]

    def _note(self, segment: Path, boot: str, damage: Damage) -> None:
        self._found[segment, damage.begin, damage.first] = boot, damage

    def _set_aside(self, segment: Path, damaged: bytes, begin: int) -> None:
        if not damaged:
            return
        path = segment.with_name(f"{segment.name}.{begin:010d}{SUFFIX}")
        try:
            path.write_bytes(damaged[: self._most_bytes])
            self._keep_within_bounds(path)
        except OSError as error:
            logger.warning("%s cannot be written: %s", path, error)

    def _keep_within_bounds(self, newest: Path) -> None:
        files = {path: path.stat() for path in self._folder.glob(f"*{SUFFIX}")}
        size = sum(status.st_size for status in files.values())
        for path in sorted(files, key=lambda path: files[path].st_mtime_ns):
            if size <= self._most_bytes or path == newest:
                return
            path.unlink(missing_ok=True)
            size -= files[path].st_size


def _shared(one: Damage, other: Damage) -> int:
    """Return the number of sequences that were in both."""
    return max(0, min(one.last, other.last) - max(one.first, other.first) + 1)
