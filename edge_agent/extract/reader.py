"""The window, reading and memory that all readers of windows share."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Protocol, runtime_checkable

from edge_agent.settings import ExtractSettings
from slowtime.identification.estimates import Measured
from slowtime.identification.single_mode.sliding_windows import TrackerState
from slowtime.identification.tracking import Tracks
from slowtime.signals.block import RateCorrection
from slowtime.signals.smoothing import MedianEwma, SmootherState
from slowtime_schemas.messages import Mode, Smoothed
from slowtime_schemas.quantities import Quantity

from .windows import Rows


@dataclasses.dataclass(frozen=True, slots=True)
class Window:
    """Rows of the channels to identify from.

    Parameters
    ----------
    rate_hz
        True samples per second, as far as they are known.
    position
        Where the window is among the others, counted in usual distances between them.
    clock
        By what `rate_hz` was corrected; None where it is the nominal one.
    """

    rows: Rows
    rate_hz: float
    channels: tuple[str, ...]
    position: float
    clock: RateCorrection | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class ModeReading:
    """The modes of a window, the reasons where there are none, and flags of doubt."""

    modes: tuple[Mode, ...] = ()
    method: str = "none"
    channels: tuple[str, ...] = ()
    why: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Memory:
    """Memory of the windows read so far.

    Parameters
    ----------
    first
        The last clear first mode, for who follows it.
    tracks
        Modes followed, each by its identity.
    channels, position
        Of the last window whose modes were followed.
    smoothers
        Of each frequency that is smoothed, by identity; 0 for a first mode.
    """

    first: TrackerState = dataclasses.field(default_factory=TrackerState)
    tracks: Tracks = dataclasses.field(default_factory=Tracks)
    channels: tuple[str, ...] = ()
    position: float | None = None
    smoothers: tuple[tuple[int, SmootherState], ...] = ()


@runtime_checkable
class WindowReader(Protocol):
    """Reads one window after the other."""

    def step(self, memory: Memory, window: Window) -> tuple[Memory, ModeReading]:
        """Read a window; ValueError where its samples are of no use."""
        ...


def smooth(
    memory: Memory,
    identity: int,
    frequency: Measured,
    settings: ExtractSettings,
    clock: RateCorrection | None,
) -> tuple[Memory, Smoothed | None]:
    """Advance the median → EWMA of one frequency; windows without it do not count."""
    if not settings.smooth:
        return memory, None
    smoother = MedianEwma(window=settings.median_window, a=settings.ewma_a)
    before = dict(memory.smoothers)
    state = before.get(identity) or smoother.start()
    # What is averaged are frequencies by the nominal rate, so that a correction that was found
    # late counts for all windows, and its error, which they share, is not averaged away.
    true = 1.0 if clock is None else 1.0 + clock.relative
    after, found = smoother.step(state, frequency.value / true, frequency.sd / true)
    kept = tuple((before | {identity: after}).items())
    told = with_clock(Measured(found.value * true, found.sd * true), clock)
    smoothed = Smoothed(value=told.value, sd=told.sd, lag_epochs=found.lag)
    return dataclasses.replace(memory, smoothers=kept), smoothed


def with_clock(frequency: Measured, clock: RateCorrection | None) -> Measured:
    """Add the error of the clock, which scales every frequency alike, to one frequency."""
    if clock is None:
        return frequency
    return Measured(frequency.value, math.hypot(frequency.sd, clock_sd(frequency, clock)))


def clock_sd(frequency: Measured, clock: RateCorrection) -> float:
    """Error of a frequency that is due to the clock alone [Hz]."""
    return frequency.value * clock.sd / (1.0 + clock.relative)


def rescaled(correlation: float, before: Measured, after: Measured) -> float:
    """Correlation with the damping, within [-1, 1], for a frequency that is less certain."""
    if after.sd > before.sd:
        correlation *= before.sd / after.sd
    return min(max(correlation, -1.0), 1.0)


def doubts(frequencies: Iterable[Measured], clock: RateCorrection | None) -> tuple[str, ...]:
    """Flag `clock_uncertain` where the clock is most of a frequency's error."""
    if clock is None:
        return ()
    most = any(clock_sd(frequency, clock) > frequency.sd for frequency in frequencies)
    return ("clock_uncertain",) if most else ()


def is_sound(frequency: Measured, damping: Measured, correlation: float) -> bool:
    """Whether every number may travel: finite, the errors not negative."""
    values = (frequency.value, damping.value, correlation)
    errors = (frequency.sd, damping.sd)
    return all(map(math.isfinite, values + errors)) and frequency.value > 0 and min(errors) >= 0


def quantity(measured: Measured) -> Quantity:
    """`measured` as it travels."""
    return Quantity(value=measured.value, sd=measured.sd)
