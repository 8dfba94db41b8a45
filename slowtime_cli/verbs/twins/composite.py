"""Arguments and help of the verb `composite`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.options import POSITIVE, Name, OutFile, server_option


@click.group(
    epilog="""\b
Examples:
  slowtime composite add yard.yaml --id demo.yard
  slowtime composite list
  slowtime composite show demo.yard --horizon 365
  slowtime composite export --site demo --out demo.json
  slowtime composite import building.json --site demo --dry-run

A composite names twins or other composites as its members, and says in a tree of series,
parallel and k-out-of-n gates how their failure makes it fail (docs/composites.md).
"""
)
def composite() -> None:
    """Combine twins into sites, lines and structures of parts."""


@composite.command(cls=Deferred, work="twins.composite:add", extra="analysis")
@click.argument("file", type=EXISTING)
@click.option("--id", "composite_id", required=True, type=Name(parts=2), help="SITE.NAME.")
@server_option
def add(**_given: object) -> None:
    """Register the composite in FILE; an existing one is replaced.

    FILE is YAML or JSON with `members`, and optionally `tree`, `dependence`, `failing`,
    `horizon`, `alike`, `kind` and `name`.
    """


@composite.command("list", cls=Deferred, work="twins.composite:list_", extra="analysis")
@server_option
def list_(**_given: object) -> None:
    """List all composites with their members and health."""


@composite.command(cls=Deferred, work="twins.composite:show", extra="analysis")
@click.argument("composite_id", type=Name(parts=2))
@click.option("--horizon", type=POSITIVE, help="Horizon, in slow time.")
@click.option("--json", "as_json", is_flag=True, help="Write all of it as JSON.")
@server_option
def show(**_given: object) -> None:
    """Show health, failure probability, importance and pooled rates of a composite."""


@composite.command("import", cls=Deferred, work="twins.composite:import_", extra="twin")
@click.argument("file", type=EXISTING)
@click.option("--site", type=Name(), help="Site of instances whose ids are not SITE.NAME.")
@click.option(
    "--relationship",
    "relationships",
    multiple=True,
    metavar="NAME",
    help="Relationship from a whole to its parts, besides has_member, contains and hasPart.",
)
@click.option("--dry-run", is_flag=True, help="Only print what would be registered.")
@server_option
def import_(**_given: object) -> None:
    """Register the composites that a graph of digital twins describes.

    FILE is what `slowtime export` has written, or a graph of another program: twins and
    relationships of a twin platform (digitalTwinsGraph), or JSON-LD (@graph). Each instance
    that contains registered twins becomes a composite that fails as soon as one member does;
    composites of an own export become what they were.
    """


@composite.command(cls=Deferred, work="twins.composite:export", extra="analysis")
@click.option("--site", type=Name(), help="Only this site.  [default: all]")
@click.option(
    "--as",
    "form",
    type=click.Choice(["dtdl-3", "dtdl-2", "json-ld"]),
    default="dtdl-3",
    show_default=True,
    help="Version of the models, or JSON-LD without models.",
)
@click.option("--out", required=True, type=OutFile(".json", ".jsonld"), help="File to write.")
@server_option
def export(site: str | None, form: str, out: Path, server: str) -> None:
    """Write twins, composites and their relationships as a graph."""
