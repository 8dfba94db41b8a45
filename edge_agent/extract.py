"""Third stage of the edge: conditioned blocks in, features messages out, one for each window.

A window is an epoch, or a stretch of `window_s` of a continuous stream. Each window gives one
message: where nothing could be identified it has no modes and a flag that says why.
"""

import dataclasses
import logging
import math

import numpy as np
from jaxtyping import Float, Int

from slowtime.identification.identified import Identified
from slowtime.identification.windows import Tracker, TrackerState
from slowtime.signals.block import Block
from slowtime.signals.smoothing import MedianEwma, SmootherState
from slowtime_schemas.messages import Features, Mode, Quality, Smoothed
from slowtime_schemas.quantities import Quantity
from slowtime_services.files import accelerations, find_column

from .settings import ExtractSettings, Origin

logger = logging.getLogger(__name__)

Rows = Float[np.ndarray, "time channel"]
Marks = Int[np.ndarray, "time 2"]
Part = tuple[Float[np.ndarray, "_ channel"], Int[np.ndarray, "_ 2"]]


@dataclasses.dataclass(frozen=True, slots=True)
class Stretch:
    """Rows that follow each other without a break."""

    first_index: int
    start_ns: int
    parts: tuple[Part, ...]
    count: int

    @property
    def next_index(self) -> int:
        """Index of the sample after the last one."""
        return self.first_index + self.count

    def joined(self) -> tuple[Rows, Marks]:
        """All rows and marks in one piece; parts are only joined once a window is whole."""
        rows, marks = zip(*self.parts, strict=True)
        return np.concatenate(rows), np.concatenate(marks)


@dataclasses.dataclass(frozen=True, slots=True)
class Gathered:
    """What has come of a window so far."""

    latest: Block
    stretches: tuple[Stretch, ...]
    windows: int = 0
    """How many windows the stretch has given already."""
    skip: int = 0
    """Rows of the stretch before the next window."""


@dataclasses.dataclass(frozen=True, slots=True)
class ExtractState:
    """What the stage remembers: where it is in its count, its smoother, and a window begun."""

    sequence: int = 0
    tracker: TrackerState = dataclasses.field(default_factory=TrackerState)
    smoother: SmootherState = dataclasses.field(default_factory=SmootherState)
    gathered: Gathered | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Extract:
    """Gather windows and read the first mode out of each."""

    settings: ExtractSettings
    origin: Origin

    def start(self) -> ExtractState:
        """Begin with nothing seen."""
        return ExtractState()

    def step(
        self, state: ExtractState, block: Block, marks: Marks
    ) -> tuple[ExtractState, tuple[Features, ...]]:
        """Take a conditioned block; give the features of the windows it completes."""
        out: tuple[Features, ...] = ()
        if state.gathered is not None and not _belongs(block, state.gathered):
            state, out = self.finish(state)
        gathered = _gather(state.gathered, block, marks, self.settings.max_samples)
        state = dataclasses.replace(state, gathered=gathered)
        if block.epoch is None:
            state, slid = self._slide(state)
            out += slid
        return state, out

    def finish(self, state: ExtractState) -> tuple[ExtractState, tuple[Features, ...]]:
        """Close the window that was begun: its epoch is complete, or the stream has ended.

        What is left of a continuous stream gives a message only if no whole window came before
        it, so that a stream shorter than a window is not passed over in silence.
        """
        gathered = state.gathered
        if gathered is None:
            return state, ()
        closed = dataclasses.replace(state, gathered=None)
        if gathered.latest.epoch is None and gathered.windows:
            return closed, ()
        longest = max(gathered.stretches, key=lambda stretch: stretch.count)
        present = sum(stretch.count for stretch in gathered.stretches)
        lost = gathered.stretches[-1].next_index - gathered.stretches[0].first_index - present
        flags: tuple[str, ...] = ("gap",) if len(gathered.stretches) > 1 else ()
        if gathered.latest.epoch is None:
            flags += ("short_window",)
        closed, message = self._read(closed, gathered.latest, longest, lost, flags)
        return closed, (message,)

    def _slide(self, state: ExtractState) -> tuple[ExtractState, tuple[Features, ...]]:
        """Read all whole windows that a continuous stream holds by now."""
        gathered = state.gathered
        assert gathered is not None
        rate = gathered.latest.rate_hz
        length = max(1, round(self.settings.window_s * rate))
        hop = max(1, round((self.settings.hop_s or self.settings.window_s) * rate))
        stretch, windows, out = gathered.stretches[-1], gathered.windows, []
        skip = gathered.skip
        while stretch.count >= skip + length:
            stretch, skip = _between(stretch, skip, stretch.count, rate), 0
            window = _between(stretch, 0, length, rate)
            state, message = self._read(state, gathered.latest, window, 0, ())
            out.append(message)
            windows, skip = windows + 1, hop
        left = Gathered(gathered.latest, (stretch,), windows, skip)
        return dataclasses.replace(state, gathered=left), tuple(out)

    def _read(
        self,
        state: ExtractState,
        block: Block,
        window: Stretch,
        lost: int,
        flags: tuple[str, ...],
    ) -> tuple[ExtractState, Features]:
        """Make the one message of a window."""
        rate, count = block.rate_hz, window.count
        rows, marks = window.joined()
        missing = int(marks[:, 0].sum()) + lost
        state, mode, why = self._identify(state, rows, block, missing)
        state, smoothed = self._smooth(state, mode)
        last_ns = window.start_ns + round((count - 1) * 1e9 / rate)
        slow_time = block.slow_time
        if slow_time is None:
            slow_time = (window.start_ns + last_ns) / 2e9
        message = Features(
            **self.origin.model_dump(),
            sequence=state.sequence,
            t_ns=last_ns,
            slow_time=slow_time,
            start_ns=window.start_ns,
            method=mode.method if mode else "none",
            modes=(_as_mode(mode, smoothed),) if mode else (),
            quality=Quality(
                samples=count,
                missing=missing,
                outliers=int(marks[:, 1].sum()),
                flags=flags + why,
            ),
            covariates=dict(block.covariates),
            truth=dict(block.truth) or None,
        )
        return dataclasses.replace(state, sequence=state.sequence + 1), message

    def _identify(
        self, state: ExtractState, rows: Rows, block: Block, missing: int
    ) -> tuple[ExtractState, Identified | None, tuple[str, ...]]:
        """First mode of a window, or a word on why there is none."""
        given = self.settings
        if len(rows) < given.min_samples:
            return state, None, ("too_short",)
        if missing > given.max_missing * (len(rows) + missing):
            return state, None, ("too_much_missing",)
        chosen = given.channels or accelerations(block.channels, block.units)
        rows = rows[:, [find_column(name, block.channels) for name in chosen]]
        tracker = Tracker(
            rate_hz=block.rate_hz,
            band_hz=given.band_hz,
            method=given.method,
            follow=given.follow,
        )
        try:
            tracked, found = tracker.step(state.tracker, rows)
        except ValueError as error:
            logger.info("A window from %d ns was not read: %s", block.start_ns, error)
            return state, None, ("not_usable",)
        except Exception:
            logger.exception("Identification failed on a window from %d ns.", block.start_ns)
            return state, None, ("failed",)
        if found is None:
            return state, None, ("no_mode",)
        if not _is_sound(found):
            return state, None, ("not_credible",)
        return dataclasses.replace(state, tracker=tracked), found, ()

    def _smooth(
        self, state: ExtractState, mode: Identified | None
    ) -> tuple[ExtractState, Smoothed | None]:
        """Advance the median → EWMA of the frequency; windows without a mode do not count."""
        if mode is None or not self.settings.smooth:
            return state, None
        smoother = MedianEwma(window=self.settings.median_window, a=self.settings.ewma_a)
        after, smooth = smoother.step(
            state.smoother, mode.frequency_hz.value, mode.frequency_hz.sd
        )
        told = Smoothed(value=smooth.value, sd=smooth.sd, lag_epochs=smooth.lag)
        return dataclasses.replace(state, smoother=after), told


def _belongs(block: Block, gathered: Gathered) -> bool:
    """Whether a block goes on with the window that was begun."""
    latest = gathered.latest
    same = (
        block.epoch == latest.epoch
        and block.rate_hz == latest.rate_hz
        and block.channels == latest.channels
    )
    return same and (
        block.epoch is not None or block.first_index == gathered.stretches[-1].next_index
    )


def _gather(
    gathered: Gathered | None, block: Block, marks: Marks, max_samples: int
) -> Gathered:
    rows = np.asarray(block.samples, dtype=float)
    fresh = Stretch(block.first_index, block.start_ns, ((rows, marks),), len(rows))
    if gathered is None:
        return Gathered(block, (fresh,))
    *before, last = gathered.stretches
    held = sum(stretch.count for stretch in gathered.stretches)
    if block.epoch is not None and held + fresh.count > max_samples:
        return gathered
    if fresh.first_index != last.next_index:
        return dataclasses.replace(gathered, latest=block, stretches=(*before, last, fresh))
    joined = dataclasses.replace(
        last, parts=last.parts + fresh.parts, count=last.count + fresh.count
    )
    return dataclasses.replace(gathered, latest=block, stretches=(*before, joined))


def _between(stretch: Stretch, first: int, last: int, rate_hz: float) -> Stretch:
    """Rows `first` to `last` of a stretch, as one that begins there."""
    rows, marks = stretch.joined()
    return Stretch(
        stretch.first_index + first,
        stretch.start_ns + round(first * 1e9 / rate_hz),
        ((rows[first:last], marks[first:last]),),
        last - first,
    )


def _is_sound(found: Identified) -> bool:
    """Whether every number may travel: finite, the errors not negative."""
    values = (found.frequency_hz.value, found.damping_ratio.value, found.correlation)
    errors = (found.frequency_hz.sd, found.damping_ratio.sd)
    return (
        all(map(math.isfinite, values + errors))
        and found.frequency_hz.value > 0
        and min(errors) >= 0
    )


def _as_mode(found: Identified, smoothed: Smoothed | None) -> Mode:
    snr = found.snr_db
    return Mode(
        frequency_hz=Quantity(value=found.frequency_hz.value, sd=found.frequency_hz.sd),
        damping_ratio=Quantity(value=found.damping_ratio.value, sd=found.damping_ratio.sd),
        correlation=min(max(found.correlation, -1.0), 1.0),
        smoothed_frequency_hz=smoothed,
        snr_db=snr if snr is not None and math.isfinite(snr) else None,
        flags=found.flags,
    )
