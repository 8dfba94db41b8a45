"""Admits blocks that continue the stream, or that replace it for good."""

import dataclasses

import numpy as np

from edge_agent.settings import BlockAdmissionSettings
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase

ADOPT_AFTER = 10
"""So many refused blocks in a row that agree with each other are a stream that has changed [1].
Source: judgement; no study is recorded."""


@dataclasses.dataclass(frozen=True, slots=True)
class AdmissionState:
    """Last block that was let in, and those that were refused since and agree."""

    last: Block | None = None
    suspect: Block | None = None
    agreeing: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class Refusal:
    """Why a block was refused: a word to count by, and a sentence."""

    word: str
    sentence: str


@dataclasses.dataclass(frozen=True, slots=True)
class Admission:
    """Admits blocks that continue the stream; refuses others with a reason.

    A sensor may also have changed for good, after a restart say. So `ADOPT_AFTER` refused
    blocks in a row that continue each other are taken for the stream from then on.
    """

    settings: BlockAdmissionSettings
    time_base: TimeBase = "live"

    def start(self) -> AdmissionState:
        """Begin with any stream welcome."""
        return AdmissionState()

    def step(
        self, state: AdmissionState, block: Block, now_ns: int
    ) -> tuple[AdmissionState, Refusal | None]:
        """Check one block; None if it is admitted."""
        unfit = self._unfit(block, now_ns)
        if unfit is not None:
            return state, unfit
        if state.last is None or (refusal := self._contradicts(block, state.last)) is None:
            return AdmissionState(last=_without_samples(block)), None
        agrees = state.suspect is not None and not self._contradicts(block, state.suspect)
        agreeing = state.agreeing + 1 if agrees else 1
        if agreeing >= ADOPT_AFTER:
            return AdmissionState(last=_without_samples(block)), None
        return AdmissionState(state.last, _without_samples(block), agreeing), refusal

    def _unfit(self, block: Block, now_ns: int) -> Refusal | None:
        """Why no stream could hold this block."""
        if block.samples.size == 0:
            return Refusal("empty", "It has no samples.")
        if not np.isfinite(block.samples).any():
            return Refusal("not_finite", "None of its samples is finite. Check the sensor.")
        ahead_s = (block.start_ns - now_ns) / 1e9
        if self.time_base == "live" and ahead_s > self.settings.max_ahead_s:
            return Refusal(
                "future",
                f"Its time is {ahead_s:.0f} s ahead of ours; {self.settings.max_ahead_s:g} s "
                "are allowed. Set the sensor's clock, or raise admission.max_ahead_s.",
            )
        behind = self.settings.max_behind_s
        if self.time_base == "live" and behind is not None and -ahead_s > behind:
            return Refusal(
                "stale",
                f"Its time is {-ahead_s:.0f} s behind ours; {behind:g} s are allowed. Set the "
                "sensor's clock, or raise admission.max_behind_s.",
            )
        return None

    def _contradicts(self, block: Block, last: Block) -> Refusal | None:
        """Why this block cannot come after `last`."""
        for word, ours, given in (
            ("wrong_rate", last.rate_hz, block.rate_hz),
            ("wrong_channels", last.channels, block.channels),
            ("wrong_units", last.units, block.units),
            ("wrong_type", last.samples.dtype.str, block.samples.dtype.str),
        ):
            if ours != given:
                return Refusal(word, f"{given!r} was given in a stream of {ours!r}.")
        if block.first_index < last.next_index:
            return Refusal(
                "backwards",
                f"It begins at sample {block.first_index}, the stream is already at "
                f"{last.next_index}: a block twice, or out of order.",
            )
        return self._jumps(block, last)

    def _jumps(self, block: Block, last: Block) -> Refusal | None:
        lost = block.first_index - last.next_index
        expected = last.end_ns + round(lost * 1e9 / block.true_rate_hz)
        late_s = (block.start_ns - expected) / 1e9
        tolerance = self.settings.clock_tolerance_s
        if block.epoch != last.epoch:
            jumped = block.start_ns < last.end_ns - tolerance * 1e9
        else:
            jumped = abs(late_s) > tolerance
        if not jumped:
            return None
        return Refusal(
            "clock_jump",
            f"Its time is {late_s:+.3f} s from what the samples before it say; "
            f"{tolerance:g} s are allowed. Let the sensor's clock run steadily.",
        )


def _without_samples(block: Block) -> Block:
    """Only the extent of a block, so that the state does not keep its samples alive."""
    shape, kind = block.samples.shape, block.samples.dtype
    empty = np.broadcast_to(np.zeros((), kind), shape)
    return dataclasses.replace(block, samples=empty)
