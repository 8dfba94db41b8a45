"""Samples that programs publish, and the features that edges read from samples."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from slowtime_schemas.quantities import (
    BelievedRate,
    Count,
    Covariates,
    Finite,
    Flags,
    Frozen,
    Nanoseconds,
    Quantity,
    Sd,
    UnitName,
)

from .base import Message, TimeBase


class Smoothed(Frozen):
    """The median → EWMA smoothed frequency, offered beside the measured one, with its delay."""

    value: Finite
    sd: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    lag_epochs: Annotated[float, Field(ge=0, allow_inf_nan=False)]


def _positive(frequency: Quantity) -> Quantity:
    if frequency.value <= 0:
        raise ValueError(f"A frequency of {frequency.value} Hz is not positive.")
    return frequency


Components = Annotated[tuple[Finite, ...], Field(min_length=1, max_length=4096)]

UNIT_NORM_WITHIN = 1e-3
"""Shapes are rounded before they travel; what is farther from unit norm was never scaled."""


class Shape(Frozen):
    """What each channel shows while a mode rings, up to one complex factor.

    Of unit norm, largest component real and positive; one component a channel, in the order
    and the units of the channels.
    """

    re: Components
    im: Components
    sd: Annotated[
        tuple[Sd, ...],
        Field(
            min_length=1,
            max_length=4096,
            description="Of the complex deviation of each component.",
        ),
    ]

    @model_validator(mode="after")
    def _is_one_shape(self) -> "Shape":
        if not len(self.re) == len(self.im) == len(self.sd):
            raise ValueError(
                f"A shape of {len(self.re)} real parts, {len(self.im)} imaginary parts and "
                f"{len(self.sd)} standard deviations. Give one of each per channel."
            )
        norm = math.hypot(*self.re, *self.im)
        if abs(norm - 1.0) > UNIT_NORM_WITHIN:
            raise ValueError(
                f"A shape of norm {norm:.6g}. Divide it by its norm; leave out the shape of a "
                "mode that no channel sees."
            )
        return self


class Mode(Frozen):
    """One identified mode of vibration, or the line of a machine."""

    frequency_hz: Annotated[
        Quantity,
        AfterValidator(_positive),
        Field(description="Undamped natural frequency, |pole| / (2 pi) [Hz]."),
    ]
    damping_ratio: Quantity
    correlation: Annotated[float, Field(ge=-1, le=1)] = 0.0
    smoothed_frequency_hz: Smoothed | None = None
    snr_db: Finite | None = None
    flags: Flags = ()
    identity: Annotated[
        Count | None,
        Field(description="Lasting name within the boot; null for what is nobody's yet."),
    ] = None
    kind: Annotated[
        Literal["structural", "harmonic"],
        Field(description="A harmonic is a machine's line, whose damping means nothing."),
    ] = "structural"
    shape: Shape | None = None


class Quality(Frozen):
    """How good the samples behind a feature were."""

    samples: Count
    missing: Count = 0
    outliers: Count = 0
    flags: Flags = ()


class SensorSamples(Message):
    """Samples that any program may publish for an edge agent with `--source zenoh:`."""

    MESSAGE: ClassVar[str] = "samples"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    rate_hz: Annotated[
        float,
        Field(gt=0, allow_inf_nan=False, description="Nominal samples per second."),
        BelievedRate,
    ]
    first_index: Annotated[
        Count,
        Field(
            description="Index of the first sample since the device began, counting lost "
            "samples too: by it each loss is noticed."
        ),
    ]
    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=4096)]
    units: Annotated[tuple[UnitName, ...], Field(min_length=1, max_length=4096)]
    samples: Annotated[
        tuple[tuple[Finite | None, ...], ...],
        Field(
            min_length=1,
            max_length=100_000,
            description="One array a sample, one number a channel; null where one is missing.",
        ),
    ]

    @model_validator(mode="after")
    def _is_a_table(self) -> "SensorSamples":
        columns = {len(row) for row in self.samples} | {len(self.units)}
        if columns != {len(self.channels)}:
            raise ValueError(
                f"{len(self.channels)} channels, {len(self.units)} units and samples of "
                f"{sorted(columns)} numbers. Give one of each per channel."
            )
        return self


class Features(Message):
    """What one epoch of samples said about frequencies, damping and shapes."""

    MESSAGE: ClassVar[str] = "features"
    VERSION: ClassVar[int] = 3

    version: Literal[3] = 3
    time_base: TimeBase = "live"
    slow_time: Finite
    slow_time_unit: UnitName = "s"
    start_ns: Nanoseconds
    method: Literal["free_decay", "ambient", "peak", "ssi", "none"]
    channels: Annotated[
        tuple[str, ...],
        Field(max_length=4096, description="Whose components the shapes hold, in order."),
    ] = ()
    units: Annotated[
        tuple[str, ...],
        Field(
            max_length=4096,
            description="Of the channels, in order, such as m/s^2; an empty text where nobody "
            "said one, and none at all where the agent does not tell units.",
        ),
    ] = ()
    modes: Annotated[
        tuple[Mode, ...], Field(max_length=64, description="Ascending in frequency.")
    ]
    quality: Quality
    covariates: Covariates = Field(default_factory=dict)
    truth: Covariates | None = None

    @model_validator(mode="after")
    def _is_ordered(self) -> "Features":
        if self.start_ns > self.t_ns:
            raise ValueError(
                f"start_ns={self.start_ns} is later than t_ns={self.t_ns}. start_ns is the "
                "first sample's time, t_ns the last's."
            )
        if len(self.modes) > 1:
            frequencies = [mode.frequency_hz.value for mode in self.modes]
            if frequencies != sorted(frequencies):
                raise ValueError(
                    f"Modes at {frequencies} Hz are not in order. Give them ascending."
                )
        return self

    @model_validator(mode="after")
    def _has_one_shape_and_name_each(self) -> "Features":
        sizes = {len(mode.shape.re) for mode in self.modes if mode.shape is not None}
        if sizes - {len(self.channels)}:
            raise ValueError(
                f"Shapes of {sorted(sizes)} components for {len(self.channels)} channels. "
                "Give one component per channel."
            )
        if len(self.units) not in (0, len(self.channels)):
            raise ValueError(
                f"{len(self.units)} units for {len(self.channels)} channels. Give one unit "
                "per channel, or none at all."
            )
        names = [mode.identity for mode in self.modes if mode.identity is not None]
        if len(set(names)) < len(names):
            raise ValueError(
                f"Identities {names} name more than one mode alike. Give each its own, or null."
            )
        return self
