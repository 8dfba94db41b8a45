"""Answers about events of assets: repairs, replacements, inspections, load tests and notes."""

from typing import Annotated

from pydantic import Field

from slowtime_schemas.asset_events import (
    AssetEventKind,
    Correction,
    DetectionResult,
    MeasuredChange,
    NewPart,
    RepairResult,
)

from .base import Extensible, RestAnswer


class AssetEventModel(RestAnswer):
    """A reported event of an asset, and whether it holds."""

    event: str = Field(description="Id that was given.", examples=["work-order-118"])
    number: int = Field(description="Counts the events of a twin.")
    kind: Annotated[AssetEventKind, Extensible]
    sentence: str = Field(examples=["Repair recorded by Ann: perfect, all damage restored."])
    quantity: str | None
    t_ns: int | None = Field(
        description="By the sensor's clock; null where the history does not reach back so far."
    )
    slow_time: float | None = Field(
        description="As told, or of the last reading at or before it; null likewise."
    )
    person: str
    principal: str = Field(description="Whose token it was.")
    accepted_ns: int = Field(description="By the server's clock [ns since 1970-01-01 UTC].")
    text: str
    repair: RepairResult | None
    replacement: NewPart | None
    measured: MeasuredChange | None
    detection: DetectionResult | None
    conditions: dict[str, float]
    reverses: str | None = Field(description="Event that it takes back.")
    reversed_by: str | None = Field(description="Event that takes it back or corrects it.")
    corrects: Correction | None = Field(None, description="Event that it stands instead of.")
    answers: str | None = Field(description="`event_id` of the question that it answers.")


class QuestionModel(RestAnswer):
    """A change that looks like an unreported repair."""

    event_id: str = Field(examples=["59f1856b17386c5b4de99fa65efe7580"])
    number: int
    t_ns: int = Field(description="When it was asked, by the server's clock.")
    message: str
    quantity: str
    since: float = Field(description="Slow time of the last reading before the change.")
    size: float = Field(description="Of the change [1].")
    sd: float
    answered_by: str | None = Field(description="Event that answers it; null while it is open.")


class AssetEventList(RestAnswer):
    """Events of an asset and questions about it, the newest first."""

    id: str
    events: tuple[AssetEventModel, ...]
    questions: tuple[QuestionModel, ...]
