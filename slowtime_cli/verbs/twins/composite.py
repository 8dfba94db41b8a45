"""Arguments and help of the verb `composite`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING
from slowtime_cli.shared.help_pages import DocumentedGroup
from slowtime_cli.shared.options import POSITIVE, Name, OutFile, server_option
from slowtime_cli.shared.outputs import out_option


def _form_of(ctx: click.Context, _param: click.Parameter, out: Path) -> Path:
    """Hand on the form of a graph, which the ending of its file says."""
    ctx.params["form"] = "json-ld" if out.suffix.lower() == ".jsonld" else "dtdl-3"
    return out


@click.group(
    cls=DocumentedGroup,
    epilog="""\b
Examples:
  slowtime twin composite add yard.yaml --id demo.yard
  slowtime twin composite list
  slowtime twin composite show demo.yard --horizon 365
  slowtime twin composite export --site demo --out demo.json
  slowtime twin composite import building.json --site demo --dry-run

A composite names twins or other composites as its members, and says in a tree of series,
parallel and k-out-of-n gates how their failure makes it fail (docs/composites.md).
""",
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
@out_option("JSON file to write, with all of it.")
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


@composite.command(
    cls=Deferred, fixed={"form": "dtdl-3"}, work="twins.composite:export", extra="analysis"
)
@click.option("--site", type=Name(), help="Only this site.  [default: all]")
@click.option(
    "--out",
    required=True,
    type=OutFile(".json", ".jsonld"),
    callback=_form_of,
    help="File to write: .json with DTDL version 3 models, or .jsonld (JSON-LD) without "
    "models.",
)
@server_option
def export(site: str | None, form: str, out: Path, server: str) -> None:
    """Write twins, composites and their relationships as a graph."""
