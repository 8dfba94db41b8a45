"""The verb `completion`: prints the script by which a shell asks for completions."""

import click
from click.shell_completion import get_completion_class


def completion(shell: str) -> None:
    """Print the completion script of a shell."""
    # Not click's own `source`, which starts bash to ask its version.
    command, kind = click.get_current_context().find_root().command, get_completion_class(shell)
    assert kind is not None
    asking = kind(command, {}, "slowtime", "_SLOWTIME_COMPLETE")
    click.echo(asking.source_template % asking.source_vars())
