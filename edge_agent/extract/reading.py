"""What the two ways of reading a window share: what goes in, what comes out, what is kept."""

import dataclasses
import math
from typing import Protocol, runtime_checkable

from edge_agent.settings import ExtractSettings
from slowtime.identification.identified import Measured
from slowtime.identification.tracking import Tracks
from slowtime.identification.windows import TrackerState
from slowtime.signals.smoothing import MedianEwma, SmootherState
from slowtime_schemas.messages import Mode, Smoothed
from slowtime_schemas.quantities import Quantity

from .windows import Rows


@dataclasses.dataclass(frozen=True, slots=True)
class Window:
    """Rows of the channels to identify from.

    Parameters
    ----------
    position
        Where the window is among the others, counted in usual distances between them.
    """

    rows: Rows
    rate_hz: float
    channels: tuple[str, ...]
    position: float


@dataclasses.dataclass(frozen=True, slots=True)
class Reading:
    """What a window said, or a word on why it said nothing."""

    modes: tuple[Mode, ...] = ()
    method: str = "none"
    channels: tuple[str, ...] = ()
    why: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Memory:
    """What is kept of the windows read so far.

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
class Reader(Protocol):
    """Reads one window after the other."""

    def step(self, memory: Memory, window: Window) -> tuple[Memory, Reading]:
        """Read a window; ValueError where its samples are of no use."""
        ...


def smooth(
    memory: Memory, identity: int, frequency: Measured, settings: ExtractSettings
) -> tuple[Memory, Smoothed | None]:
    """Advance the median → EWMA of one frequency; windows without it do not count."""
    if not settings.smooth:
        return memory, None
    smoother = MedianEwma(window=settings.median_window, a=settings.ewma_a)
    before = dict(memory.smoothers)
    state = before.get(identity) or smoother.start()
    after, found = smoother.step(state, frequency.value, frequency.sd)
    kept = tuple((before | {identity: after}).items())
    told = Smoothed(value=found.value, sd=found.sd, lag_epochs=found.lag)
    return dataclasses.replace(memory, smoothers=kept), told


def is_sound(frequency: Measured, damping: Measured, correlation: float) -> bool:
    """Whether every number may travel: finite, the errors not negative."""
    values = (frequency.value, damping.value, correlation)
    errors = (frequency.sd, damping.sd)
    return all(map(math.isfinite, values + errors)) and frequency.value > 0 and min(errors) >= 0


def quantity(measured: Measured) -> Quantity:
    """`measured` as it travels."""
    return Quantity(value=measured.value, sd=measured.sd)
