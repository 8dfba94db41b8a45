"""Answers about diagnoses and the gap between model and measurement."""

from typing import Any, Literal

from pydantic import ConfigDict, Field

from .base import RestAnswer

DiagnosisState = Literal["queued", "running", "done", "failed", "cancelled"]
GapState = Literal["off", "waiting", "learning", "watching", "disagreeing"]
_ORDER: dict[str, Any] = {"clock": "fast", "raw": {"duration_s": 60.0}, "quick": False}
DIAGNOSIS_EXAMPLE: dict[str, Any] = {
    "number": 3,
    "id": "lab.rig",
    "asked_ns": 1795233600123456789,
    "ended_ns": None,
    "state": "running",
    "stage": "refitting coulomb at element j2",
    "progress": 0.31,
    "seconds": 2.6,
    "request": _ORDER,
    "error": "",
    "report": None,
    "adopted": False,
}
GAP_EXAMPLE: dict[str, Any] = {
    "id": "lab.rig",
    "measure": "nrmse",
    "state": "watching",
    "sentence": "The model explains what arrives as well as it ever did.",
    "learnt": 12,
    "expected": 0.031,
    "limit": 0.047,
    "readings": [
        {"t_ns": 1795233600123456789, "nominal": 0.033, "in_use": 0.033, "disagrees": False}
    ],
}


class DiagnosisModel(RestAnswer):
    """A diagnosis: its progress, or its result."""

    model_config = ConfigDict(json_schema_extra={"examples": [DIAGNOSIS_EXAMPLE]})

    number: int
    id: str
    asked_ns: int
    ended_ns: int | None
    state: DiagnosisState
    stage: str = Field(description="While it runs, in words.")
    progress: float = Field(description="Share that is done.")
    seconds: float = Field(description="Since it began to run.")
    request: dict[str, Any] = Field(description="As it was ordered.")
    error: str = Field(description="Why there is nothing, where it failed.")
    report: dict[str, Any] | None = Field(
        description="Its report.json; of fast time, the diagnosis file of `slowtime diagnose`."
    )
    adopted: bool = Field(description="Whether the twin has taken it in.")


class DiagnosisList(RestAnswer):
    """Diagnoses of a twin, the newest first."""

    diagnoses: tuple[DiagnosisModel, ...]


class GapReading(RestAnswer):
    """Error of the free run on one record that arrived."""

    t_ns: int = Field(description="Sensor time of its first sample.")
    nominal: float = Field(description="Of the model before anything was adopted.")
    in_use: float = Field(description="Of the model with what was adopted.")
    disagrees: bool = Field(description="Whether the limit is passed.")


class GapModel(RestAnswer):
    """Error of the model's free run on current samples, and its usual size."""

    model_config = ConfigDict(json_schema_extra={"examples": [GAP_EXAMPLE]})

    id: str
    measure: Literal["nrmse"]
    state: GapState
    sentence: str
    learnt: int = Field(description="Readings from which the expected gap was learnt.")
    expected: float | None
    limit: float | None
    readings: tuple[GapReading, ...]
