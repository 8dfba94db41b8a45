"""The option `diagnose --history`: finds the effects that a history of features follows."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import click

from slowtime_cli.shared.report_flags import report_language, report_subject
from slowtime_cli.shared.terminal import show
from slowtime_services.diagnose.history_document import (
    covariate_of,
    diagnose_with_document,
    parameters_text,
    write_history_results,
)
from slowtime_services.diagnose.history_table import TabulatedHistory, read_history
from slowtime_services.files import RecordError
from twin_server.diagnose.history_diagnosis import read_task_history
from twin_server.persist import Store, WrongStoreError, backup, is_url, open_store
from twin_server.pipeline.diagnoses.history_file import history_of
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

TABLES = (".csv", ".txt", ".npz")
MAX_READINGS = 200_000
"""Readings of a history that are diagnosed at most, the newest [1]."""


def diagnose_history(
    source: str,
    twin: str | None,
    out: Path,
    progress: Callable[[str, float], None],
    page: Path | None = None,
) -> None:
    """Diagnose a history, write the report, and print the result."""
    history = _history(source, twin)
    report, document = diagnose_with_document(history, progress=progress)
    write_history_results(
        out, report, document, page=page, structure=report_subject(),
        language=report_language(),
    )  # fmt: skip
    click.echo(f"{report.verdict.replace('_', ' ')}: {report.sentence}")
    rows = []
    for effect in report.effects:
        follows = covariate_of(effect.effect.place) or "slow time"
        numbers = parameters_text(effect)
        rows.append((effect.effect.kind, follows, numbers, f"{effect.probability:.3f}"))
    headings = ("effect", "follows", "parameters", "probability")
    if rows:
        show("", headings, rows, plain=[dict(zip(headings, r, strict=True)) for r in rows])
    gap = report.gap
    steps = [("as it was", gap.nominal), ("with the effects", gap.augmented)]
    steps.append(("noise alone", gap.noise_floor))
    show(
        "Scatter that is left",
        ("model", "scatter [%]"),
        [(name, f"{100 * value:.2f}") for name, value in steps],
        plain=[{"model": name, "scatter": value} for name, value in steps],
    )
    click.echo(f"{out}: {document['seconds']:.1f} s")


def _history(source: str, twin: str | None) -> TabulatedHistory:
    if is_url(source):
        return _of_store(source, twin)
    path = Path(source)
    if not path.is_file():
        raise RecordError(
            f"There is no file {source}. Give a twin's database, or .csv or .npz."
        )
    if path.suffix in TABLES:
        if twin is not None:
            raise click.UsageError(f"{path.name} holds one history: leave --asset out.")
        return read_history(path)
    with tempfile.TemporaryDirectory() as folder:
        # A server may be writing it: what is looked at is a copy.
        copy = Path(folder) / "copy.sqlite"
        try:
            backup(path, copy, lambda stage, share: None)
        except WrongStoreError as error:
            raise RecordError(str(error)) from error
        return _of_store(copy, twin)


def _of_store(database: str | Path, twin: str | None) -> TabulatedHistory:
    store = open_store(database)
    try:
        return _read(store, twin)
    finally:
        store.close()


def _read(store: Store, twin: str | None) -> TabulatedHistory:
    known = sorted(row.id for row in store.twins())
    if twin is None and len(known) == 1:
        twin = known[0]
    row = None if twin is None else store.twin(twin)
    if row is None:
        said = "Name the twin with --asset" if twin is None else f"There is no twin {twin!r}"
        raise RecordError(f"{said}. There are: {', '.join(known) or 'none'}.")
    registration = Registration.model_validate_json(row.registration)
    with tempfile.TemporaryDirectory() as folder:
        try:
            told = history_of(store, row.id, registration, Path(folder), MAX_READINGS)
        except ProblemError as problem:
            raise RecordError(str(problem)) from None
        return read_task_history(Path(folder), of=row.id, **told)
