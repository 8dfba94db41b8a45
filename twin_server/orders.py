"""Orders of diagnoses and simulations, and the diagnosis that a twin has adopted."""

import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AwareDatetime,
    ConfigDict,
    FailFast,
    Field,
    JsonValue,
    model_validator,
)

from slowtime_schemas.files.model_v2 import AnyLineModel
from slowtime_schemas.quantities import Immutable, Plain

Clock = Literal["fast", "slow"]
Seconds = Annotated[float, Field(gt=0, le=3600, allow_inf_nan=False)]
Moment = Annotated[int, Field(ge=0, lt=2**63)] | AwareDatetime
FILES = ("report.json", "report.html", "charts.json", "augmented.yaml")
"""What a diagnosis that is done has to give."""

_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_MICROSECOND = datetime.timedelta(microseconds=1)


class FromRecordings(Immutable):
    """Raw samples of the twin in recordings that the server keeps."""

    files: Annotated[
        tuple[Annotated[str, Field(pattern=r"^[^/\\]{1,200}\.mcap$"), Plain], ...],
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
        return moment_ns(self.start), moment_ns(self.end)


class FromEdge(Immutable):
    """Raw samples asked from the edge agent now: the last it has."""

    duration_s: Seconds = 30.0
    """Of samples, whatever lies between records; at most what the edge keeps."""


class DiagnosisOrder(Immutable):
    """Which samples, or which clock, and how thoroughly.

    Examples
    --------
    >>> DiagnosisOrder(raw={"duration_s": 60.0}).clock
    'fast'
    """

    model_config = ConfigDict(
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


def moment_ns(moment: Moment | None) -> int | None:
    """Nanoseconds since 1970-01-01 UTC of a moment, which may have been given as a date."""
    if isinstance(moment, datetime.datetime):
        return (moment - _EPOCH) // _MICROSECOND * 1_000
    return moment


class Adopted(Immutable):
    """A diagnosis that a twin has adopted, and what is needed to undo that."""

    diagnosis: Annotated[int, Field(ge=1)]
    clock: Clock
    effects: tuple[str, ...]
    sentence: str
    model_before: AnyLineModel | None = None
    """Of a diagnosis in fast time."""
    covariates_before: dict[str, Any] | None = None
    """Of one in slow time."""


Finite = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
Rate = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]

MOST_SAMPLES = 20_000
"""Of one simulation."""


class Harmonic(Immutable):
    """A cosine that begins at once."""

    kind: Literal["harmonic"]
    amplitude: Finite
    frequency_hz: Rate
    phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class Step(Immutable):
    """Nothing until `at_s`, then `amplitude` for good."""

    kind: Literal["step"]
    amplitude: Finite
    at_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0


class White(Immutable):
    """Noise, white up to half the sampling rate; which one follows from the seed."""

    kind: Literal["white"]
    psd: Annotated[
        float, Field(ge=0, le=1e18, description="One-sided density, of the load's unit^2/Hz.")
    ]


class Recorded(Immutable):
    """Samples of a load; it is straight between them."""

    kind: Literal["recorded"]
    samples: Annotated[
        tuple[Finite, ...], Field(min_length=2, max_length=MOST_SAMPLES), FailFast()
    ]


Load = Annotated[Harmonic | Step | White | Recorded, Field(discriminator="kind")]

SIMULATION_EXAMPLES: list[JsonValue] = [
    {
        "load": {"kind": "harmonic", "amplitude": 0.5, "frequency_hz": 4.9},
        "duration_s": 20.0,
        "quantity": "displacement",
    },
    {
        "load": {"kind": "recorded", "samples": [0.0, 120.0, 40.0, 0.0, 0.0, 0.0]},
        "on": "floor2",
        "rate_hz": 50.0,
        "outputs": ["floor1", "floor2"],
        "draws": 200,
        "seed": 7,
    },
]


class SimulationOrder(Immutable):
    """Under which load today's twin is run, from rest."""

    model_config = ConfigDict(json_schema_extra={"examples": SIMULATION_EXAMPLES})

    load: Load
    on: Annotated[
        str,
        Field(
            min_length=1,
            max_length=80,
            description="`base`: the load is an acceleration of the base [m/s^2]. A node of "
            "the model, or `mass` of a twin of one mode with a nominal mass: a force [N].",
        ),
    ] = "base"
    outputs: Annotated[
        tuple[Annotated[str, Field(min_length=1, max_length=80)], ...] | None,
        Field(min_length=1, max_length=64, description="Nodes; all that move where left out."),
    ] = None
    quantity: Annotated[
        Literal["displacement", "velocity", "acceleration"],
        Field(description="The first two against the base, acceleration in space."),
    ] = "acceleration"
    duration_s: Annotated[
        float | None,
        Field(gt=0, le=1e6, description="By default 20 periods of the lowest mode."),
    ] = None
    rate_hz: Annotated[
        Rate | None,
        Field(
            description="By default 20 samples a period of the highest mode, or 20 of the "
            "load's, whichever is more."
        ),
    ] = None
    level: Annotated[float, Field(gt=0, lt=1)] = 0.95
    draws: Annotated[
        int | None,
        Field(
            ge=20,
            le=2_000,
            description="Structures that are drawn and run; by default 400, or as many as are "
            "allowed of so many samples.",
        ),
    ] = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @model_validator(mode="after")
    def _says_how_fast_it_was_recorded(self) -> Self:
        if self.load.kind == "recorded":
            if self.rate_hz is None:
                raise ValueError(
                    "A recorded load was given without its rate. Give rate_hz, the samples per "
                    "second."
                )
            if self.duration_s is not None:
                raise ValueError(
                    "A recorded load lasts as long as its samples. Leave duration_s out."
                )
        return self
