"""The verb `export`: what a twin knows, as files of other tools."""

from pathlib import Path

import click

from slowtime_cli.deferred import Deferred
from slowtime_cli.options import Name, OutFile

from .flags import EXISTING


@click.command(
    cls=Deferred,
    work="exporting:export",
    extra="twin",
    epilog="""\b
Examples:
  slowtime export twin.sqlite --asset demo.tower --out tower.csv
  slowtime export twin.sqlite --asset demo.tower --start slow:100 --out tower.parquet
  slowtime export --server http://127.0.0.1:8000 --site demo --out demo.json

.csv and .parquet hold the history of one twin, a row a state; .json holds a site, its twins and
their relations as a graph with models in DTDL version 3, which twin platforms load.
""",
)
@click.argument("database", required=False, type=EXISTING)
@click.option(
    "--server",
    metavar="URL",
    help="Ask a running server instead, with the token in SLOWTIME_TOKEN, where it wants one.",
)
@click.option("--asset", type=Name(parts=2), help="SITE.ASSET; needed where there are several.")
@click.option("--site", type=Name(), help="Of .json: this site alone.  [default: all]")
@click.option("--start", metavar="MOMENT", help="First state: RFC 3339 or slow:NUMBER.")
@click.option("--end", metavar="MOMENT", help="Last state: RFC 3339 or slow:NUMBER.")
@click.option(
    "--out",
    required=True,
    type=OutFile(".csv", ".parquet", ".json"),
    help="File to write; its ending says what.",
)
def export(
    database: Path | None,
    server: str | None,
    start: str | None,
    end: str | None,
    out: Path,
    **_given: object,
) -> None:
    """Write what a twin knows as CSV, Parquet or DTDL.

    A server may go on writing the database meanwhile.
    """
    if (database is None) == (server is None):
        raise click.UsageError("Give a twin's database, or --server; not both.")
    if out.suffix == ".json" and (start or end):
        raise click.UsageError(
            "--start and --end go with .csv and .parquet; a graph is of now."
        )
