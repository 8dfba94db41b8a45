"""The header of a raw block, which describes its samples."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, PositiveFloat, model_validator

from .messages import Message, TimeBase
from .quantities import BelievedRate, Count, Covariates, Finite, Frozen, Sd, UnitName

ITEM_BYTES = {"<f8": 8, "<f4": 4, "<i4": 4, "<i2": 2}
DType = Literal["<f8", "<f4", "<i4", "<i2"]


class ClockCorrection(Frozen):
    """How far the sampling rate is from the nominal one: true = nominal (1 + relative)."""

    relative: Annotated[float, Field(gt=-1, allow_inf_nan=False)]
    sd: Sd


class RawHeader(Message):
    """What a raw block says of its samples; `t_ns` is the first sample's time."""

    MESSAGE: ClassVar[str] = "raw"
    VERSION: ClassVar[int] = 2

    version: Literal[2] = 2
    time_base: TimeBase = "live"
    rate_hz: Annotated[PositiveFloat, Field(allow_inf_nan=False), BelievedRate]
    first_index: Count
    dtype: DType
    samples: Annotated[int, Field(ge=0, lt=2**40, description="Rows.")]
    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    units: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    epoch: Count | None = None
    slow_time: Finite | None = None
    slow_time_unit: UnitName = "s"
    covariates: Covariates = Field(default_factory=dict)
    truth: Covariates | None = None
    clock: Annotated[
        ClockCorrection | None,
        Field(description="Of `rate_hz`, as known by then; null where it was not measured."),
    ] = None

    @model_validator(mode="after")
    def _one_unit_per_channel(self) -> "RawHeader":
        if len(self.units) != len(self.channels):
            raise ValueError(
                f"{len(self.channels)} channels but {len(self.units)} units. Give one unit "
                "per channel."
            )
        return self

    @property
    def body_bytes(self) -> int:
        """Length of the samples that must follow the header."""
        return self.samples * len(self.channels) * ITEM_BYTES[self.dtype]
