"""A live sensor as a source of blocks: reader thread, queue, indices and times."""

import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from time import monotonic

import numpy as np

from edge_agent.inputs import LiveInput
from slowtime.signals.block import Block, RateCorrection
from slowtime.signals.clock.sampling_clock import ClockReading
from slowtime_schemas.messages import TimeBase
from slowtime_schemas.quantities import LEAST_RATE_HZ, MOST_RATE_HZ
from slowtime_services.bus import Inbox
from slowtime_services.files.channels.si_conversion import scaling_of

from .batch import UNIT_NS, Batch
from .counts import SampleCounts
from .formats.decoding import AnyLayout, Decoder, bounded, decoder_of
from .formats.framing import framer_of
from .indexing.assembly import MOST_WAITING, Assembler, SampleRun
from .indexing.bursts import Backlog, Bursts
from .indexing.counters import ByCounter
from .indexing.positions import BatchPlacement, ByArrival, ByStamp, Positions
from .rate_changes import RateWatch
from .reader import DescribingTransport, TransportReader
from .registry import Opened
from .timestamps import Timing
from .values import ValueWatch

logger = logging.getLogger(__name__)

IDLE_S = 0.1
"""Time that the queue is waited for before silence is looked at [s]."""

STEADY_NS = 1_000_000_000
"""A clock that is set back by more has been set back."""

AT_ONCE = 1_000
"""Batches taken from the queue before blocks are handed on."""


class LiveSource:
    """Blocks of a live sensor; whatever it sends, they go on."""

    time_base: TimeBase = "live"
    slow_time_unit = "s"

    def __init__(self, settings: LiveInput, opened: Opened, stop: threading.Event) -> None:
        self._settings, self._opened = settings, opened
        self._stop = stop
        self.tally = SampleCounts()
        self._values = ValueWatch(self.tally)
        self._inbox: Inbox[Batch] = Inbox(10**9, settings.queue_samples)
        self._reader: TransportReader | None = None
        self._dropped = 0
        self._heard_s = monotonic()
        """When a message came last, on a clock that no adjustment sets back."""
        self._is_silent = False
        self._start_ns = 0
        self._rates: RateWatch
        self._assembler: Assembler
        self._bursts: Bursts
        self._first_index = self._next_index = 0
        self._most_held = settings.queue_samples
        if opened.layout is not None and opened.rate_hz is not None:
            self._prepare(opened.layout, opened.rate_hz)

    def _prepare(self, layout: AnyLayout, rate_hz: float) -> None:
        """Prepare decoders, units and the clock model for a layout."""
        if not LEAST_RATE_HZ <= rate_hz <= MOST_RATE_HZ:
            raise ValueError(
                f"The device states {rate_hz:g} samples a second. Allowed: {LEAST_RATE_HZ:g} "
                f"to {MOST_RATE_HZ:g}. Give its rate in hertz."
            )
        self._layout = layout
        transport = self._opened.transport
        self._lanes, decoders = _lanes_of(layout)
        if self._opened.decode is not None:
            decoders = {"": self._opened.decode}
        decoders = {topic: bounded(decode, layout) for topic, decode in decoders.items()}
        framer = framer_of(layout) if transport.is_stream else None
        given = self._settings
        scaling = scaling_of(layout.names, layout.units, given.units, given.sensitivities)
        for said in scaling.notes:
            logger.info("%s: %s", given.scheme, said)
        self._units = scaling.units
        self._factors = np.array([channel.factor for channel in layout.channels])
        self._factors *= np.array(scaling.factors)
        self._offsets = np.array([channel.offset for channel in layout.channels])
        self._values.begin(layout.names, rate_hz)
        self._is_utc = layout.stamp is not None and layout.stamp.clock == "utc"
        self._timing = Timing(rate_hz, stamps=self._is_utc, tally=self.tally)
        self._backlog = Backlog(rate_hz)
        self._began(rate_hz, 0)
        self._reader = TransportReader(
            transport, decoders, framer, self._inbox, self.tally, self._stop
        )

    def counts(self) -> Mapping[str, int]:
        """Return the counters for `Health`; may be called from any thread."""
        told = self.tally.told()
        told["samples_lost"] = max(0, told["samples_lost"] - self._dropped)
        silent_s = monotonic() - self._heard_s
        told["sensor_silent_s"] = (
            int(silent_s) if silent_s >= self._settings.silent_after_s else 0
        )
        return told

    def __iter__(self) -> Iterator[Block]:
        """Blocks, until the source ends or the agent is stopped."""
        self._heard_s = monotonic()
        self._wait_described()
        if self._reader is None:
            self._opened.transport.close()
            return
        self._reader.start()
        while not self._stop.is_set():
            batches = self._inbox.take(AT_ONCE, timeout_s=IDLE_S)
            if batches:
                yield from self._work(batches)
            elif self._inbox.closed:
                break
            else:
                yield from self._rest()
        yield from self._leave(all_of_it=True)
        self._reader.join()

    def _wait_described(self) -> None:
        """Prepare for the first message that describes samples which can be worked."""
        transport = self._opened.transport
        while self._reader is None and isinstance(transport, DescribingTransport):
            described = transport.describe(self._stop)
            if described is None:
                return
            try:
                self._prepare(*described)
            except ValueError as error:
                logger.warning("Samples that came cannot be worked; waiting on. %s", error)

    def _work(self, batches: Sequence[Batch]) -> Iterator[Block]:
        for batch in batches:
            self._hear(batch)
            if len(self._lanes) > 1:
                for other in self._positions:
                    self._positions[batch.lane].begin_beside(other, batch)
            for placement in self._positions[batch.lane].place(batch):
                yield from self._put(placement)
        yield from self._leave()

    def _hear(self, batch: Batch) -> None:
        self._dropped += batch.dropped
        if batch.lane == 0:  # samples of the others come beside these
            self._backlog.note(batch.arrival_ns, len(batch.rows))
            if self._bursts.note(batch.arrival_ns, len(batch.rows)):
                self.tally.add("sensor_bursts")
        self._heard_s = monotonic()
        if self._is_silent:
            self._is_silent = False
            logger.info("The sensor sends again.")

    def _rest(self) -> Iterator[Block]:
        """Handle a time without messages: report lasting silence, pass on complete runs."""
        quiet_s = monotonic() - self._heard_s
        if quiet_s > max(2 * self._settings.block_s, self._settings.reorder_s, 2 * IDLE_S):
            for positions in self._positions:
                for placement in positions.finish():
                    yield from self._put(placement)
            yield from self._leave(all_of_it=True)
        if quiet_s >= self._settings.silent_after_s and not self._is_silent:
            self._is_silent = True
            self.tally.add("sensor_silences")
            logger.warning("The sensor has sent nothing for %.0f s.", quiet_s)

    def _put(self, placement: BatchPlacement) -> Iterator[Block]:
        index, batch, restarts = placement
        index += self._first_index
        if restarts:
            yield from self._leave(all_of_it=True)
            self._assembler.restart(index)
            self._timing.begin(self._timing.rate_hz)
            self._rates.interrupt()
        is_gap = index != self._next_index
        self._next_index = max(self._next_index, index + len(batch.rows))
        self._assembler.put(index, batch.rows, batch.lane)
        if batch.lane == 0:
            yield from self._note_time(index, batch, is_gap and not restarts)

    def _note_time(self, index: int, batch: Batch, is_gap: bool) -> Iterator[Block]:
        """Update the clock model; restart it if the sampling rate of the device has changed."""
        last = index + len(batch.rows) - 1
        time_ns = batch.arrival_ns
        if self._is_utc and batch.stamp is not None and self._layout.stamp is not None:
            last, time_ns = (
                index + batch.stamp_at,
                batch.stamp * UNIT_NS[self._layout.stamp.unit],
            )
        self._timing.note(last, time_ns)
        if is_gap and not isinstance(self._positions[0], ByCounter):
            self._rates.interrupt()
        rate_hz = self._rates.note(index + len(batch.rows), batch.arrival_ns)
        if rate_hz is not None:
            was_held = self._backlog.lasts and not self._is_utc
            if not was_held:
                yield from self._leave(all_of_it=True)
            self.tally.add("rate_changes")
            logger.warning(
                "The sensor samples at %g Hz now, not at %g Hz; its blocks state the new rate.",
                rate_hz, self._timing.rate_hz,
            )  # fmt: skip
            self._timing.begin(rate_hz)
            if was_held:  # No queue that was drained: the device was as fast all along.
                self._rate_hz = rate_hz
                self._timing.note(last, time_ns)
                yield from self._leave(all_of_it=True)
                self._timing.begin(rate_hz)
            self._backlog = Backlog(rate_hz)
            self._began(rate_hz, self._next_index + 1)

    def _began(self, rate_hz: float, first_index: int) -> None:
        """Begin to place and to assemble, at a rate and from an index on."""
        given = self._settings
        horizon = round(min(given.reorder_s * rate_hz, MOST_WAITING))
        self._rate_hz, self._first_index, self._next_index = rate_hz, first_index, first_index
        self._positions: list[Positions] = [
            self._positions_at(rate_hz, horizon) for _ in self._lanes
        ]
        counted = self._layout.counter is not None or self._layout.stamp is not None
        waits = horizon if counted or len(self._lanes) > 1 else 0
        block_rows = max(1, round(min(given.block_s * rate_hz, MOST_WAITING)))
        self._assembler = Assembler(self._lanes, block_rows, waits, self.tally)
        self._assembler.restart(first_index)
        self._rates = RateWatch(rate_hz, given.rate_tolerance)
        self._bursts = Bursts(rate_hz)

    def _positions_at(self, rate_hz: float, horizon: int) -> Positions:
        if self._layout.counter is not None:
            return ByCounter(self._layout.counter, rate_hz, horizon, self.tally)
        if self._layout.stamp is not None:
            return ByStamp(self._layout.stamp, rate_hz, horizon, self.tally)
        return ByArrival(rate_hz, self.tally)

    def _leave(self, *, all_of_it: bool = False) -> Iterator[Block]:
        """Pass on complete runs."""
        is_held = self._backlog.lasts and not self._is_utc
        if is_held and not all_of_it and self._assembler.waiting_rows < self._most_held:
            return
        runs = self._assembler.take(all_of_it=all_of_it)
        if runs:
            reading = self._timing.read()
            for run in runs:
                self._values.note(run.rows)
                yield self._block(run, reading)

    def _block(self, run: SampleRun, reading: ClockReading) -> Block:
        start_ns = reading.time_ns(run.first_index)
        # The estimate moves a little as it gets better; time must not run back by that.
        if 0 <= self._start_ns - start_ns < STEADY_NS:
            start_ns = self._start_ns + 1
        self._start_ns = start_ns
        samples = (run.rows - self._offsets) * self._factors
        # A float in a frame, or a word such as `inf` in a line, is no measurement.
        samples[~np.isfinite(samples)] = np.nan
        return Block(
            samples=samples,
            rate_hz=self._rate_hz,
            first_index=run.first_index,
            start_ns=max(0, start_ns),
            channels=self._layout.names,
            units=self._units,
            clock=RateCorrection(relative=reading.correction, sd=reading.correction_sd),
        )


def _lanes_of(layout: AnyLayout) -> tuple[tuple[tuple[int, ...], ...], dict[str, Decoder]]:
    """Channels of each topic, and the decoder of its messages."""
    topics: dict[str, list[int]] = {}
    for number, channel in enumerate(layout.channels):
        topics.setdefault(channel.topic or "", []).append(number)
    lanes = tuple(tuple(columns) for columns in topics.values())
    decoders = {
        topic: decoder_of(layout, lane, lanes[lane]) for lane, topic in enumerate(topics)
    }
    return lanes, decoders
