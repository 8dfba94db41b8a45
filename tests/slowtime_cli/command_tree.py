"""The commands of `slowtime` as click has them."""

from collections.abc import Iterator

import click

from slowtime_cli.__main__ import app


def commands(
    command: click.Command = app,
    words: tuple[str, ...] = (),
    above: click.Context | None = None,
) -> Iterator[tuple[str, click.Command, click.Context]]:
    """Yield words, command and context of each command and group; the empty words first."""
    context = click.Context(command, parent=above, info_name=(words or ("slowtime",))[-1])
    yield " ".join(words), command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, (*words, name), context)


def leaf_options() -> dict[str, list[click.Option]]:
    """Options of each command that is no group; hidden and rare ones too."""
    return {
        words: [one for one in command.params if isinstance(one, click.Option)]
        for words, command, _ in commands()
        if not isinstance(command, click.Group)
    }
