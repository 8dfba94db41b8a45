"""The command `slowtime`: finds the verb, runs it, reports errors in a sentence."""

import logging
import os
import sys
from collections.abc import Sequence
from typing import Any

import click

from slowtime_services.logs import Format, formatter
from slowtime_services.reasons import reason_of, without_internals

from .shared.examples import FIRST_EXAMPLE, with_example
from .shared.input_errors import is_validation_error, validation_message
from .shared.verb_groups import VerbGroup
from .verbs.suggestions import suggestions
from .verbs.tree import GROUPS, OLD_NAMES, VERBS, paths

OLD_NAMES_END = "0.4"
"""Release from which the names of before 0.2 are no longer understood."""

ROOMS = (
    "edge_agent", "slowtime", "slowtime_cli", "slowtime_schemas", "slowtime_services",
    "twin_server",
)  # fmt: skip


class Verbs(VerbGroup):
    """All commands; old names are understood, with a warning."""

    verbs = VERBS

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command, also by its old name."""
        group, *rest = OLD_NAMES.get(cmd_name, (cmd_name,))
        command = super().get_command(ctx, group)
        if rest and isinstance(command, click.Group):
            return command.get_command(ctx, rest[0])
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or name commands that the word may mean."""
        word = args[0]
        if word in OLD_NAMES:
            new = OLD_NAMES[word]
            if not ctx.resilient_parsing:
                _warn_of_old_name(word, new)
            return super().resolve_command(ctx, [*new, *args[1:]])
        if word in VERBS or word.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        known = {words.split()[-1]: words for words, _ in paths()} | {one: one for one in VERBS}
        meant = " or ".join(
            f"`slowtime {known.get(one, one)}`" for one in suggestions(word, known)
        )
        ctx.fail(
            f"No such command {word!r}. "
            + (f"Did you mean {meant}?" if meant else "`slowtime --help` lists the commands.")
        )

    def rows(self, ctx: click.Context, *, whole: bool) -> list[tuple[str, list[Any]]]:
        """Return the commands by groups; with all of them also those within groups."""
        if not whole:
            return self.command_rows(ctx)
        every = [(words, verb.help) for words, verb in paths()]
        options = (one.get_help_record(ctx) for one in self.get_params(ctx))
        return [("Options", [one for one in options if one]), ("Commands", every)]

    def command_rows(self, ctx: click.Context) -> list[tuple[str, list[tuple[str, str]]]]:
        """List the commands by groups without importing them."""
        width = max(map(len, VERBS))
        return [
            (heading, [(verb.ljust(width), VERBS[verb].help) for verb in verbs])
            for heading, verbs in GROUPS.items()
        ]


def _warn_of_old_name(old: str, new: tuple[str, ...]) -> None:
    click.echo(
        f"`slowtime {old}` is now `slowtime {' '.join(new)}`; the old name ends with release "
        f"{OLD_NAMES_END}.",
        err=True,
    )


@click.group(
    cls=Verbs,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 96},
    epilog=with_example(
        """\b
Examples:
  slowtime demo                                    all parts on this computer, with a page
  slowtime identify record.csv --rate-hz 200       natural frequency and damping of a record
  slowtime router & slowtime twin &                the parts of the demo,
  slowtime edge --simulate tower                   one by one
""",
        FIRST_EXAMPLE,
    ),
)
@click.version_option(None, "-V", "--version", package_name="slowtime", prog_name="slowtime")
@click.option("-v", "--verbose", count=True, help="Log more; twice: also from libraries.")
@click.option("-q", "--quiet", is_flag=True, help="Log errors only.")
@click.option(
    "--log-format",
    type=click.Choice(["text", "json"]),
    default="text",
    envvar="SLOWTIME_LOG_FORMAT",
    help="Log format: text for people, or one JSON object per line.",
)
def app(verbose: int, quiet: bool, log_format: Format) -> None:
    """Digital twin for vibrating structures.

    `identify` finds natural frequencies and damping in a record, `diagnose` finds physical
    effects that a model lacks, and `demo` runs everything on this computer, with a page.
    Each command has its own help and examples: slowtime COMMAND --help.
    """
    level = logging.DEBUG if verbose > 1 else logging.INFO
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter(log_format))
    logging.basicConfig(level=logging.ERROR if quiet else level, handlers=[handler])
    for room in ROOMS if verbose and not quiet else ():
        logging.getLogger(room).setLevel(logging.DEBUG)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit status.

    0 is success, 2 that the input is wrong (a sentence on stderr), 1 a failure of ours or an
    output that nobody reads any more, 130 that Ctrl-C ended a job before its end; what runs
    until Ctrl-C ends with 0.
    """
    try:
        status = _status_of(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:  # as by `| head`; of what a verb writes, click makes an exit
        status = 1
        for stream in (sys.stdout, sys.stderr):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(status)


def _status_of(arguments: Sequence[str] | None) -> int:
    try:
        status = app.main(arguments, prog_name="slowtime", standalone_mode=False)
    except click.UsageError as error:
        click.UsageError(without_internals(error.format_message()), error.ctx).show()
        return 2
    except click.ClickException as error:
        _say(error.format_message())
        return 2
    except (KeyboardInterrupt, click.Abort):
        _say("Ended by Ctrl-C.")
        return 130
    except BrokenPipeError:
        raise
    except (ValueError, OSError) as error:
        if is_validation_error(error):
            _say(validation_message(error))
            return 2
        if os.environ.get("SLOWTIME_DEBUG"):
            raise
        _say(reason_of(error) if isinstance(error, OSError) else str(error))
        return 2
    except MemoryError as error:
        _say(f"{reason_of(error)} Give a smaller file, or more memory.")
        return 2
    except Exception as error:
        if os.environ.get("SLOWTIME_DEBUG"):
            raise
        _say(
            f"Internal error in slowtime: {type(error).__name__}: {error}. Run again with "
            "SLOWTIME_DEBUG=1 for the traceback, and include it in a bug report."
        )
        return 1
    return status if isinstance(status, int) else 0


def _say(sentence: str) -> None:
    click.echo(f"slowtime: {without_internals(sentence)}", err=True)


if __name__ == "__main__":
    main()
