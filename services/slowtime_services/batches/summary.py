"""One table of all cases of a batch."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from slowtime_services.documents.bounds import DATA, DocumentError
from slowtime_services.documents.document_files import read_checked_json
from slowtime_services.engines import JobEnd
from slowtime_services.reasons import reason_of

from .runs import REPORT

SUMMARY = "summary.csv"
COLUMNS = (
    "case", "status", "verdict", "effects", "probability", "undecided", "error_as_given",
    "error_refitted", "error_augmented", "noise_floor", "seconds", "attempts", "sentence",
)  # fmt: skip
"""Of the table. Errors are relative errors of free runs on what was not fitted [1]; effects are
written as `effect@place`, with semicolons between them; the probability is that of the least
certain one; for a case that failed, the sentence is the end of its error output."""


def write_summary(out: Path, outcomes: Sequence[JobEnd]) -> Path:
    """Write `summary.csv` of the cases that ended so far, by name.

    Parameters
    ----------
    out
        Folder of results, with a folder for each case.
    outcomes
        How the cases ended.

    Returns
    -------
    Path of the table.
    """
    path = out / SUMMARY
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, restval="")
        writer.writeheader()
        for outcome in sorted(outcomes, key=lambda one: one.name):
            writer.writerow(row_of(out, outcome))
    unfinished.replace(path)
    return path


def row_of(out: Path, outcome: JobEnd) -> dict[str, Any]:
    """Give the row of a case.

    Parameters
    ----------
    out
        Folder of results.
    outcome
        How the case ended.
    """
    row: dict[str, Any] = {
        "case": outcome.name,
        "status": outcome.status,
        "seconds": f"{outcome.seconds:.1f}",
        "attempts": outcome.attempts,
    }
    if outcome.status != "done":
        lines = outcome.message.splitlines()
        return {**row, "sentence": lines[-1] if lines else ""}
    try:
        report = read_checked_json(out / outcome.name / REPORT, _Report, DATA)
    except (OSError, DocumentError) as error:
        return {**row, "sentence": f"Its report cannot be read: {reason_of(error)}"}
    gap, effects = report.gap, report.effects
    return {
        **row,
        "verdict": report.verdict,
        "effects": "; ".join(map(_label, effects)),
        "probability": min(
            (one.probability for one in effects if one.probability is not None), default=""
        ),
        "undecided": "; ".join(map(_label, report.undecided)),
        "error_as_given": gap.nominal,
        "error_refitted": gap.refitted_nominal,
        "error_augmented": gap.augmented,
        "noise_floor": gap.noise_floor,
        "sentence": report.sentence,
    }


def _label(effect: "_Effect") -> str:
    return f"{effect.effect}@{effect.where.id or effect.where.kind}"


class _Where(BaseModel):
    kind: str
    id: str | None = None


class _Effect(BaseModel):
    effect: str
    where: _Where
    probability: float | None = None


class _GapRow(BaseModel):
    nominal: float | None
    refitted_nominal: float | None
    augmented: float | None
    noise_floor: float | None


class _Report(BaseModel):
    """What the table tells of a report, which others may have changed since it was written."""

    verdict: str
    sentence: str
    effects: tuple[_Effect, ...]
    undecided: tuple[_Effect, ...]
    gap: _GapRow
