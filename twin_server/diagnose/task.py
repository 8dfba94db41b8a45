"""The task of a diagnosis and its outcome, as files in its folder."""

from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import Field

from slowtime_schemas.files.model_v2 import AnyLineModel
from slowtime_schemas.quantities import Immutable
from twin_server.orders import DiagnosisOrder

TASK, RAW, HISTORY, REPORT, PAGE, AUGMENTED = (
    "task.json", "raw.mcap", "history.npz", "report.json", "report.html", "augmented.yaml",
)  # fmt: skip


class Task(Immutable):
    """Task of a diagnosis: data, model and settings.

    Parameters
    ----------
    recordings, holdout
        Files with raw samples of the twin.
    quantity, slow_time_unit
        Of the history, for a diagnosis in slow time.
    effects
        Installed parts of one's own that hold kinds of effect.
    max_own_s
        How long a diagnosis with them may take, before one without them is made.
    is_attempt
        Whether it is that diagnosis.
    notes
        What is to be said of them in the report.
    """

    site: str
    asset: str
    order: DiagnosisOrder
    model: AnyLineModel | None = None
    recordings: tuple[Path, ...] = ()
    holdout: tuple[Path, ...] = ()
    quantity: Literal["stiffness_change", "frequency_ratio"] = "stiffness_change"
    slow_time_unit: str = "s"
    effects: tuple[str, ...] = ()
    max_own_s: float = Field(default=300.0, gt=0)
    is_attempt: bool = False
    notes: tuple[str, ...] = ()
    max_samples: int = Field(default=20_000_000, ge=1)
    max_seconds: float = Field(default=600.0, gt=0)
    max_memory_bytes: int = Field(default=2 * 2**30, ge=1)


class TaskOutcome(NamedTuple):
    """Result files of a diagnosis."""

    report: str
    page: bytes
    model: str


def write_task(folder: Path, task: Task) -> None:
    """Write the task for the process."""
    (folder / TASK).write_text(task.model_dump_json(), encoding="utf-8")


def read_outcome(folder: Path) -> TaskOutcome:
    """Read the outcome that the process has written.

    Raises
    ------
    OSError
        Where it has left nothing.
    UnicodeDecodeError
        Where what it has left is no text.
    """
    model = folder / AUGMENTED
    return TaskOutcome(
        (folder / REPORT).read_text(encoding="utf-8"),
        (folder / PAGE).read_bytes(),
        model.read_text(encoding="utf-8") if model.exists() else "",
    )
