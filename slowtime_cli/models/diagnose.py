"""The verb `diagnose`: finds effects that a model lacks, from its records."""

import contextlib
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import click
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from slowtime.discrepancy.diagnosis import Diagnosis
from slowtime.discrepancy.refinement.force_surface import SurfaceDemand
from slowtime.discrepancy.search import SearchOptions
from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import ERR, note, show, shows_progress
from slowtime_schemas.files.diagnosis import DiagnosisFile, Where
from slowtime_services.diagnose import (
    diagnose_records,
    read_any,
    roles_of,
    write_report,
    write_results,
)
from slowtime_services.diagnose.labels import labelled, number
from slowtime_services.engines import JobLimits, usable_cores
from slowtime_services.matrices import read_any_description
from slowtime_services.plugins.effect_kinds import known

MOST_JOBS = 4
"""[processes] That share a diagnosis where --jobs is not given. Source: judgement; candidates
are few, and each is fitted with what those before it have shown."""


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
    patience_s: float | None,
    surface: str,
    unchecked: bool,
    batch: Path | None,
    jobs: int | None,
    engine: str,
    limit_s: float | None,
    limit_mib: int | None,
    retries: int,
    report: Path | None,
    **reading: Any,
) -> None:
    """Find effects that a model lacks, with their place and size."""
    if batch is not None:
        _refuse_unwritable(out)
        from .diagnose_batch import diagnose_batch

        limits = JobLimits(seconds=limit_s or 0.0, mebibytes=limit_mib or 0, retries=retries)
        diagnose_batch(batch, out, engine, jobs, limits)
        return
    if history is not None:
        _refuse_unwritable(out)
        # Only then: it brings the whole server along, which takes half a second.
        from .diagnose_history import diagnose_history

        with _stages() as progress:
            diagnose_history(history, twin, out, progress, report)
        return
    assert model is not None
    kinds = known(effects)
    description = read_any_description(model, kinds, note=note)
    if not description.sensors:
        raise click.UsageError(
            f"{model.name} lists no sensors. State under `sensors` which quantity each "
            "channel measures."
        )
    learnt, judged = (
        [read_any(text, **reading) for text in some] for some in (records, holdout)
    )
    _refuse_unwritable(out)
    roles = roles_of(channels)
    options = SearchOptions(quick=quick, surface=SurfaceDemand.of(surface.split(",")))
    with _stages() as progress, _until_enough() as enough:
        found, document = diagnose_records(
            description, learnt, judged, roles=roles, kinds=kinds,
            options=options, unchecked=unchecked, progress=progress, enough=enough,
            patience_s=patience_s, jobs=jobs or min(usable_cores(), MOST_JOBS),
        )  # fmt: skip
    for text in document.notes:
        note(text)
    wording = {"structure": report_subject(), "language": report_language()}
    write_results(out, found, document, **wording)
    if report is not None:
        write_report(report, found, document, **wording)
    _tell(found, document, out)


def _refuse_unwritable(out: Path) -> None:
    """Fail before the work rather than after it where its results could not be kept."""
    there = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise click.UsageError(
            f"Cannot write to {out}: {error.strerror}. Give another folder with --out."
        ) from None


@contextlib.contextmanager
def _stages() -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar with the stage in words; nothing if not on a terminal."""
    words = TextColumn("{task.description}")
    columns = (words, BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(
        *columns,
        console=ERR,
        transient=True,
        disable=not shows_progress(),
        auto_refresh=False,  # by a thread, beside which no process can be forked
    ) as progress:
        task = progress.add_task("reading", total=1.0)
        yield lambda stage, share: progress.update(
            task, description=stage, completed=share, refresh=True
        )


@contextlib.contextmanager
def _until_enough() -> Iterator[threading.Event]:
    """Yield an event that the first Ctrl-C sets; the second one ends the command."""
    enough = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        enough.set()
        signal.signal(signal.SIGINT, before)
        note("Ending with what was found so far. Press Ctrl-C again to stop at once.")

    before = signal.signal(signal.SIGINT, end)
    try:
        yield enough
    finally:
        signal.signal(signal.SIGINT, before)


def _tell(found: Diagnosis, document: DiagnosisFile, out: Path) -> None:
    """Print the verdict, the effects with their numbers, the error, and the files written."""
    click.echo(f"{document.verdict.replace('_', ' ')}: {document.sentence}")
    rows, plain = [], []
    for effect in document.effects:
        told = ", ".join(
            f"{labelled(name, n.unit)} {number(n)}"
            for name, n in effect.parameters.items()
            if n.sd > 0
        )
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
        *([("adopted model", gap.augmented)] if gap.adopts_another else []),
        ("noise floor", gap.noise_floor),
    ]


def _at(where: Where) -> str:
    return "base" if where.kind == "base" else f"{where.kind} {where.id}"
