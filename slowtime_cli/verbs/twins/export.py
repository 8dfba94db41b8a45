"""Arguments and help of the verb `export`."""

from pathlib import Path

import click

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, reading_settings
from slowtime_cli.shared.options import Name, OutFile
from slowtime_cli.shared.settings import setting, settings_option

ENDINGS = (".csv", ".parquet", ".json", ".jsonld", ".uff", ".unv")


@click.command(
    cls=Deferred,
    work="twins.export:export",
    extra="twin",
    epilog="""\b
Examples:
  slowtime export twin.sqlite --asset demo.tower --out tower.csv
  slowtime export twin.sqlite --asset demo.tower --start slow:100 --out tower.parquet
  slowtime export --server http://127.0.0.1:8000 --site demo --out demo.json
  slowtime export tower.mcap --out tower.uff
  slowtime export record.tdms --reading sensitivity=100mV/g --out record.parquet

Of a record, .csv, .parquet and .uff (UFF 58b) hold its samples. Of a twin, .csv and .parquet
hold the history, a row a state; .json holds a site, its twins and their relations as a graph
with models in DTDL, which twin platforms load, and .jsonld the same graph as JSON-LD.
""",
)
@click.argument("source", required=False, type=EXISTING)
@click.option(
    "--server",
    metavar="URL",
    help="Read a running server instead; its token, if it needs one, in SLOWTIME_TOKEN.",
)
@click.option("--asset", type=Name(parts=2), help="SITE.ASSET; needed where there are several.")
@click.option("--site", type=Name(), help="For .json: only this site.  [default: all]")
@click.option("--start", metavar="MOMENT", help="First state: RFC 3339 or slow:NUMBER.")
@click.option("--end", metavar="MOMENT", help="Last state: RFC 3339 or slow:NUMBER.")
@click.option("--out", required=True, type=OutFile(), help="File to write.")
@reading_settings
@settings_option(
    setting(
        "--format",
        "form",
        type=click.Choice(["csv", "parquet", "uff", "json", "jsonld"]),
        help="What to write.  [default: by the ending of --out]",
    ),
    setting(
        "--dtdl",
        type=click.Choice(["2", "3"]),
        help="For .json: version of the models.  [default: 3]",
    ),
)
def export(
    source: Path | None,
    server: str | None,
    start: str | None,
    end: str | None,
    form: str | None,
    out: Path,
    **_given: object,
) -> None:
    """Export the history of a twin, or the samples of a record.

    SOURCE is a twin's database, which a server may be writing to, or a file of samples in any
    format that `identify` reads. `--reading` is for files of samples. Without SOURCE, --server
    names a running twin server to read from.
    """
    if (source is None) == (server is None):
        raise click.UsageError("Give a twin's database or a record, or --server; not both.")
    if form is None and out.suffix.lower() not in ENDINGS:
        raise click.UsageError(
            f"{out.name!r} does not end in {', '.join(ENDINGS)}. Give one that does, or "
            "`--setting format=`."
        )
    if "json" in (form or out.suffix.lower()) and (start or end):
        raise click.UsageError(
            "--start and --end go with .csv and .parquet; a graph is of now."
        )
