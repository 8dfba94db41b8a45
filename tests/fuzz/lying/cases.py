"""A lying file, an honest one of its kind, and the command that reads either."""

import dataclasses
from collections.abc import Callable
from pathlib import Path


@dataclasses.dataclass(frozen=True)
class Case:
    """One lie.

    Parameters
    ----------
    name
        Of the test.
    file
        Name of the file that is read.
    honest, lying
        Write a file to a place, and others beside it if need be.
    command
        Words after ``slowtime``; ``{file}`` is the file.
    harmless
        Whether it may also be read as what it holds: its lie is then of no use.
    """

    name: str
    file: str
    honest: Callable[[Path], None]
    lying: Callable[[Path], None]
    command: tuple[str, ...]
    harmless: bool = False
