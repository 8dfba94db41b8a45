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

The next shell that starts completes verbs, options, choices and names of files with the Tab
key. Bash must be of version 4.4 or newer.
""",
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(**_given: object) -> None:
    """Print the script that completes verbs and options in a shell.

    Append it to the shell's start file, as the examples show.
    """
