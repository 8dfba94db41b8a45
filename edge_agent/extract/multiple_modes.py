"""Reads all modes of one window, and tracks each through the windows.

Modes are identified from all channels together and handed to a tracker, which says which of
them are modes of the windows before. A window that could not be read is no evidence that a mode
has gone; it only leaves more time for the modes to have moved.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from edge_agent.settings import ExtractSettings
from slowtime.identification import modes as identified
from slowtime.identification.automatic.estimation import identify_modes
from slowtime.identification.tracking import ModeTracker, Tracks
from slowtime.signals.block import RateCorrection
from slowtime_schemas.messages import Mode, Shape, Smoothed

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

DIGITS = 7
"""Of a shape's components after the point: below what any record tells of them."""

MOST = 64
"""Modes of all kinds that a message holds."""


@dataclasses.dataclass(frozen=True, slots=True)
class MultiModeReader:
    """Read every mode, and follow each through the windows."""

    settings: ExtractSettings

    def step(self, memory: Memory, window: Window) -> tuple[Memory, ModeReading]:
        """Read a window; one without modes still ages the tracked modes."""
        given = self.settings
        if len(window.channels) > given.max_channels:
            return memory, ModeReading(why=("too_many_channels",))
        result = identify_modes(
            window.rows,
            window.rate_hz,
            band_hz=given.band_hz,
            order=given.order,
            most=given.most,
        )
        return self.told(memory, window, result.modes)

    def told(
        self, memory: Memory, window: Window, result: Sequence[identified.Mode]
    ) -> tuple[Memory, ModeReading]:
        """Assign identities to modes, and convert them to the message's form."""
        given = self.settings
        found = _that_travel(result)
        memory, identities = self._followed(memory, window, found)
        modes = []
        for mode, identity in zip(found, identities, strict=True):
            smoothed = None
            if identity is not None:
                memory, smoothed = smooth(
                    memory, identity, mode.frequency_hz, given, window.clock
                )
            modes.append(_message(mode, identity, smoothed, window.clock))
        if not modes:
            why = ("not_credible",) if result else ("no_mode",)
            return memory, ModeReading(channels=window.channels, why=why)
        doubted = doubts((mode.frequency_hz for mode in found), window.clock)
        return memory, ModeReading(tuple(modes), "ssi", window.channels, doubts=doubted)

    def _followed(
        self, memory: Memory, window: Window, found: list[identified.Mode]
    ) -> tuple[Memory, tuple[int | None, ...]]:
        """Assign to each mode the identity it had before, if any."""
        given, tracks = self.settings.tracking, memory.tracks
        if window.channels != memory.channels:
            # Shapes over other channels cannot be compared; names are never given twice.
            tracks = Tracks(next_identity=tracks.next_identity)
        elapsed = 1.0
        if memory.position is not None and window.position >= memory.position:
            elapsed = window.position - memory.position
        tracker = ModeTracker(
            confirm=given.confirm,
            quiet=given.quiet,
            patience=given.patience,
            false_modes=given.false_modes,
            most=given.most,
        )
        known = [
            dataclasses.replace(mode, frequency_hz=with_clock(mode.frequency_hz, window.clock))
            for mode in found
        ]
        tracks, tracked = tracker.step(tracks, known, elapsed=elapsed)
        alive = tracks.identities
        return dataclasses.replace(
            memory,
            tracks=tracks,
            channels=window.channels,
            position=window.position,
            smoothers=tuple((name, kept) for name, kept in memory.smoothers if name in alive),
        ), tracked.identities


def _that_travel(modes: Sequence[identified.Mode]) -> list[identified.Mode]:
    """Keep modes that a message holds, ascending; where too many, lines of machines go."""
    sound = [mode for mode in modes if _may_travel(mode)]
    sound.sort(key=lambda mode: mode.kind == "harmonic")
    return sorted(sound[:MOST], key=lambda mode: mode.frequency_hz.value)


def _may_travel(mode: identified.Mode) -> bool:
    """Whether every number is finite, and the mode moves at least one channel."""
    numbers = np.concatenate([mode.shape.real, mode.shape.imag, mode.shape_sd])
    return (
        is_sound(mode.frequency_hz, mode.damping_ratio, mode.correlation)
        and bool(np.isfinite(numbers).all())
        and bool((mode.shape_sd >= 0).all())
        and abs(float(np.linalg.norm(mode.shape)) - 1.0) < 1e-6
    )


def _message(
    mode: identified.Mode,
    identity: int | None,
    smoothed: Smoothed | None,
    clock: RateCorrection | None,
) -> Mode:
    frequency = with_clock(mode.frequency_hz, clock)
    return Mode(
        frequency_hz=quantity(frequency),
        damping_ratio=quantity(mode.damping_ratio),
        correlation=rescaled(mode.correlation, mode.frequency_hz, frequency),
        smoothed_frequency_hz=smoothed,
        flags=mode.flags,
        identity=identity,
        kind=mode.kind,
        shape=Shape(
            re=_rounded(mode.shape.real),
            im=_rounded(mode.shape.imag),
            sd=_rounded(_message_sd(mode.shape_sd)),
        ),
    )


def _message_sd(sd: Float[np.ndarray, " channel"]) -> Float[np.ndarray, " channel"]:
    """Return standard deviations, at least those of rounding; 0 for one channel."""
    return np.asarray(np.where(sd > 0, np.maximum(sd, 10.0**-DIGITS), 0.0))


def _rounded(values: Float[np.ndarray, " channel"]) -> tuple[float, ...]:
    return tuple((values.round(DIGITS) + 0.0).tolist())
