"""The position of an output in the history of each twin, kept in a file."""

import json
import os
from pathlib import Path
from typing import NamedTuple

from slowtime_services.documents.bounds import DocumentError
from slowtime_services.documents.json_documents import read_json


class Position(NamedTuple):
    """The last state and the last event that a receiver has acknowledged.

    Parameters
    ----------
    state
        ``BOOT:SEQUENCE``; ``:0`` before the first one.
    event
        Number of the event; 0 before the first one.
    """

    state: str = ":0"
    event: int = 0


class WrongPositionsError(ValueError):
    """A file of positions that cannot be read."""


class Positions:
    """Positions of one output, by twin; each change is on the disk before it counts.

    Raises
    ------
    WrongPositionsError
        Where the file is damaged. Beginning anew would send a whole history again.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[str, Position] = {}
        try:
            told = read_json(path.read_bytes())
            self._found = {twin: Position(str(s), int(e)) for twin, (s, e) in told.items()}
        except FileNotFoundError:
            pass
        except (DocumentError, ValueError, TypeError, AttributeError) as error:
            raise WrongPositionsError(
                f"{path} does not hold the positions of an output. Restore it, or delete it to "
                "send from the beginning again."
            ) from error

    def of(self, twin_id: str) -> Position | None:
        """Return the position in a twin's history; None before anything was sent."""
        return self._found.get(twin_id)

    def move(self, twin_id: str, position: Position) -> None:
        """Keep a new position."""
        if self._found.get(twin_id) == position:
            return
        self._found[twin_id] = position
        self._path.parent.mkdir(parents=True, exist_ok=True)
        part = self._path.with_suffix(".part")
        with part.open("wb") as file:
            file.write(json.dumps(self._found).encode())
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._path)
