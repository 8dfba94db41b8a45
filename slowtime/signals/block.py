"""Blocks of samples: the unit in which samples travel through a pipeline."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class RateCorrection:
    """How far a device's sampling rate is from the nominal one.

    Parameters
    ----------
    relative
        The true rate is the nominal one times one plus this.
    sd
        Standard deviation of `relative`: one error, common to all samples.
    """

    relative: float
    sd: float

    def __post_init__(self) -> None:
        """Refuse what no rate could be corrected by."""
        if not (-1 < self.relative < np.inf and 0 <= self.sd < np.inf):
            raise ValueError(
                f"relative={self.relative}, sd={self.sd}: allowed are a relative correction "
                "above -1 and a standard deviation of 0 or more. Give 1e-4 for 100 ppm."
            )


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Consecutive samples of all channels of one acquisition, and where they belong in time.

    Blocks of one stream follow each other without a gap when
    ``block.first_index + len(block.samples)`` is the next block's ``first_index``; anything
    else is a gap, or a new epoch.

    Parameters
    ----------
    samples
        One row per instant, one column per channel, in the unit of ``units``.
    rate_hz
        Samples per second.
    first_index
        Index of the first row since the stream began, counting missing samples too.
    start_ns
        Sensor time of the first row, in nanoseconds since 1970-01-01 UTC.
    channels, units
        Name and unit of each column, such as ``("deck_z",)`` and ``("m/s^2",)``.
    epoch
        Number of the intermittent record that the block belongs to, counted from 0; None
        for a continuous stream.
    slow_time
        Slow time t_s of the epoch, in the stream's own unit; None for a continuous stream,
        whose slow time is its sensor time.
    covariates
        What else was known when the samples were taken, such as ``{"temperature_c": 11.5}``.
    truth
        What a simulator knows and a sensor does not, such as ``{"stiffness_change": -0.1}``.
        It is carried to the page and to tests; no estimate reads it.
    clock
        What is known of the true sampling rate, as of this block; None where `rate_hz` is
        taken at its word. Indices, windows and filters count in `rate_hz` all the same.
    """

    samples: Float[np.ndarray, "time channel"] | Int[np.ndarray, "time channel"]
    rate_hz: float
    first_index: int
    start_ns: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    epoch: int | None = None
    slow_time: float | None = None
    covariates: Mapping[str, float] = dataclasses.field(default_factory=dict)
    truth: Mapping[str, float] = dataclasses.field(default_factory=dict)
    clock: RateCorrection | None = None

    def __post_init__(self) -> None:
        """Refuse a block whose parts contradict each other."""
        columns = self.samples.shape[1]
        if len(self.channels) != columns or len(self.units) != columns:
            raise ValueError(
                f"A block of {columns} columns was given {len(self.channels)} channel names "
                f"and {len(self.units)} units. Give one of each per column."
            )
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(
                f"rate_hz={self.rate_hz} is not a sampling rate. Give samples per second, "
                "a positive number."
            )

    @property
    def next_index(self) -> int:
        """Index of the sample after the last one."""
        return self.first_index + len(self.samples)

    @property
    def true_rate_hz(self) -> float:
        """Samples per second, corrected where the clock is known better than its promise."""
        if self.clock is None:
            return self.rate_hz
        return self.rate_hz * (1.0 + self.clock.relative)

    @property
    def end_ns(self) -> int:
        """Sensor time of the instant after the last sample [ns]."""
        return self.start_ns + round(len(self.samples) * 1e9 / self.true_rate_hz)

    def follows(self, other: "Block") -> bool:
        """Whether this block continues `other` with nothing missing between them."""
        return (
            self.first_index == other.next_index
            and self.epoch == other.epoch
            and self.rate_hz == other.rate_hz
            and self.channels == other.channels
        )
