"""Groups of commands that are imported once they are asked for."""

import dataclasses
import importlib
from collections.abc import Mapping

import click
from click.shell_completion import CompletionItem

from .examples import EXAMPLES, HEADING, with_example
from .help_pages import DocumentedGroup


@dataclasses.dataclass(frozen=True, slots=True)
class Verb:
    """A command, or a group of commands.

    Parameters
    ----------
    place
        ``module:name`` within `slowtime_cli.verbs`; empty for a group that is declared here.
    help
        Its help in one line.
    verbs
        Commands of a group that is declared here.
    default
        Command of the group that runs where options follow the group's name, or nothing.
    examples
        Lines of the help of a group that is declared here.
    """

    place: str
    help: str
    verbs: "Mapping[str, Verb]" = dataclasses.field(default_factory=dict)
    default: str = ""
    examples: tuple[str, ...] = ()


class VerbGroup(DocumentedGroup):
    """Commands by name; each is imported when it is run or explained.

    Parameters
    ----------
    words
        Words that lead to the group, each with a blank behind it; empty at top level.
    verbs
        Its commands.
    default
        Command that runs where options, or nothing, follow the group's name.
    """

    verbs: Mapping[str, Verb]
    words = ""
    default = ""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All commands, in the order of the help."""
        return list(self.verbs)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command's own module, now."""
        verb = self.verbs.get(cmd_name)
        if verb is None:
            return None
        words = f"{self.words}{cmd_name}"
        command = _group(words, verb) if verb.verbs else _imported(cmd_name, verb)
        if HEADING not in (command.epilog or ""):
            command.epilog = with_example(command.epilog, EXAMPLES[words])
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the default command before options of its own."""
        helps = {*self.get_help_option_names(ctx), "--help-all"}
        bare = not args and not ctx.resilient_parsing
        own = bool(args) and args[0].startswith("-") and args[0] not in helps
        return super().parse_args(
            ctx, [self.default, *args] if self.default and (bare or own) else args
        )

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete commands without importing them, and options."""
        found = [
            CompletionItem(name, help=verb.help)
            for name, verb in self.verbs.items()
            if name.startswith(incomplete)
        ]
        found += click.Command.shell_complete(self, ctx, incomplete)
        if self.default and incomplete.startswith("-"):
            default = self.get_command(ctx, self.default)
            assert default is not None
            found += default.shell_complete(click.Context(default, parent=ctx), incomplete)
        return found

    def command_rows(self, ctx: click.Context) -> list[tuple[str, list[tuple[str, str]]]]:
        """List the commands without importing them."""
        return [("Commands", [(name, verb.help) for name, verb in self.verbs.items()])]


def _imported(name: str, verb: Verb) -> click.Command:
    module, attribute = verb.place.split(":")
    command: click.Command = getattr(
        importlib.import_module(f"slowtime_cli.verbs.{module}"), attribute
    )
    command.name = name
    return command


def _group(words: str, verb: Verb) -> VerbGroup:
    text = verb.help
    if verb.default:
        text += (
            f"\n\nWithout a command, `slowtime {words}` takes the options of "
            f"`slowtime {words} {verb.default}`, and runs it."
        )
    epilog = "\n  ".join(("\b\nExamples:", *verb.examples))
    group = VerbGroup(words.split()[-1], help=text, epilog=epilog)
    group.verbs, group.words, group.default = verb.verbs, f"{words} ", verb.default
    return group
