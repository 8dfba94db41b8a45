"""Commands that pages tell to type, held against the command itself."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import click

from slowtime_cli.__main__ import app

FILE = re.compile(r"[\w/-]+\.\w+(@[\d.:]*)?")


def parse(arguments: Sequence[str], folder: Path) -> None:
    """Parse what follows `slowtime`, in a folder in which all files and folders named exist."""
    for before, word in itertools.pairwise(arguments):
        if before == "--credentials":
            (folder / word).mkdir(exist_ok=True, parents=True)
    for word in arguments:
        if FILE.fullmatch(word):
            path = folder / word.partition("@")[0]
            path.parent.mkdir(exist_ok=True, parents=True)
            path.touch()
    command = app.get_command(click.Context(app), arguments[0])
    assert command is not None
    command.make_context(arguments[0], list(arguments[1:])).close()
