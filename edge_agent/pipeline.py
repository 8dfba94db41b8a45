"""Runs the stages of the edge in their order: acquire, condition, extract, assess, publish.

`Edge` is the three pure stages as one, so that a recording can be run through it without any
clock or bus; `listen` is the loop that nothing stops but the end of its source; `rerun` makes
of recorded raw blocks the very bytes that the edge once made of them.
"""

import contextlib
import dataclasses
import itertools
import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from slowtime.signals.block import Block
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features
from slowtime_schemas.raw import RawHeader
from slowtime_services.clock import Clock

from .acquire import Admission, Refusal
from .condition import Conditioner, Marked, PendingSegment
from .extract import Extract, ExtractState
from .publish import Publisher
from .settings import BlockAdmissionSettings, Origin, Processing

if TYPE_CHECKING:
    from .assess import Assess
else:
    Assess = Any  # imported where it is made: most edges assess nothing

logger = logging.getLogger(__name__)


@dataclasses.dataclass(frozen=True, slots=True)
class EdgeState:
    """States of the stages."""

    condition: PendingSegment | None
    extract: ExtractState
    ready: tuple[Marked, ...] = ()
    """What the last step has conditioned, for stages beside extraction."""


@dataclasses.dataclass(frozen=True, slots=True)
class Edge:
    """Blocks in, features out: condition and extract as one stage."""

    condition: Conditioner
    extract: Extract

    @classmethod
    def of(cls, processing: Processing, origin: Origin) -> "Edge":
        """Make the stages that the settings describe."""
        return cls(Conditioner(processing.condition), Extract(processing.extract, origin))

    def start(self) -> EdgeState:
        """Begin with nothing seen."""
        return EdgeState(self.condition.start(), self.extract.start())

    def step(self, state: EdgeState, block: Block) -> tuple[EdgeState, tuple[Features, ...]]:
        """Take one block; give the features of the windows that it completes."""
        conditioned, ready = self.condition.step(state.condition, block)
        extracting, features = self._extract(state.extract, ready)
        return EdgeState(conditioned, extracting, ready), features

    def finish(self, state: EdgeState) -> tuple[EdgeState, tuple[Features, ...]]:
        """Close the open window: its epoch is complete, or the stream has ended."""
        conditioned, ready = self.condition.finish(state.condition)
        extracting, features = self._extract(state.extract, ready)
        extracting, last = self.extract.finish(extracting)
        return EdgeState(conditioned, extracting, ready), features + last

    def restart(self, state: EdgeState) -> EdgeState:
        """Forget the samples at hand, which could not be worked; keep count and smoother."""
        kept = dataclasses.replace(state.extract, gathered=None)
        return EdgeState(self.condition.start(), kept)

    def _extract(
        self, state: ExtractState, ready: tuple[Marked, ...]
    ) -> tuple[ExtractState, tuple[Features, ...]]:
        out: tuple[Features, ...] = ()
        for block, marks in ready:
            state, features = self.extract.step(state, block, marks)
            out += features
        return state, out


class WorkTime:
    """Measures the work for a window against the time between windows.

    Counters of `Health`: ``busy_ms`` in all, ``window_busy_ms`` for the last window,
    ``window_busy_max_ms`` for the dearest, ``window_period_ms`` from the window before to the
    last one, all on the clock of the agent. Of a live sensor also ``behind_ms``, from the last
    sample of a window until it was told: it grows where the work does not fit the period.
    """

    def __init__(self, publisher: Publisher, clock: Clock) -> None:
        self._publisher, self._clock = publisher, clock
        self._total_ns = self._window_ns = self._dearest_ns = 0
        self._last_ns: int | None = None

    @contextlib.contextmanager
    def spent(self) -> Iterator[None]:
        """Count the time within."""
        began_ns = self._clock.elapsed_ns()
        try:
            yield
        finally:
            took_ns = self._clock.elapsed_ns() - began_ns
            self._total_ns += took_ns
            self._window_ns += took_ns
            self._put("busy", self._total_ns)

    def told(self, windows: Sequence[Features]) -> None:
        """Share the time spent among the windows that have been sent now."""
        if not windows:
            return
        elapsed_ns = self._clock.elapsed_ns()
        each_ns, self._window_ns = self._window_ns // len(windows), 0
        self._dearest_ns = max(self._dearest_ns, each_ns)
        self._put("window_busy", each_ns)
        self._put("window_busy_max", self._dearest_ns)
        if self._last_ns is not None:
            self._put("window_period", (elapsed_ns - self._last_ns) // len(windows))
        if windows[-1].time_base == "live":
            self._put("behind", self._clock.now_ns() - windows[-1].t_ns)
        self._last_ns = elapsed_ns

    def _put(self, what: str, ns: int) -> None:
        self._publisher.put(f"{what}_ms", max(0, ns) // 10**6)


class SourceRun:
    """One pass over a source: admits, processes, publishes; invalid blocks are left out."""

    def __init__(
        self,
        edge: Edge,
        admission: Admission,
        publisher: Publisher,
        clock: Clock,
        assess: Assess | None = None,
    ) -> None:
        self._edge, self._admission = edge, admission
        self._assess = assess
        self._assessed = None if assess is None else assess.start()
        self._publisher, self._clock = publisher, clock
        self._state, self._admitted = edge.start(), admission.start()
        self._effort = WorkTime(publisher, clock)
        self.rewound: Block | None = None
        """First block of a stream whose time has run back; it has not been worked."""

    def take(self, block: Block | None) -> None:
        """Process a block of the source; None means that an epoch is complete."""
        with self._effort.spent():
            features = self._work(block)
            for message in features:
                self._tell(message)
            self._assess_ready(last=block is None)
        self._effort.told(features)

    def _work(self, block: Block | None) -> tuple[Features, ...]:
        features: tuple[Features, ...] = ()
        try:
            if block is None:
                self._state, features = self._edge.finish(self._state)
            elif self._admit(block):
                self._publisher.raw(block)
                self._state, features = self._edge.step(self._state, block)
        except Exception:
            self._publisher.count("failed_blocks")
            logger.exception("A block could not be processed; the stream continues after it.")
            self._state = self._edge.restart(self._state)
        return features

    def _assess_ready(self, *, last: bool) -> None:
        """Compute virtual quantities and fatigue of the conditioned blocks."""
        ready, self._state = self._state.ready, dataclasses.replace(self._state, ready=())
        if self._assess is None or self._assessed is None:
            return
        try:
            for block, _ in ready:
                self._assessed, told = self._assess.step(self._assessed, block)
                self._publisher.assessed(told)
            if last:
                self._assessed, told = self._assess.finish(self._assessed)
                self._publisher.assessed(told)
        except Exception:
            self._publisher.count("failed_assessments")
            logger.exception("Fatigue of a block could not be computed; the stream continues.")
            self._assessed = dataclasses.replace(self._assessed, running=None)

    def _admit(self, block: Block) -> bool:
        self._publisher.count("blocks")
        before = self._admitted.last
        self._admitted, refusal = self._admission.step(
            self._admitted, block, self._clock.now_ns()
        )
        if refusal is not None:
            self._refuse(block, refusal)
        elif before is not None and block.start_ns <= before.start_ns:
            self.rewound = block
        return refusal is None and self.rewound is None

    def _refuse(self, block: Block, refusal: Refusal) -> None:
        word = f"refused_{refusal.word}"
        self._publisher.count(word)
        times = self._publisher.counters[word]
        if (
            times & (times - 1) == 0
        ):  # the 1st, 2nd, 4th, 8th ...: a flood does not fill the log
            logger.warning(
                "A block of %d samples from index %d was refused (%s, %d so far): %s",
                len(block.samples),
                block.first_index,
                refusal.word,
                times,
                refusal.sentence,
            )

    def _tell(self, message: Features) -> None:
        self._publisher.count("missing_samples", message.quality.missing)
        self._publisher.count("outliers", message.quality.outliers)
        if not message.modes:
            self._publisher.count("unidentified")
        try:
            self._publisher.features(message)
        except Exception:
            self._publisher.count("failed_features")
            logger.exception(
                "Features %d could not be published; the stream continues.", message.sequence
            )


def listen(
    blocks: Iterator[Block | None],
    edge: Edge,
    admission: BlockAdmissionSettings,
    publisher: Publisher,
    clock: Clock,
    stop: threading.Event,
    assess: Assess | None = None,
) -> Iterator[Block | None] | None:
    """Work all `blocks`, until they end or `stop` is set.

    The window begun when it ends is closed and told as well. Where sensor time runs back, gives
    the blocks from there on: within a boot it increases, so that they belong to another.
    """
    admit = Admission(admission, edge.extract.origin.time_base)
    listening = SourceRun(edge, admit, publisher, clock, assess)
    try:
        for block in blocks:
            listening.take(block)
            if listening.rewound is not None:
                return itertools.chain([listening.rewound], blocks)
            if stop.is_set():
                break
    finally:
        listening.take(None)
    return None


def rerun(blocks: Iterable[tuple[RawHeader, Block]], processing: Processing) -> Iterator[bytes]:
    """Make the features of recorded raw blocks again, byte for byte.

    Boot, sequence, times and time base are those of the recording; settings must be those that
    its `About` tells (see `Processing.from_about`). Recordings of several assets and boots may
    be mixed.

    Raises `ValueError` where a raw block of a boot is missing, be it the first: sequence and
    smoothed frequency rest on every block before. The features up to there have been given by
    then.
    """
    running: dict[tuple[str, str], tuple[Edge, EdgeState]] = {}
    expected: dict[Origin, int] = {}
    for header, block in blocks:
        origin = Origin(
            site=header.site,
            asset=header.asset,
            boot=header.boot,
            time_base=header.time_base,
            slow_time_unit=header.slow_time_unit,
        )
        due = expected.get(origin, 0)
        if header.sequence < due:
            continue  # recorded twice
        if header.sequence > due:
            raise ValueError(
                f"Raw block {due} of {header.twin_id}, start {header.boot} of its edge agent, "
                f"is missing in the recording; the next one is {header.sequence}. Features "
                "after this gap cannot be reproduced byte for byte. For the next recording, "
                "start the recorder before the edge agent, and keep it running."
            )
        expected[origin] = due + 1
        asset = (header.site, header.asset)
        if asset in running and running[asset][0].extract.origin != origin:
            yield from _finished(*running.pop(asset))
        if asset not in running:
            edge = Edge.of(processing, origin)
            running[asset] = edge, edge.start()
        edge, state = running[asset]
        state, features = edge.step(state, block)
        running[asset] = edge, state
        yield from map(encode, features)
    for edge, state in running.values():
        yield from _finished(edge, state)


def _finished(edge: Edge, state: EdgeState) -> Iterator[bytes]:
    yield from map(encode, edge.finish(state)[1])
