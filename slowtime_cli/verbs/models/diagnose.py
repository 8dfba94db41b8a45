"""Arguments and help of the verb `diagnose`."""

from pathlib import Path

import click

from slowtime_cli.shared.declared import options_of
from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.flags import EXISTING, READING, Effects
from slowtime_cli.shared.help_pages import Rare
from slowtime_cli.shared.options import POSITIVE
from slowtime_cli.shared.report_flags import report_flag, wording
from slowtime_cli.shared.settings import setting, settings_option
from slowtime_services.files.reading_options import ReadingOptions

PATIENCE_S, MASSES, MORE, LARGE = 70.0, 3, 2.0, 5.0
"""Of `slowtime_services.diagnose.run`, repeated as importing it takes seconds; a test holds
them to it."""


class RecordName(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A file that is there, or the seconds FROM:TO of it."""

    name = "record"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse a file that is not there before any other is read."""
        if Path(value).exists() or "@" not in value:
            EXISTING.convert(value, param, ctx)
            return value
        from slowtime_services.diagnose.sources import split

        try:
            EXISTING.convert(str(split(value)[0]), param, ctx)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return value


class SurfaceWords(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """Words for the shape of a force surface, separated by commas."""

    name = "surface"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse words that say no shape, or contradict each other."""
        if value == "auto":
            return value
        from slowtime.discrepancy.refinement.force_surface.shape import SurfaceDemand

        try:
            SurfaceDemand.of(value.split(","))
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return value


RECORD, SURFACE = RecordName(), SurfaceWords()


@click.command(
    cls=Deferred,
    work="models.diagnose:diagnose",
    extra="analysis",
    epilog="""\b
Examples:
  slowtime diagnose rig.yaml low.csv high.csv --holdout other.csv --out found
  slowtime diagnose drive.yaml DATA_EMPS.mat --channel "force=gtau*vir" --channel x=qm
  slowtime diagnose --history twin.sqlite --asset lab.beam --out found
  slowtime diagnose --history bridge.csv
  slowtime diagnose --batch rigs --out found --jobs 4
""",
)
@click.argument("model", type=EXISTING, required=False)
@click.argument("records", nargs=-1, type=RECORD, metavar="RECORD...")
@click.option(
    "--history",
    type=str,
    metavar="STORE|FILE",
    help="Instead of a model and records: history in a twin's database, .csv or .npz; columns "
    "slow_time, and stiffness_change, frequency_ratio or frequency_hz, each with _sd if known; "
    "other columns are covariates.",
)
@click.option("--asset", "twin", metavar="SITE.ASSET", help="Twin in the database.")
@click.option(
    "--holdout",
    multiple=True,
    type=RECORD,
    metavar="RECORD",
    help="Held-out record, for validation only; may be repeated.  "
    "[default: the last third of the others]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, writable=True, path_type=Path),
    default=Path("diagnosis"),
    show_default=True,
    help="Folder for report.html, report.json and augmented.yaml.",
)
@report_flag
@click.option("--quick", is_flag=True, help="Search for one effect, among fewer candidates.")
@click.option(
    "--effects",
    multiple=True,
    type=Effects(),
    metavar="FILE|NAME",
    help="Python file with effects of your own, or name of an installed plug-in; may be "
    "repeated.",
    cls=Rare,
)
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME=WHAT",
    help="Map a channel of the model to a column of the records, or to a formula of their "
    "columns and single numbers with + - * /: force=gtau*vir; may be repeated.",
)
@options_of(
    ReadingOptions, only=set(READING) - {"channels", "columns", "keep"}, settings="--reading"
)
@click.option(
    "--batch",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Instead of a model and records: diagnose many. Each subfolder with records is a "
    "case, with its model file in it or in FOLDER, and held-out records called holdout*; or "
    "FOLDER/cases.csv lists them (name, model, records, holdout). Writes "
    "--out/summary.csv; run the same command again to resume after an interruption.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="Processes that share a diagnosis, which finds the same with any number; of a batch, "
    "cases that run in parallel.  [default: one for each core that it may use; at most 4 for "
    "one diagnosis]",
    cls=Rare,
)
@click.option(
    "--patience",
    "patience_s",
    cls=Rare,
    type=POSITIVE,
    metavar="SECONDS",
    help="Limit of the search, counted as seconds of a reference machine: no new effects are "
    "tried after it. The report ends at twice as many seconds of processor time, too, and says "
    f"what it left out.  [default: {PATIENCE_S:g} for up to {MASSES} degrees of freedom, then "
    f"more in proportion, at most {PATIENCE_S * MORE:g}; {PATIENCE_S * LARGE:g} for large "
    "models, which are reduced]",
)
@settings_option(
    setting(
        "--engine",
        default="local",
        show_default=True,
        metavar="local|ray[://HOST:PORT]",
        help="Where a batch runs: on this computer, or on a Ray cluster whose computers see "
        "the same folders (needs slowtime[ray]).",
    ),
    setting(
        "--surface",
        type=SURFACE,
        default="auto",
        show_default=True,
        metavar="SHAPE[,SHAPE]",
        help="Shape of the force surface that is fitted where no effect explains the "
        "records: odd, even, monotone, free (any), or auto (odd or even where the records "
        "favour it). A shape that the records contradict is not used, and a note says so.",
    ),
    setting(
        "--unchecked",
        is_flag=True,
        help="Accept records even if their sizes suggest a wrong unit or exchanged channels.",
    ),
    setting(
        "--limit-s",
        type=POSITIVE,
        help="Time limit of a case of a batch [s].  [default: none]",
    ),
    setting(
        "--limit-mib",
        type=click.IntRange(min=1),
        help="Memory limit of a case of a batch [MiB].  [default: none]",
    ),
    setting(
        "--retries",
        type=click.IntRange(min=0),
        default=1,
        show_default=True,
        help="How often a case of a batch is repeated if its process was killed.",
    ),
    *wording(),
)
def diagnose(
    model: Path | None,
    records: tuple[str, ...],
    history: str | None,
    batch: Path | None,
    holdout: tuple[str, ...],
    **_given: object,
) -> None:
    """Find effects that a model lacks, with their place and size.

    The model's constants are refitted first, so that wrong constants are not reported as
    effects. Records have the channels of the model by name, on one clock; each may be text
    with a header, NumPy, MATLAB, Excel, TDMS, WAV, miniSEED, HDF5, Parquet, UFF, MCAP and
    others (docs/files.md). FILE@FROM:TO is a part of one, in seconds from its beginning.

    With --history, find what drives the slow changes of a twin: temperature, load, time, a
    step. To adopt the result, order the same diagnosis on the twin's page or by REST (`clock:
    slow`).

    Each stage tells what is likely missing so far. Ctrl-C ends the search with an answer from
    what was found by then; pressed again, it stops at once.
    """
    if batch is not None and (model is not None or records or holdout or history):
        raise click.UsageError(
            "--batch takes no MODEL, no RECORD, no --holdout and no --history: its folder says "
            "what to diagnose. Leave them out."
        )
    if batch is not None:
        return
    if history is not None and (model is not None or records):
        raise click.UsageError("--history takes no MODEL and no RECORD. Leave them out.")
    if history is None and (model is None or not records):
        raise click.UsageError(
            "Give a MODEL and at least one RECORD of it, --history with a twin's database, or "
            "--batch with a folder of cases."
        )
    if history is not None and "://" not in history and not Path(history).is_file():
        raise click.UsageError(
            f"There is no file {history}. Give a twin's database, or .csv or .npz."
        )
