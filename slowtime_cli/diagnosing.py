"""The verb `diagnose`: a model and records in; what the model lacks, where and how much."""

import contextlib
import functools
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import click
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime_schemas.diagnosis_file import DiagnosisFile, Where
from slowtime_services.diagnose import diagnose_records, read_any, roles_of, write_results
from slowtime_services.diagnose.run import MASSES, MORE, PATIENCE_S
from slowtime_services.diagnose.sources import split
from slowtime_services.diagnose.words import number
from slowtime_services.effects import known
from slowtime_services.models import read_description

from .options import POSITIVE
from .terminal import ERR, note, show, shows_progress

IN = click.Path(exists=True, dir_okay=False, path_type=Path)


class RecordName(click.ParamType):  # type: ignore[type-arg]  # generic only in the newest click
    """A file that is there, or the seconds FROM:TO of it."""

    name = "record"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Refuse a file that is not there before any other is read."""
        try:
            IN.convert(str(split(value)[0]), param, ctx)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return value


RECORD = RecordName()


@click.command(
    epilog="""\b
Examples:
  slowtime diagnose rig.yaml low.csv high.csv --holdout other.csv --out found
  slowtime diagnose drive.yaml DATA_EMPS.mat --channel "force=gtau*vir" --channel x=qm
  slowtime diagnose --history twin.sqlite --twin lab.beam --out found
  slowtime diagnose --history bridge.csv
"""
)
@click.argument("model", type=IN, required=False)
@click.argument("records", nargs=-1, type=RECORD, metavar="RECORD...")
@click.option(
    "--history",
    type=str,
    metavar="STORE|FILE",
    help="Instead of a model and records: what a twin's database, .csv or .npz tells of slow "
    "time; columns slow_time, and stiffness_change, frequency_ratio or frequency_hz, each with "
    "_sd where known; all others are what it may follow.",
)
@click.option("--twin", metavar="SITE.ASSET", help="Which twin of the database.")
@click.option(
    "--holdout",
    multiple=True,
    type=RECORD,
    metavar="RECORD",
    help="Judge by this record, and learn nothing from it; may be repeated.  "
    "[default: the last third of the others]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, writable=True, path_type=Path),
    default=Path("diagnosis"),
    show_default=True,
    help="Folder for report.html, report.json and augmented.yaml.",
)
@click.option("--quick", is_flag=True, help="Look for one effect, among fewer rivals.")
@click.option(
    "--effects",
    multiple=True,
    type=IN,
    metavar="FILE",
    help="Python file that holds effects of your own; may be repeated.",
)
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME=WHAT",
    help="What the records call a channel of the model, or how to make it of their columns and "
    "single numbers with + - * /: force=gtau*vir; may be repeated.",
)
@click.option(
    "--rate-hz", type=POSITIVE, help="Samples per second; overrules what the files say."
)
@click.option(
    "--skip-lines",
    type=click.IntRange(min=0),
    help="Lines of text before header or data.  [default: found out]",
)
@click.option(
    "--time-column",
    help="Column of time, by name or number; none if there is none.  [default: found out]",
)
@click.option(
    "--patience",
    "patience_s",
    type=POSITIVE,
    metavar="SECONDS",
    help="Processor time after which no more laws are tried.  "
    f"[default: {PATIENCE_S:g}; of more than {MASSES} degrees of freedom in proportion, up to "
    f"{PATIENCE_S * MORE:g}]",
)
@click.option(
    "--unchecked",
    is_flag=True,
    help="Take records as they are, even where sizes point to a wrong unit or wire.",
)
def diagnose(
    model: Path | None,
    records: tuple[str, ...],
    history: str | None,
    twin: str | None,
    holdout: tuple[str, ...],
    out: Path,
    quick: bool,
    effects: tuple[Path, ...],
    channels: tuple[str, ...],
    rate_hz: float | None,
    skip_lines: int | None,
    time_column: str | None,
    patience_s: float | None,
    unchecked: bool,
) -> None:
    """Find what a model lacks, where and how much, from records of it.

    The model's constants are refitted first, so that plain retuning is never called a
    discovery. Records carry the channels of the model by name, in one clock; each may be
    MCAP, text with a header, .npz with t or rate_hz, or MATLAB. FILE@FROM:TO is a part of
    one, in seconds from its beginning.

    With --history, find what the slow changes of a twin follow: temperature, load, time, a
    step. What is found is adopted through the twin's page or its REST interface (`clock:
    slow`), by which the same diagnosis may be ordered.
    """
    if history is not None:
        if model is not None or records:
            raise click.UsageError("--history takes no MODEL and no RECORD. Leave them out.")
        _refuse_unwritable(out)
        # Only then: it brings the whole server along, which takes half a second.
        from .looking_back import look_back

        with _stages() as progress:
            look_back(history, twin, out, progress)
        return
    if model is None or not records:
        raise click.UsageError(
            "Give a MODEL and at least one RECORD of it, or --history with a twin's database."
        )
    kinds = known(effects)
    description = read_description(model, kinds)
    if not description.sensors:
        raise click.UsageError(
            f"{model.name} lists no sensors. Say under `sensors` which channel hears what."
        )
    read = functools.partial(
        read_any, rate_hz=rate_hz, skip_lines=skip_lines, time_column=time_column
    )
    learnt, judged = [read(text) for text in records], [read(text) for text in holdout]
    _refuse_unwritable(out)
    roles = roles_of(channels)
    with _stages() as progress:
        found, document = diagnose_records(
            description, learnt, judged, roles=roles, kinds=kinds, quick=quick,
            unchecked=unchecked, progress=progress, patience_s=patience_s,
        )  # fmt: skip
    for text in document.notes:
        note(text)
    write_results(out, found, document)
    _tell(found, document, out)


def _refuse_unwritable(out: Path) -> None:
    """Fail before the work rather than after it where its results could not be kept."""
    there = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise click.UsageError(
            f"Nothing can be written into {out}: {error.strerror}. Give another folder with "
            "--out."
        ) from None


@contextlib.contextmanager
def _stages() -> Iterator[Callable[[str, float], None]]:
    """Show a bar with the stage in words; nothing off a terminal."""
    words = TextColumn("{task.description}")
    columns = (words, BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=ERR, transient=True, disable=not shows_progress()
    ) as progress:
        task = progress.add_task("reading", total=1.0)
        yield lambda stage, share: progress.update(task, description=stage, completed=share)


def _tell(found: Diagnosis, document: DiagnosisFile, out: Path) -> None:
    """Say it: the sentence, the effects with their numbers, the gap, where the files are."""
    click.echo(f"{document.verdict.replace('_', ' ')}: {document.sentence}")
    rows, plain = [], []
    for effect in document.effects:
        numbers = {name: number(n) for name, n in effect.parameters.items() if n.sd > 0}
        told = ", ".join(f"{name} {text}" for name, text in numbers.items())
        rows.append((effect.effect, _at(effect.where), told, f"{effect.probability:.3f}"))
        plain.append(
            {
                "effect": effect.effect,
                "where": _at(effect.where),
                "parameters": told,
                "probability": effect.probability,
            }
        )
    if rows:
        show("", ("effect", "where", "parameters", "probability"), rows, plain=plain)
    steps = _steps(document)
    judged = "what was held out" if document.gap.on == "holdout" else "the last third"
    show(
        f"Error of the free run on {judged}",
        ("model", "error [%]"),
        [(name, f"{100 * value:.2f}") for name, value in steps],
        plain=[{"model": name, "nrmse": value} for name, value in steps],
    )
    click.echo(f"{out}: {found.seconds:.1f} s")


def _steps(document: DiagnosisFile) -> list[tuple[str, float]]:
    gap = document.gap
    return [
        ("as given", gap.nominal),
        ("refitted", gap.refitted_nominal),
        *((f"with {s.effect} at {_at(s.where)}", s.nrmse) for s in gap.steps),
        ("noise floor", gap.noise_floor),
    ]


def _at(where: Where) -> str:
    return "base" if where.kind == "base" else f"{where.kind} {where.id}"
