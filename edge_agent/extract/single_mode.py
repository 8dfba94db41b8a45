"""Reads the lowest clear mode from one window."""

import dataclasses
import math

from edge_agent.settings import ExtractSettings
from slowtime.identification.options import OneByOne
from slowtime.identification.single_mode.sliding_windows import Tracker
from slowtime_schemas.messages import Mode

from .reader import (
    Memory,
    ModeReading,
    Window,
    doubts,
    is_sound,
    quantity,
    rescaled,
    smooth,
    with_clock,
)


@dataclasses.dataclass(frozen=True, slots=True)
class SingleModeReader:
    """Read the lowest clear mode, from all channels together."""

    settings: ExtractSettings
    method: OneByOne

    def step(self, memory: Memory, window: Window) -> tuple[Memory, ModeReading]:
        """Read a window; one without a clear mode leaves the memory as it is."""
        tracker = Tracker(
            rate_hz=window.rate_hz,
            band_hz=self.settings.band_hz,
            method=self.method,
            follow=self.settings.follow,
        )
        tracked, found = tracker.step(memory.first, window.rows)
        if found is None:
            return memory, ModeReading(why=("no_mode",))
        if not is_sound(found.frequency_hz, found.damping_ratio, found.correlation):
            return memory, ModeReading(why=("not_credible",))
        if found.method == "free_decay":
            # Imported here, for few windows hold a decay.
            from slowtime.identification.free_decay.along_decay import along_decay

            found, _ = along_decay(found, window.rows, window.rate_hz)
        own, clock = found.frequency_hz, window.clock
        memory = dataclasses.replace(memory, first=tracked)
        memory, smoothed = smooth(memory, 0, own, self.settings, clock)
        snr, frequency = found.snr_db, with_clock(own, clock)
        mode = Mode(
            frequency_hz=quantity(frequency),
            damping_ratio=quantity(found.damping_ratio),
            correlation=rescaled(found.correlation, own, frequency),
            smoothed_frequency_hz=smoothed,
            snr_db=snr if snr is not None and math.isfinite(snr) else None,
            flags=found.flags,
        )
        return memory, ModeReading((mode,), method=found.method, doubts=doubts((own,), clock))
