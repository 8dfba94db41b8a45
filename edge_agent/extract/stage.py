"""The extract stage: gathers windows, reads each, and makes one message of it.

Where nothing could be identified a message has no modes and a flag that says why.
"""

import dataclasses
import logging

from edge_agent.settings import ExtractSettings, Origin
from slowtime.signals.block import Block
from slowtime_schemas.messages import Features

from . import recursive
from .channels import columns_of
from .message import Extent, message_of
from .multiple_modes import MultiModeReader
from .plugin import PluginIdentifier
from .reader import Memory, ModeReading, Window, WindowReader
from .single_mode import SingleModeReader
from .windows import GatheredWindow, Marks, Rows, Stretch, belongs, gather, part_of_stretch

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True, slots=True)
class ExtractState:
    """State of the stage: message count, memory of the reader, and the open window."""

    sequence: int = 0
    memory: Memory = dataclasses.field(default_factory=Memory)
    gathered: GatheredWindow | None = None
    stream: recursive.StreamState | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Extract:
    """Gather windows and read the modes out of each."""

    settings: ExtractSettings
    origin: Origin

    def start(self) -> ExtractState:
        """Begin with nothing seen."""
        return ExtractState()

    def step(
        self, state: ExtractState, block: Block, marks: Marks
    ) -> tuple[ExtractState, tuple[Features, ...]]:
        """Take a conditioned block; give the features of the windows it completes."""
        if self.settings.method == "recursive":
            return self._continue(state, block, marks)
        out: tuple[Features, ...] = ()
        if state.gathered is not None and not belongs(block, state.gathered):
            state, out = self.finish(state)
        gathered = gather(state.gathered, block, marks, self.settings.max_samples)
        state = dataclasses.replace(state, gathered=gathered)
        if block.epoch is None:
            state, slid = self._slide(state)
            out += slid
        return state, out

    def finish(self, state: ExtractState) -> tuple[ExtractState, tuple[Features, ...]]:
        """Close the open window: its epoch is complete, or the stream has ended."""
        if state.stream is not None and state.stream.is_due:
            state, message = self._tell(state, state.stream)
            return state, (message,)
        gathered = state.gathered
        if gathered is None:
            return state, ()
        closed = dataclasses.replace(state, gathered=None)
        # What is left of a continuous stream gives a message only if no whole window came
        # before it, so that a stream shorter than a window is not passed over in silence.
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
            stretch, skip = part_of_stretch(stretch, skip, stretch.count, gathered.latest), 0
            window = part_of_stretch(stretch, 0, length, gathered.latest)
            overlapping = ("overlapping",) if windows and hop < length else ()
            state, message = self._read(state, gathered.latest, window, 0, overlapping)
            out.append(message)
            windows, skip = windows + 1, hop
        left = GatheredWindow(gathered.latest, (stretch,), windows, skip)
        return dataclasses.replace(state, gathered=left), tuple(out)

    def _continue(
        self, state: ExtractState, block: Block, marks: Marks
    ) -> tuple[ExtractState, tuple[Features, ...]]:
        """Add a block to the stream; return its modes at the end of a hop."""
        out: tuple[Features, ...] = ()
        stream = state.stream
        ends = stream is not None and block.epoch != stream.latest.epoch
        if stream is not None and (ends or not recursive.continues(block, stream)):
            state, out = self.finish(state)
            stream = state.stream if recursive.continues(block, stream) else None
        columns, _ = columns_of(self.settings, block)
        stream = recursive.taken_in(stream, block, marks, columns, self.settings)
        state = dataclasses.replace(state, stream=stream)
        if block.epoch is None and recursive.is_whole(stream, self.settings):
            state, message = self._tell(state, stream)
            out += (message,)
        return state, out

    def _tell(
        self, state: ExtractState, stream: recursive.StreamState
    ) -> tuple[ExtractState, Features]:
        """Make a message of the present estimate of the modes of a stream."""
        block, hop, given = stream.latest, stream.hop, self.settings
        assert hop is not None
        _, channels = columns_of(self.settings, block)
        last_ns = block.end_ns - round(1e9 / block.true_rate_hz)
        # Samples that fade know as much as the latest two memories of them.
        start_ns = max(stream.since_ns, last_ns - round(2e9 * given.memory_s))
        window = Window(
            rows=hop.means(),
            rate_hz=block.true_rate_hz,
            channels=channels,
            position=self._position(block, last_ns),
            clock=block.clock,
        )
        memory, reading = MultiModeReader(given).told(state.memory, window, stream.true_modes)
        if len(channels) > given.max_channels:
            memory, reading = state.memory, ModeReading(why=("too_many_channels",))
        overlaps = state.sequence and start_ns < hop.first_ns
        span = Extent(
            block, window.rows, start_ns, last_ns, hop.count, hop.missing, hop.outliers,
            ("overlapping",) if overlaps else (),
        )  # fmt: skip
        message = message_of(given, self.origin, state.sequence, span, reading)
        after = dataclasses.replace(
            state,
            sequence=state.sequence + 1,
            memory=memory,
            stream=dataclasses.replace(stream, hop=None),
        )
        return after, message

    def _read(
        self,
        state: ExtractState,
        block: Block,
        window: Stretch,
        lost: int,
        flags: tuple[str, ...],
    ) -> tuple[ExtractState, Features]:
        """Make the one message of a window."""
        count = window.count
        rows, marks = window.joined()
        missing = int(marks[:, 0].sum()) + lost
        memory, reading = self._identify(state.memory, rows, block, window.start_ns, missing)
        last_ns = window.start_ns + round((count - 1) * 1e9 / block.true_rate_hz)
        outliers = int(marks[:, 1].sum())
        span = Extent(block, rows, window.start_ns, last_ns, count, missing, outliers, flags)
        message = message_of(self.settings, self.origin, state.sequence, span, reading)
        after = dataclasses.replace(state, sequence=state.sequence + 1, memory=memory)
        return after, message

    def _identify(
        self, memory: Memory, rows: Rows, block: Block, start_ns: int, missing: int
    ) -> tuple[Memory, ModeReading]:
        """Modes of a window, or the reason why there are none."""
        given = self.settings
        if len(rows) < given.min_samples:
            return memory, ModeReading(why=("too_short",))
        if missing > given.max_missing * (len(rows) + missing):
            return memory, ModeReading(why=("too_much_missing",))
        columns, channels = columns_of(self.settings, block)
        whole = columns == list(range(rows.shape[1]))
        window = Window(
            rows=rows if whole else rows[:, columns],
            rate_hz=block.true_rate_hz,
            clock=block.clock,
            channels=channels,
            position=self._position(block, start_ns),
        )
        try:
            return self._reader.step(memory, window)
        except ValueError as error:
            logger.info("A window from %d ns was not read: %s", block.start_ns, error)
            return memory, ModeReading(why=("not_usable",))
        except Exception:
            logger.exception("Identification failed on a window from %d ns.", block.start_ns)
            return memory, ModeReading(why=("failed",))

    @property
    def _reader(self) -> WindowReader:
        if self.settings.identifier is not None:
            return PluginIdentifier(self.settings, self.settings.identifier)
        if self.settings.method == "modes":
            return MultiModeReader(self.settings)
        assert self.settings.method != "recursive"
        return SingleModeReader(self.settings, self.settings.method)

    def _position(self, block: Block, start_ns: int) -> float:
        """Return the position of a window: the number of its epoch, or of hops."""
        if block.epoch is not None:
            return float(block.epoch)
        return start_ns / 1e9 / (self.settings.hop_s or self.settings.window_s)
