"""Identifies the modes of a stream recursively, one message each hop.

Nothing is gathered: products and spectral matrices of the stream so far are kept, and fade with
age, so that neither memory nor the work of a second grows. Successive messages share most of
what they were made of.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from edge_agent.settings import ExtractSettings
from slowtime.identification.estimates import Measured
from slowtime.identification.modes import Mode
from slowtime.identification.recursive import RecursiveModes, RecursiveState
from slowtime.signals.block import Block

from .windows import Marks, Rows

LOWEST_SHARE = 1e-3
"""Share of the rate from which on modes are looked for, where the settings do not say: what is
lower would cost memory and delay, 70 and 35 of its cycles."""

HIGHEST_SHARE = 0.45
"""... and up to which."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Hop:
    """Samples since the last message.

    Parameters
    ----------
    first_ns
        When the first of it was taken [ns].
    count, missing, outliers
        Samples, those that were lost or filled in, and those that were taken for outliers.
    sums
        Of each channel.
    """

    first_ns: int
    count: int
    missing: int
    outliers: int
    sums: Float[np.ndarray, " channel"]

    def means(self) -> Float[np.ndarray, "1 channel"]:
        """Mean of each channel, as the row of a window of one instant."""
        return np.asarray(self.sums / max(self.count, 1))[None]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class StreamState:
    """State of the recursive identification of a stream.

    Parameters
    ----------
    latest
        Last block.
    index
        Of the next sample, lost ones counted, since the stream began.
    since_ns
        When the stream began [ns].
    modes
        As last told by the state.
    hop
        What has come since the last message; None right after one.
    """

    latest: Block
    index: int
    since_ns: int
    state: RecursiveState
    modes: tuple[Mode, ...] = ()
    hop: Hop | None = None

    @property
    def true_modes(self) -> tuple[Mode, ...]:
        """The modes at the true rate, whose error falls the longer a clock is observed."""
        true = self.latest.true_rate_hz / self.latest.rate_hz
        return tuple(
            dataclasses.replace(
                mode,
                frequency_hz=Measured(
                    mode.frequency_hz.value * true, mode.frequency_hz.sd * true
                ),
            )
            for mode in self.modes
        )

    @property
    def is_due(self) -> bool:
        """Whether anything has come since the last message."""
        return self.hop is not None and self.hop.count > 0


def identifier(settings: ExtractSettings, rate_hz: float) -> RecursiveModes:
    """Recursive identification as the settings ask for it, at a rate [Hz]; without samples."""
    low, high = LOWEST_SHARE * rate_hz, HIGHEST_SHARE * rate_hz
    band = settings.band_hz or (max(low, settings.lowest_remembered_hz), high)
    return RecursiveModes(
        rate_hz=rate_hz, band_hz=band, memory_s=settings.memory_s, every_s=settings.every_s
    )


def continues(block: Block, stream: StreamState) -> bool:
    """Whether a block is of the same channels at the same rate, and later."""
    latest = stream.latest
    return (
        block.rate_hz == latest.rate_hz
        and block.channels == latest.channels
        and block.start_ns >= latest.start_ns
    )


def taken_in(
    stream: StreamState | None,
    block: Block,
    marks: Marks,
    columns: list[int],
    settings: ExtractSettings,
) -> StreamState:
    """Take a block into a stream, or begin one with it."""
    recursive = identifier(settings, block.rate_hz)
    lost = 0
    if stream is None:
        stream = StreamState(block, 0, block.start_ns, recursive.start())
    else:
        latest = stream.latest
        if block.epoch == latest.epoch:
            lost = max(0, block.first_index - latest.next_index)
        elif block.epoch is not None:
            lost = 1  # so that nothing joins the end of an epoch to the start of the next
    rows: Rows = np.asarray(block.samples, dtype=float)
    first = stream.index + lost
    state, modes = recursive.step(stream.state, rows[:, columns], first_index=first)
    before = stream.hop or Hop(block.start_ns, 0, 0, 0, np.zeros(rows.shape[1]))
    between_epochs = block.epoch != stream.latest.epoch
    hop = Hop(
        before.first_ns,
        before.count + len(rows),
        before.missing + int(marks[:, 0].sum()) + (0 if between_epochs else lost),
        before.outliers + int(marks[:, 1].sum()),
        before.sums + rows.sum(axis=0),
    )
    return StreamState(block, first + len(rows), stream.since_ns, state, modes, hop)


def is_whole(stream: StreamState, settings: ExtractSettings) -> bool:
    """Whether a hop is over, so that a message is due."""
    hop = stream.hop
    return hop is not None and hop.count >= round(settings.every_s * stream.latest.rate_hz)
