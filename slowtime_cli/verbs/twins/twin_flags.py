"""Arguments that name the twin to be asked."""

from pathlib import Path

import click

from slowtime_cli.shared.flags import EXISTING, F, as_built, refuse_damping_alone, with_options
from slowtime_cli.shared.options import Name
from slowtime_cli.shared.settings import setting

TWIN = (
    click.argument("source", required=False, type=EXISTING),
    click.option(
        "--server",
        metavar="URL",
        help="Use the twin of a running server; its token, if it needs one, in SLOWTIME_TOKEN.",
    ),
    click.option(
        "--asset",
        type=Name(parts=2),
        help="SITE.ASSET of the server, or of a recording that holds several.",
    ),
    click.option(
        "--registration",
        type=EXISTING,
        help="TOML or JSON file, twin id → registration, with model, thresholds and "
        "all other settings; instead of --nominal-hz and the like.",
    ),
)
"""A twin, and what its registration says."""

EVENTS = setting(
    "--events",
    type=EXISTING,
    help="JSON file of repairs and inspections, as `slowtime twin event` records them.",
)

events_option = click.option(
    "--events",
    type=EXISTING,
    help="JSON file of repairs and inspections, as `slowtime twin event` records them.",
)


def twin_flags(function: F) -> F:
    """Add the options that select the twin, and what it is told of its structure."""
    return with_options((*TWIN, as_built), function)


def registered_twin_flags(function: F) -> F:
    """Add the options that select a twin that is registered with a server or in a file."""
    return with_options(TWIN, function)


UNREGISTERED = {
    "changes": "stiffness", "nominal_hz": None, "nominal_damping": None, "learn_epochs": 20
}  # fmt: skip
"""What is said of a twin without a registration, for commands that need one."""


def refuse_incomplete_query(
    source: object,
    server: str | None,
    asset: str | None,
    nominal_hz: float | None,
    nominal_damping: float | None,
    events: Path | None,
    **_given: object,
) -> None:
    """Refuse a question that names neither a file nor a server's twin, or both."""
    refuse_damping_alone(nominal_hz, nominal_damping)
    if source is None and server is None:
        raise click.UsageError("Give SOURCE, or --server URL with --asset SITE.ASSET.")
    if source is not None and server is not None:
        raise click.UsageError("SOURCE and --server exclude each other. Give one of them.")
    if server is not None and events is not None:
        raise click.UsageError(
            "A file of events goes with SOURCE. Record events of a server's twin with "
            "`slowtime twin event add --file`."
        )
    if server is not None and asset is None:
        raise click.UsageError("--server needs --asset SITE.ASSET.")
