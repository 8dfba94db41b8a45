"""Fatigue sums and virtual quantities."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from slowtime_schemas.quantities import (
    BelievedRate,
    Count,
    Finite,
    Flags,
    Frozen,
    Nanoseconds,
    PlainText,
    Sd,
    UnitName,
)

from .base import Message, TimeBase


class CurveOfMessage(Frozen):
    """A median S-N curve in ranges: life = constant × range^(-slope), or two slopes."""

    constant: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    slope: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    knee: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    lower_slope: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    cut_off: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    log10_sd: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0


NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

BINS = range(-16 * 1074, 16 * 1024)
"""Bins whose range of stress, from 2^(k/16) on, is a floating-point number (IEEE 754)."""


class FatiguePoint(Frozen):
    """Fatigue at one point since the boot began: sums, of which the newest counts."""

    name: PlainText
    unit: UnitName
    source: Literal["channel", "virtual"] = "channel"
    bins: Annotated[
        tuple[int, ...],
        Field(
            max_length=4096,
            description="Number k of each bin of stress ranges, ascending: from 2^(k/16) to "
            "2^((k+1)/16) in the unit.",
        ),
    ] = ()
    half_cycles: Annotated[
        tuple[Count, ...],
        Field(max_length=4096, description="Half cycles counted in each bin."),
    ] = ()
    damage: Annotated[
        NotNegative,
        Field(description="Miner's sum by the median curve [1], open half cycles included."),
    ]
    closed_damage: Annotated[
        NotNegative, Field(description="Of it, what cycles have done that are closed [1].")
    ]
    ln_sd: Annotated[
        NotNegative, Field(description="Standard deviation of the logarithm of the sum [1].")
    ]
    slope: Annotated[NotNegative, Field(description="Slope of the curve that weighs [1].")]
    curve: CurveOfMessage
    seconds: Annotated[NotNegative, Field(description="How long stress was counted [s].")]
    skipped: Annotated[Count, Field(description="Samples that were not finite.")] = 0
    reasons: Flags = ()

    @model_validator(mode="after")
    def _is_one_histogram(self) -> "FatiguePoint":
        if len(self.bins) != len(self.half_cycles) or list(self.bins) != sorted(set(self.bins)):
            raise ValueError(
                f"{len(self.bins)} bins and {len(self.half_cycles)} counts. Give one count for "
                "each bin, bins ascending."
            )
        if self.bins and not (self.bins[0] in BINS and self.bins[-1] in BINS):
            raise ValueError(
                f"Bins {self.bins[0]!r:.20} to {self.bins[-1]!r:.20} were given. Allowed: "
                f"{BINS[0]} to {BINS[-1]}, whose stresses are numbers."
            )
        return self


class Fatigue(Message):
    """Fatigue at all points of an asset, as of `t_ns`, since the boot began."""

    MESSAGE: ClassVar[str] = "fatigue"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    start_ns: Annotated[Nanoseconds, Field(description="Sensor time of the first sample.")]
    points: Annotated[tuple[FatiguePoint, ...], Field(min_length=1, max_length=256)]

    @model_validator(mode="after")
    def _names_differ(self) -> "Fatigue":
        names = [point.name for point in self.points]
        if len(set(names)) < len(names):
            raise ValueError(f"Points {names} are not told apart. Give each its own name.")
        return self


class VirtualQuantity(Frozen):
    """A quantity that nobody measures, over the time of its message."""

    name: PlainText
    unit: UnitName
    values: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=10_000)]
    sd: Annotated[
        tuple[Sd, ...],
        Field(min_length=1, max_length=10_000, description="Of the error of each value."),
    ]

    @model_validator(mode="after")
    def _has_deviations(self) -> "VirtualQuantity":
        if len(self.values) != len(self.sd):
            raise ValueError(
                f"{self.name}: {len(self.values)} values and {len(self.sd)} deviations. "
                "Give one of each."
            )
        return self


class Virtual(Message):
    """What virtual sensors estimate of one window: dynamic parts, within a band."""

    MESSAGE: ClassVar[str] = "virtual"
    VERSION: ClassVar[int] = 1

    version: Literal[1] = 1
    time_base: TimeBase = "live"
    start_ns: Nanoseconds
    rate_hz: Annotated[
        float, Field(gt=0, allow_inf_nan=False, description="Of the values."), BelievedRate
    ]
    lowest_hz: Annotated[
        NotNegative,
        Field(description="Slower motion is not in the values: accelerations do not show it."),
    ]
    valid: bool
    reasons: Flags = ()
    quantities: Annotated[tuple[VirtualQuantity, ...], Field(min_length=1, max_length=64)]
