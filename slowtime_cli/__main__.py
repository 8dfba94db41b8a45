"""The command `slowtime`: finds the verb, runs it, reports errors in a sentence."""

import importlib
import logging
import os
import sys
from collections.abc import Sequence
from typing import NamedTuple

import click
from click.shell_completion import CompletionItem

from slowtime_services.logs import Format, formatter
from slowtime_services.reasons import reason_of, without_internals

from .shared.examples import EXAMPLES, FIRST_EXAMPLE, HEADING, with_example
from .shared.input_errors import is_validation_error, validation_message
from .verbs.groups import GROUPS, suggestions


class Verb(NamedTuple):
    """Module of a verb, and its help in one line."""

    place: str
    help: str


# The lines are repeated here so that `--help` answers without importing every verb; a test
# holds them to the verbs' own.
VERBS = {
    "demo": Verb(
        "operation.demo:demo", "Run router, edge agents, twin server and page on this computer."
    ),
    "edge": Verb(
        "operation.edge:edge", "Run an edge agent: samples in, features with uncertainty out."
    ),
    "twin": Verb(
        "operation.twin:twin", "Run the twin server: features in; estimates, REST and page out."
    ),
    "router": Verb(
        "operation.router:router",
        "Run a Zenoh router that edges, twin and recorder connect to.",
    ),
    "keys": Verb(
        "operation.keys:keys",
        "Create, renew and revoke the TLS certificates of a site.",
    ),
    "tokens": Verb(
        "operation.tokens:tokens",
        "Create, list and revoke tokens for REST and the page.",
    ),
    "alarms": Verb(
        "twins.alarms:alarms",
        "Send a test alarm of a twin, and show deliveries of alarms.",
    ),
    "quarantine": Verb(
        "twins.quarantine:quarantine",
        "List, release and drop messages that the server set aside.",
    ),
    "holdings": Verb(
        "twins.holdings:holdings",
        "Show what a server has under way for your sites, and end it.",
    ),
    "event": Verb(
        "twins.event:event", "Record repairs and inspections of an asset, and undo them."
    ),
    "status": Verb(
        "operation.router:status",
        "Show whether the router answers, and which edges are online.",
    ),
    "plugins": Verb(
        "operation.plugins:plugins",
        "List installed plug-ins.",
    ),
    "doctor": Verb(
        "operation.doctor:doctor",
        "Check installation, ports, router, clock and write access.",
    ),
    "completion": Verb(
        "operation.completion:completion",
        "Print a script for tab completion in a shell.",
    ),
    "check": Verb("operation.check:check", "Check a twin's database for damage."),
    "ledger": Verb(
        "operation.ledger:ledger", "Verify that a twin's history was not altered or deleted."
    ),
    "composite": Verb(
        "twins.composite:composite", "Combine twins into sites, lines and structures of parts."
    ),
    "backup": Verb(
        "operation.backup:backup", "Copy a twin's database while the server is running."
    ),
    "restore": Verb("operation.backup:restore", "Restore a twin's database from a backup."),
    "export": Verb(
        "twins.export:export", "Export the history of a twin, or the samples of a record."
    ),
    "record": Verb(
        "operation.record:record", "Record the messages of the bus into an MCAP file."
    ),
    "replay": Verb(
        "operation.replay:replay", "Replay a recording and print the hash of its history."
    ),
    "recover": Verb(
        "records.recover:recover",
        "Repair a truncated or damaged recording.",
    ),
    "layout": Verb(
        "records.layout:layout", "Write a layout for Foxglove or Lichtblick to fit a recording."
    ),
    "import": Verb(
        "records.import_record:import_",
        "Turn a record into an MCAP recording.",
    ),
    "identify": Verb(
        "records.identify:identify",
        "Identify natural frequencies and damping, with uncertainty.",
    ),
    "simulate": Verb(
        "records.simulate:simulate",
        "Write the vibration of an ageing structure or of a model file.",
    ),
    "publish": Verb(
        "operation.publish:publish",
        "Simulate an acceleration sensor and publish its samples.",
    ),
    "diagnose": Verb(
        "models.diagnose:diagnose",
        "Find effects that a model lacks, with their place and size.",
    ),
    "fmu": Verb(
        "models.fmu:fmu",
        "Export a model as an FMU for other simulation programs.",
    ),
    "effects": Verb(
        "models.effects:effects",
        "List the physical effects that slowtime knows.",
    ),
    "distortion": Verb(
        "records.distortion:distortion",
        "Measure nonlinear distortion, or damping against amplitude.",
    ),
    "merge": Verb(
        "records.merge:merge",
        "Merge modes measured with several sensor set-ups.",
    ),
    "scale": Verb(
        "records.scale:scale",
        "Scale operational mode shapes by known added masses.",
    ),
    "orders": Verb(
        "records.orders:orders",
        "Track the orders of a rotating machine, with a tacho signal.",
    ),
    "track": Verb(
        "records.track:track", "Track the constants of a nonlinear structure over slow time."
    ),
    "separate": Verb(
        "twins.separate:separate",
        "Separate a history into a drift and a recurring part.",
    ),
    "evolve": Verb(
        "twins.evolve:evolve", "Estimate changes of stiffness and mass from frequencies."
    ),
    "forecast": Verb(
        "twins.forecast:forecast",
        "Forecast the changes of a twin, and when they reach thresholds.",
    ),
    "plan": Verb(
        "twins.plan:plan",
        "Recommend an action for a twin: repair, inspect, wait or close.",
    ),
    "whatif": Verb(
        "twins.whatif:whatif", "Simulate a twin's current structure under a load, with bands."
    ),
    "risk": Verb(
        "twins.risk:risk", "Compute a twin's probability of failure for each limit state."
    ),
    "reliability": Verb(
        "models.reliability:reliability", "Compute a probability of failure by several methods."
    ),
    "surrogate": Verb(
        "models.surrogate:surrogate", "Fit a fast surrogate to runs of a slow model."
    ),
    "design": Verb(
        "models.design:design", "Choose a damper, mass or stiffness: cheap, robust and safe."
    ),
    "fatigue": Verb(
        "models.fatigue:fatigue",
        "Count stress cycles and sum fatigue damage, with its scatter.",
    ),
    "virtual": Verb(
        "models.virtual:virtual", "Estimate drift, force or stress that nobody measures."
    ),
    "convert": Verb(
        "models.convert:convert", "Convert a mesh of beams, bars and shells to a model file."
    ),
    "reduce": Verb(
        "models.reduce:reduce", "Reduce finite-element matrices to a small model and verify it."
    ),
    "update": Verb(
        "models.update:update", "Update a finite-element model from measured modes."
    ),
    "place": Verb(
        "models.place:place", "Choose the sensor positions that are most informative."
    ),
}
ROOMS = (
    "edge_agent", "slowtime", "slowtime_cli", "slowtime_schemas", "slowtime_services",
    "twin_server",
)  # fmt: skip


class Verbs(click.Group):
    """Loads a verb only when it is asked for, so that `--help` answers at once."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All verbs, in the order of the groups of the help."""
        return [verb for verbs in GROUPS.values() for verb in verbs]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the verb's own module, now."""
        if cmd_name not in VERBS:
            return None
        module, name = VERBS[cmd_name].place.split(":")
        command: click.Command = getattr(
            importlib.import_module(f"slowtime_cli.verbs.{module}"), name
        )
        if HEADING not in (command.epilog or ""):
            command.epilog = with_example(command.epilog, EXAMPLES[cmd_name])
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb, or name verbs that the word may mean."""
        word = args[0]
        if word in VERBS or word.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        meant = " or ".join(f"`slowtime {verb}`" for verb in suggestions(word, VERBS))
        ctx.fail(
            f"No such command {word!r}. "
            + (f"Did you mean {meant}?" if meant else "`slowtime --help` lists the commands.")
        )

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete verbs without importing them, and options of the command itself."""
        verbs = [
            CompletionItem(verb, help=VERBS[verb].help)
            for verb in self.list_commands(ctx)
            if verb.startswith(incomplete)
        ]
        return verbs + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs by groups without importing them."""
        width = max(map(len, VERBS))
        for heading, verbs in GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(verb.ljust(width), VERBS[verb].help) for verb in verbs])


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

    `identify` reads a record and finds natural frequencies and damping. `diagnose` finds
    physical effects that a model lacks. `demo` runs everything on this computer, with a page in
    the browser. Each command has its own help and examples: slowtime COMMAND --help.
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
