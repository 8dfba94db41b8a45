"""Beside the stages of the twin: samples and a model in; diagnoses, as jobs, out.

Each diagnosis is a process of its own (`python -m twin_server.diagnose FOLDER`), whose folder
holds what it needs, and where it leaves what it found.
"""

from .jobs import Ended, JobId, Jobs, Progress
from .samples import NoSamplesError, Piece, part, pieces_of, within
from .task import HISTORY, RAW, Outcome, Task, read_outcome, write_task

__all__ = [
    "HISTORY",
    "RAW",
    "Ended",
    "JobId",
    "Jobs",
    "NoSamplesError",
    "Outcome",
    "Piece",
    "Progress",
    "Task",
    "part",
    "pieces_of",
    "read_outcome",
    "within",
    "write_task",
]
