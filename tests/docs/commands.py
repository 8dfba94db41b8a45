"""Commands that pages tell to type, held against the command itself."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import click

from slowtime_cli.__main__ import app
from slowtime_cli.verbs.tree import OLD_NAMES

FILE = re.compile(r"(?:\w+=)?([\w/-]+\.\w+(@[\d.:]*)?)")


def parse(arguments: Sequence[str], folder: Path) -> None:
    """Parse what follows `slowtime`, in a folder in which all files and folders named exist."""
    for before, word in itertools.pairwise(arguments):
        if before in ("--credentials", "--batch"):
            (folder / word).mkdir(exist_ok=True, parents=True)
    for word in arguments:
        if named := FILE.fullmatch(word):
            path = folder / named[1].partition("@")[0]
            path.parent.mkdir(exist_ok=True, parents=True)
            path.touch()
    if arguments[0] == "tokens":
        (folder / "tokens.json").touch()
    assert arguments[0] not in OLD_NAMES, f"slowtime {arguments[0]} is an old name"
    command, context = leaf(arguments)
    command.make_context(context.info_name, list(context.args), parent=context).close()


def leaf(arguments: Sequence[str]) -> tuple[click.Command, click.Context]:
    """Return the command that arguments lead to, and a context with those left for it."""
    command: click.Command = app
    context = click.Context(app, info_name="slowtime")
    left = list(arguments)
    while isinstance(command, click.Group):
        inner = command.make_context(context.info_name, left, parent=context)
        name, found, left = command.resolve_command(
            inner, [*inner._protected_args, *inner.args]
        )
        assert found is not None
        command = found
        context = click.Context(found, parent=inner, info_name=name)
    context.args = left
    return command, context
