"""The numbered files of an endless recording, of which the oldest are deleted."""

import re
from pathlib import Path


class RecordingSeries:
    """Files ``name.mcap``, ``name-0001.mcap``, … of one folder, the oldest first.

    Files of earlier runs under the same name belong to it; nothing else in the folder does.
    Numbers only grow, so that their order is that of time also after the oldest were deleted.

    Parameters
    ----------
    path
        The first of them, whether it is still there or not.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pattern = re.compile(
            rf"{re.escape(path.stem)}(?:-(\d{{4,}}))?{re.escape(path.suffix)}"
        )

    def files(self) -> list[Path]:
        """Those that are there now, the oldest first."""
        return [path for _, path in self._numbered()]

    def next(self) -> Path:
        """Name of the next file, behind all that are there."""
        numbered = self._numbered()
        if not numbered:
            return self._path
        return self._path.with_stem(f"{self._path.stem}-{numbered[-1][0] + 1:04d}")

    def size(self) -> int:
        """Bytes of all of them."""
        return sum(_size(path) for path in self.files())

    def shrink_to(self, most: int, but: Path) -> list[tuple[Path, int]]:
        """Delete the oldest until all together are no more than `most`.

        Parameters
        ----------
        most
            Bytes.
        but
            The file that is being written, which stays.

        Returns
        -------
        Those that were deleted, with their sizes.
        """
        deleted = []
        total = self.size()
        for path in self.files():
            if total <= most:
                break
            if path == but:
                continue
            size = _size(path)
            path.unlink(missing_ok=True)
            deleted.append((path, size))
            total -= size
        return deleted

    def _numbered(self) -> list[tuple[int, Path]]:
        found = []
        for path in self._path.parent.iterdir():
            match = self._pattern.fullmatch(path.name)
            if match and path.is_file() and not path.is_symlink():
                found.append((int(match[1] or 0), path))
        return sorted(found)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:  # deleted by somebody else meanwhile
        return 0
