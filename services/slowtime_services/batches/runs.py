"""Run the cases of a batch; what is finished is kept, also over interruptions."""

import dataclasses
import hashlib
import json
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field

from slowtime_services.documents.document_files import read_checked_json
from slowtime_services.engines import Engine, Job, JobEnd, JobLimits
from slowtime_services.engines.jobs import Status

from .cases import Case

OUTCOME = "outcome.json"
"""File in the folder of a case: how it ended, and of which inputs."""
REPORT = "report.json"
NO_LIMITS = JobLimits()
Command = Callable[[Case, Path], tuple[str, ...]]
"""Gives the command that diagnoses a case into a folder."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class CaseBatch:
    """Cases, and how they are run.

    Parameters
    ----------
    cases
        Each with a name of its own.
    out
        Folder of results, with a folder for each case.
    command
        That diagnoses a case.
    limits
        Of each case.
    """

    cases: Sequence[Case]
    out: Path
    command: Command
    limits: JobLimits = NO_LIMITS


def run_batch(batch: CaseBatch, engine: Engine, stop: threading.Event) -> Iterator[JobEnd]:
    """Run all cases that were not finished before, and give the outcome of each as it ends.

    A case is finished once it has a report, or has failed by itself, of the same files and the
    same command. Those that were finished come first.

    Parameters
    ----------
    batch
        The cases.
    engine
        That runs them.
    stop
        Once set, the others are left for another call.
    """
    marks: dict[str, str] = {}
    jobs = []
    for case in batch.cases:
        folder = batch.out / case.name
        command = batch.command(case, folder)
        marks[case.name] = _fingerprint(case, command)
        kept = _kept(folder, marks[case.name])
        if kept is not None:
            yield kept
            continue
        folder.mkdir(parents=True, exist_ok=True)
        (folder / OUTCOME).unlink(missing_ok=True)
        (folder / REPORT).unlink(missing_ok=True)
        jobs.append(Job(case.name, command, Path.cwd()))
    for outcome in engine.run(jobs, batch.limits, stop):
        text = json.dumps(
            {"inputs": marks[outcome.name], **dataclasses.asdict(outcome)}, indent=1
        )
        (batch.out / outcome.name / OUTCOME).write_text(text + "\n")
        yield outcome


class _KeptOutcome(BaseModel):
    """An outcome as it is written, which others may have changed since."""

    inputs: str
    name: str
    status: Status
    seconds: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    attempts: int
    message: str = ""


def _kept(folder: Path, mark: str) -> JobEnd | None:
    """Give the outcome of an earlier run of the same inputs, if it would be the same again."""
    try:
        kept = read_checked_json(folder / OUTCOME, _KeptOutcome)
    except (OSError, ValueError):
        return None
    same, outcome = kept.inputs == mark, JobEnd(**kept.model_dump(exclude={"inputs"}))
    finished = outcome.status == "failed" or (
        outcome.status == "done" and (folder / REPORT).is_file()
    )
    return outcome if same and finished else None


def _fingerprint(case: Case, command: Sequence[str]) -> str:
    """Digest of the command and of the contents of all files."""
    digest = hashlib.sha256("\0".join(command).encode())
    for path in case.files:
        with path.open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()
