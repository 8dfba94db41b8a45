"""What travels between edge and twin, each message with the version it was born with."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from .quantities import BootId, Estimate, Finite, Frozen, Name, Nanoseconds, Quantity, Sequence

TimeBase = Literal["live", "recorded", "simulated"]
"""Whose clock `t_ns` is: a device's now, a recording's then, or a simulator's own."""


class Message(Frozen):
    """What every message says of itself."""

    MESSAGE: ClassVar[str]
    VERSION: ClassVar[int]

    version: int
    site: Name
    asset: Name
    boot: BootId
    sequence: Sequence
    t_ns: Nanoseconds

    @property
    def twin_id(self) -> str:
        """The twin this message is about."""
        return f"{self.site}.{self.asset}"


class Smoothed(Frozen):
    """The median → EWMA smoothed frequency, offered beside the measured one, with its delay."""

    value: Finite
    sd: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    lag_epochs: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Mode(Frozen):
    """One identified mode of vibration."""

    frequency_hz: Annotated[
        Quantity, Field(description="Undamped natural frequency, |pole| / (2 pi) [Hz].")
    ]
    damping_ratio: Quantity
    correlation: Annotated[float, Field(ge=-1, le=1)] = 0.0
    smoothed_frequency_hz: Smoothed | None = None
    snr_db: Finite | None = None
    flags: tuple[str, ...] = ()


class Quality(Frozen):
    """How good the samples behind a feature were."""

    samples: Annotated[int, Field(ge=0)]
    missing: Annotated[int, Field(ge=0)] = 0
    outliers: Annotated[int, Field(ge=0)] = 0
    flags: tuple[str, ...] = ()


class Features(Message):
    """What one epoch of samples said about frequency and damping."""

    MESSAGE: ClassVar[str] = "features"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    slow_time: Finite
    slow_time_unit: str = "s"
    start_ns: Nanoseconds
    method: Literal["free_decay", "ambient", "peak", "none"]
    modes: tuple[Mode, ...]
    quality: Quality
    covariates: dict[str, Finite] = {}
    truth: dict[str, Finite] | None = None

    @model_validator(mode="after")
    def _starts_before_it_ends(self) -> "Features":
        if self.start_ns > self.t_ns:
            raise ValueError(
                f"start_ns={self.start_ns} is later than t_ns={self.t_ns}. start_ns is the first "
                "sample's time, t_ns the last's."
            )
        return self


class Health(Message):
    """How an edge agent is doing; also the tail of its account (`last_sequence`)."""

    MESSAGE: ClassVar[str] = "health"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    last_sequence: Annotated[
        int,
        Field(ge=-1, description="Newest features sequence of this boot; -1 before the first."),
    ]
    first_held: Annotated[
        int,
        Field(
            ge=-1,
            description="Oldest features sequence of this boot still in the spool; -1 if none.",
        ),
    ]
    dropped: Annotated[
        int, Field(ge=0, description="Features the full spool has dropped unsent.")
    ] = 0
    uptime_s: Annotated[float, Field(ge=0)]
    counters: dict[str, int] = {}


class About(Message):
    """What an edge agent is: its software and the settings that decide its features."""

    MESSAGE: ClassVar[str] = "about"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    software: str
    settings: dict[str, Any]


class Acknowledgement(Message):
    """The twin's word that features are durable, up to and including `sequence` of `boot`."""

    MESSAGE: ClassVar[str] = "ack"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1


class TwinState(Message):
    """What the twin knows after one features message."""

    MESSAGE: ClassVar[str] = "state"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    id: str
    slow_time: Finite
    slow_time_unit: str = "s"
    frequency_hz: Estimate | None
    damping_ratio: Estimate | None
    stiffness_change: Estimate | None
    mass_change: Estimate | None
    correlation: Annotated[
        float,
        Field(ge=-1, le=1, description="Between the errors of stiffness and mass change."),
    ] = 0.0
    assumed: tuple[str, ...] = ()
    frequency_used: Literal["measured", "smoothed"] = "measured"
    valid: bool
    reasons: tuple[str, ...] = ()
    truth: dict[str, Finite] | None = None


class Event(Message):
    """Something a person may want to know of, once."""

    MESSAGE: ClassVar[str] = "event"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    kind: str
    severity: Literal["info", "warning", "alarm"]
    slow_time: Finite | None = None
    message: str
    details: dict[str, Any] = {}
