"""Beside the stages of the twin: samples and a model in; diagnoses, as jobs, out.

Each diagnosis is a process of its own (`python -m twin_server.diagnose FOLDER`), whose folder
holds what it needs, and where it leaves what it found.
"""

from .jobs import DiagnosisProgress, Ended, JobId, Jobs
from .samples import NoSamplesError, SamplePiece, part, pieces_of, within
from .task import HISTORY, RAW, Task, TaskOutcome, read_outcome, write_task

__all__ = [
    "HISTORY",
    "RAW",
    "DiagnosisProgress",
    "Ended",
    "JobId",
    "Jobs",
    "NoSamplesError",
    "SamplePiece",
    "Task",
    "TaskOutcome",
    "part",
    "pieces_of",
    "read_outcome",
    "within",
    "write_task",
]
