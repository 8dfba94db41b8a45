"""Arguments of the verb `completion`."""

import click

from slowtime_cli.shared.deferred import Deferred


@click.command(
    cls=Deferred,
    work="operation.completion:completion",
    epilog="""\b
Examples:
  slowtime completion bash >> ~/.bashrc
  slowtime completion zsh >> ~/.zshrc
  slowtime completion fish > ~/.config/fish/completions/slowtime.fish

The next shell that starts completes commands, options, choices and file names.
Bash must be of version 4.4 or newer.
""",
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(**_given: object) -> None:
    """Print a script for tab completion in a shell.

    Append what is printed to the shell's startup file once, as the examples show.
    """
