"""What a diagnosis is asked for, and what of it a twin has adopted."""

import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, model_validator

from slowtime_schemas.model_file import ModelFile

Clock = Literal["fast", "slow"]
State = Literal["queued", "running", "done", "failed", "cancelled"]
Seconds = Annotated[float, Field(gt=0, le=3600, allow_inf_nan=False)]
Moment = Annotated[int, Field(ge=0, lt=2**63)] | AwareDatetime

ENDED: tuple[State, ...] = ("done", "failed", "cancelled")
FILES = ("report.json", "report.html", "augmented.yaml")
"""What a diagnosis that is done has to give."""

_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_MICROSECOND = datetime.timedelta(microseconds=1)


class Frozen(BaseModel):
    """Immutable, and refusing what it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class FromRecordings(Frozen):
    """Raw samples of the twin in recordings that the server keeps."""

    files: Annotated[
        tuple[Annotated[str, Field(pattern=r"^[^/\\]{1,200}\.mcap$")], ...],
        Field(max_length=64, description="Names; left out, all that the server keeps."),
    ] = ()
    start: Moment | None = None
    """RFC 3339, or nanoseconds since 1970-01-01 UTC, of the sensor's clock."""
    end: Moment | None = None

    @model_validator(mode="after")
    def _goes_forward(self) -> Self:
        start, end = self.span_ns
        if start is not None and end is not None and start >= end:
            raise ValueError(f"{self.start} is not before {self.end}. Give the earlier first.")
        return self

    @property
    def span_ns(self) -> tuple[int | None, int | None]:
        """First moment, and that after the last [ns]."""
        return _ns(self.start), _ns(self.end)


class FromEdge(Frozen):
    """Raw samples asked from the edge agent now: the last it has."""

    duration_s: Seconds = 30.0
    """Of samples, whatever lies between records; at most what the edge keeps."""


class DiagnosisOrder(Frozen):
    """Which samples, or which clock, and how thoroughly.

    Examples
    --------
    >>> DiagnosisOrder(raw={"duration_s": 60.0}).clock
    'fast'
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"raw": {"duration_s": 60.0}, "holdout_s": 20.0},
                {"recordings": {"files": ["monday.mcap"]}, "quick": True},
                {"clock": "slow"},
            ]
        },
    )

    clock: Clock = "fast"
    """`fast`: the model against samples; `slow`: the twin's history against covariates."""
    raw: FromEdge | None = None
    recordings: FromRecordings | None = None
    holdout: FromRecordings | None = None
    """Recordings to judge by."""
    holdout_s: Seconds | None = None
    """Judge by the last so many seconds of the samples instead, and fit nothing to them."""
    quick: bool = False
    """Refit fewer rivals, and look for one effect only."""

    @model_validator(mode="after")
    def _says_from_what(self) -> Self:
        sources = [self.raw, self.recordings]
        if self.clock == "slow":
            if any((*sources, self.holdout, self.holdout_s)):
                raise ValueError(
                    "Samples were asked for with clock='slow', which looks at the twin's "
                    "history. Leave raw, recordings and holdout out, or give clock='fast'."
                )
        elif sum(source is not None for source in sources) != 1:
            raise ValueError(
                "Say where the samples come from. Give raw={'duration_s': 30} to ask the edge, "
                "or recordings={} for what the server keeps; one of them."
            )
        if self.holdout is not None and self.holdout_s is not None:
            raise ValueError("holdout and holdout_s were given. Give one of them.")
        return self


def _ns(moment: Moment | None) -> int | None:
    if isinstance(moment, datetime.datetime):
        return (moment - _EPOCH) // _MICROSECOND * 1_000
    return moment


class Adopted(Frozen):
    """A diagnosis that a twin has taken in, and what it takes to undo that."""

    diagnosis: Annotated[int, Field(ge=1)]
    clock: Clock
    effects: tuple[str, ...]
    sentence: str
    model_before: ModelFile | None = None
    """Of a diagnosis in fast time."""
    covariates_before: dict[str, Any] | None = None
    """Of one in slow time."""
