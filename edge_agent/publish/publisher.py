"""Fourth stage of the edge: features to disk and bus; answers to requests.

Messages may be lost on the bus, while features in the spool can be requested again. So every
feature is on disk before it is on the bus, and publishing waits for no receiver.
"""

import json
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from edge_agent.settings import Origin, PublishSettings
from slowtime.signals.block import Block
from slowtime_schemas.batches import BATCH_ENCODING, pack
from slowtime_schemas.codec import Refused, decode_sample, encode
from slowtime_schemas.messages import (
    ACK_VERSION,
    FOREIGN_ACKS,
    About,
    Acknowledgement,
    Fatigue,
    Features,
    Health,
    LinkProfile,
    Message,
    Virtual,
)
from slowtime_schemas.raw import ITEM_BYTES, ClockCorrection, RawHeader, encode_raw
from slowtime_schemas.streams import (
    ABOUT,
    ACK,
    FATIGUE,
    FEATURES,
    HEALTH,
    RAW,
    VIRTUAL,
    Stream,
    alive_key,
    request_key,
)
from slowtime_services.bus import Bus, Handle, Query, Sample
from slowtime_services.clock import Clock
from slowtime_services.digests import digest_of, written
from slowtime_services.tracing import Made, SpanTraces

from .digests import DigestCheck
from .fatigue_store import FatigueStore
from .health_changes import HealthCondition
from .ring import Ring
from .segment_files import SpoolError
from .spool import Spool
from .uplink import TICK_S, Uplink, in_batches

logger = logging.getLogger(__name__)

MOST_AT_ONCE = 10_000
"""Features in one answer; who wants more asks again."""

Handler = Callable[[Query], Iterator[tuple[str, bytes]]]

LARGEST_COUNT = 2**63 - 1
"""Largest counter that a `Health` message holds [1]."""

MOST_RANGES = 1_000
"""Damaged ranges of a boot in one answer; the next are told once these are acknowledged."""


class Publisher:
    """Publishes the messages of one edge agent, and answers requests for them.

    Parameters
    ----------
    origin
        Whose messages these are.
    about
        What `About` says of the settings; ``processing`` must be among it.
    traces
        Told of each features message, where traces are asked for.
    counts
        Gives what the source has counted, for `Health`.
    link
        Profile that the settings come from, for `Health`.
    """

    def __init__(
        self,
        origin: Origin,
        spool: Spool,
        bus: Bus,
        clock: Clock,
        settings: PublishSettings,
        *,
        software: str,
        about: Mapping[str, Any],
        traces: SpanTraces | None = None,
        counts: Callable[[], Mapping[str, int]] | None = None,
        link: LinkProfile = "lab",
    ) -> None:
        self.origin, self._spool, self._bus, self._clock = origin, spool, bus, clock
        self._settings, self._software, self._about = settings, software, dict(about)
        self._traces, self._counts = traces, counts
        self._ring = Ring(settings.ring_s, settings.ring_bytes)
        self._counters: Counter[str] = Counter()
        self._sequences: Counter[str] = Counter()
        self._lock = threading.Lock()
        """Of sequences, which messages of several threads take."""
        self._beating = threading.Lock()
        """Of heartbeats, whose numbers leave in order whichever thread sends them."""
        self._sending = threading.Lock()
        """Of features, which leave in order whichever thread sends them."""
        self._last_features = self._last_sent = -1
        self._uplink = Uplink(settings, spool.folder, clock, link)
        self._acknowledged = -1
        self._agreement = DigestCheck()
        self._cumulative = FatigueStore(spool.folder, origin.boot)
        self._began_ns = clock.elapsed_ns()
        self._handles: list[Handle] = []
        self._changed = threading.Condition()

    def open(self) -> None:
        """Subscribe, answer requests, and announce this agent."""
        bus = self._bus
        self._handles += [
            self._answer("account", self._answer_account),
            self._answer("features", self._answer_features),
            self._answer("raw", self._answer_raw),
            self._answer("about", self._answer_about),
            self._answer("fatigue", self._answer_fatigue),
            self._answer("flush", self._answer_flush),
            bus.subscribe(ACK.key(self.origin.site, self.origin.asset), self._hear),
            bus.announce(alive_key(self.origin.site, self.origin.asset)),
        ]
        self.about()
        self.health()

    def close(self) -> None:
        """Send what waits, withdraw the liveliness token and close the spool."""
        self.flush_unless_held()
        self.health()
        for handle in reversed(self._handles):
            handle.close()
        self._handles.clear()
        self._spool.close()

    def count(self, what: str, by: int = 1) -> None:
        """Count an event for `Health`."""
        self._counters[what] += by

    def put(self, what: str, value: int) -> None:
        """Set a number of `Health`."""
        self._counters[what] = value

    @property
    def counters(self) -> dict[str, int]:
        """Counters of the publisher and of the source."""
        told = {} if self._counts is None else self._counts()
        every = sorted((*self._counters.items(), *told.items()))
        # One that is out of bounds would keep all the others from being told.
        return {name: min(max(0, count), LARGEST_COUNT) for name, count in every}

    def raw(self, block: Block) -> None:
        """Keep a block for requests, and publish it if the settings say so."""
        header, body = raw_message(block, self.origin, self._next_sequence(RAW))
        payload = encode_raw(header, body)
        self._ring.put(block.start_ns, block.end_ns, payload)
        if self._settings.raw == "on":
            self._send(RAW, payload)

    def features(self, message: Features) -> None:
        """Keep one features message, and send it at once or gather it."""
        began_ns = self._clock.now_ns()
        payload, stored = encode(message), True
        try:
            self._spool.append(message.sequence, payload)
        except SpoolError:
            # Without a disk the structure is still worth listening to.
            stored = False
            self.count("not_spooled")
            logger.exception("Features %d are sent but could not be stored.", message.sequence)
        self._agreement.note(message.sequence, payload)
        self.count("features")
        if self._uplink.gathers and stored:
            self._last_features = message.sequence
            if self._uplink.take(message):
                self.flush_unless_held()
        else:
            self.flush()
            with self._sending:
                self._last_features = self._last_sent = message.sequence
                self._send(FEATURES, payload)
        if self._traces is not None:
            made = Made(message.twin_id, message.boot, message.sequence)
            self._traces.at_edge(made, began_ns, self._clock.now_ns())

    @property
    def waiting(self) -> int:
        """Number of features that are kept and not sent yet."""
        return self._last_features - self._last_sent

    def flush(self) -> int:
        """Send all features that wait, in batches; return how many."""
        with self._sending:
            if not self.waiting or not self._connected:
                return 0
            # Before the range is taken: what is made meanwhile counts as waiting from now on.
            self._uplink.begin()
            first, last, sent = self._last_sent + 1, self._last_features, 0
            for batch in in_batches(self._spool.read(self.origin.boot, first, last)):
                packed = pack(batch)
                self._uplink.note_batch(len(batch), len(packed))
                self._send(FEATURES, packed, encoding=BATCH_ENCODING)
                sent += len(batch)
            self._last_sent = last
            return sent

    def flush_unless_held(self) -> int:
        """Send what waits, unless send hours or the budget hold it back."""
        if not self.waiting or self._uplink.held_until_ns(self.waiting) is not None:
            return 0
        return self.flush()

    def tick(self, seconds: float = TICK_S) -> None:
        """Send what is due: features that wait, health, and less often `About`."""
        self._uplink.pass_time(seconds)
        if self._uplink.due(self.waiting):
            self.flush()
        if self._uplink.health_due(self._condition()):
            self.health()
        if self._uplink.about_due():
            self.about()

    def health(self) -> None:
        """Publish health, with the last sequence of the account."""
        with self._beating:
            self._beat(self._condition())

    @property
    def _connected(self) -> bool:
        return bool(getattr(self._bus, "connected", True))

    def _condition(self) -> HealthCondition:
        if self._spool.damaged:
            self.put("spool_damaged", self._spool.damaged)
        spool = self._spool
        return HealthCondition.of(
            self.counters, spool.size, spool.dropped, connected=self._connected
        )

    def _beat(self, condition: HealthCondition) -> None:
        held = {entry.boot: entry for entry in self._spool.held()}.get(self.origin.boot)
        self._uplink.note_health(condition)
        self._send_message(
            HEALTH,
            Health(
                **self._envelope(HEALTH),
                last_sequence=self._last_sent,
                first_held=held.first if held else -1,
                dropped=self._spool.dropped,
                uptime_s=(self._clock.elapsed_ns() - self._began_ns) / 1e9,
                counters=self.counters | {ACK_VERSION: Acknowledgement.VERSION},
                link=self._uplink.report(self.waiting) if self._uplink.told else None,
            ),
        )

    def about(self) -> None:
        """Publish software and settings of this agent."""
        self._send_message(ABOUT, self._about_message())
        kept = self._cumulative.turn()
        if kept is not None:
            self._send(FATIGUE, kept)

    def assessed(self, messages: Sequence[Fatigue | Virtual]) -> None:
        """Send virtual quantities; keep and send fatigue."""
        for message in messages:
            payload = encode(message)
            if isinstance(message, Virtual):
                self.count("virtual")
                self._send(VIRTUAL, payload)
            else:
                self.count("fatigue")
                self._cumulative.put(payload)
                self._send(FATIGUE, payload)

    def wait_acknowledged(self, seconds: float, stop: threading.Event) -> bool:
        """Wait until the twin has all that was sent; False if `seconds` pass first."""
        waited = 0.0
        with self._changed:
            while self._acknowledged < self._last_sent:
                if waited >= seconds or stop.is_set():
                    return False
                self._changed.wait(0.05)
                waited += 0.05
        return True

    def _hear(self, sample: Sample) -> None:
        self._uplink.spend(len(sample.payload))
        try:
            message = decode_sample(sample.key, sample.payload)
        except Refused as refused:
            self.count(f"refused_ack_{refused.reason}")
            return
        if isinstance(message, Acknowledgement) and self._is_ours(message):
            self._spool.acknowledge(message.boot, message.sequence)
            with self._changed:
                if message.boot == self.origin.boot:
                    self._acknowledged = max(self._acknowledged, message.sequence)
                self._changed.notify_all()

    def _is_ours(self, word: Acknowledgement) -> bool:
        """Whether an acknowledgement concerns features of this agent."""
        if word.boot != self.origin.boot:
            differs = self._differs_from_spool(word)
        else:
            verdict = self._agreement.compare(word.first, word.sequence, word.digest)
            differs = verdict == "differs"
        if not differs:
            return True
        self.count(FOREIGN_ACKS)
        if self._spool.withhold(word.boot, word.sequence):
            logger.error(
                "The twin has acknowledged other features of %s.%s, boot %s, up to %d than "
                "this agent has made: another agent sends under the same asset and boot. "
                "Nothing of this boot is deleted from %s any more. Give each agent its own "
                "asset name, and leave `boot` unset.",
                self.origin.site,
                self.origin.asset,
                word.boot,
                word.sequence,
                self._spool.folder,
            )
        return False

    def _differs_from_spool(self, word: Acknowledgement) -> bool:
        """Compare the digest of an earlier boot with the spool."""
        if word.first is None or word.sequence - word.first >= MOST_AT_ONCE:
            return False
        held = {entry.boot: entry for entry in self._spool.held()}.get(word.boot)
        if held is None or not held.first <= word.first <= word.sequence <= held.last:
            return False
        payloads = list(self._spool.read(word.boot, word.first, word.sequence))
        if len(payloads) <= word.sequence - word.first:
            return False  # some are damaged
        total = sum(digest_of(n, p) for n, p in enumerate(payloads, word.first))
        return written(total) != word.digest

    def _answer(self, what: str, handler: Handler) -> Handle:
        """Answer requests, and count the bytes of questions and answers."""

        def counted(query: Query) -> Iterator[tuple[str, bytes]]:
            self._uplink.spend(0)
            for key, payload in handler(query):
                self._uplink.spend(len(payload))
                yield key, payload

        return self._bus.answer(self._request(what), counted)

    def _answer_account(self, query: Query) -> Iterator[tuple[str, bytes]]:
        for held in self._spool.held():
            if held.boot == self.origin.boot and self.waiting:
                # The twin asks for what is listed: not what is still to be sent in a batch.
                held = held._replace(last=min(held.last, self._last_sent))
                if held.last < held.first:
                    continue
            entry: dict[str, Any] = held._asdict() | {ACK_VERSION: Acknowledgement.VERSION}
            if damaged := self._spool.damaged_ranges(held.boot)[:MOST_RANGES]:
                entry["damaged"] = damaged
            if self._spool.withholds(held.boot):
                entry["withheld"] = True
            yield self._request("account"), json.dumps(entry).encode()

    def _answer_features(self, query: Query) -> Iterator[tuple[str, bytes]]:
        boot = query.parameters.get("boot", self.origin.boot)
        first = _integer_parameter(query, "first", 0)
        last = min(_integer_parameter(query, "last", 2**63 - 1), first + MOST_AT_ONCE - 1)
        key = FEATURES.key(self.origin.site, self.origin.asset)
        for payload in self._spool.read(boot, first, last):
            self.count("sent_again")
            yield key, payload

    def _answer_raw(self, query: Query) -> Iterator[tuple[str, bytes]]:
        key = RAW.key(self.origin.site, self.origin.asset)
        payloads = list(self._ring.last(_seconds(query)))
        if not self._uplink.affords(size := sum(map(len, payloads))):
            raise ValueError(
                f"Raw samples of {size:,} bytes were asked for, and the budget of the link for "
                "this month does not allow them. Ask for fewer seconds, or raise "
                "publish.budget_mb."
            )
        for payload in payloads:
            yield key, payload

    def _answer_about(self, query: Query) -> Iterator[tuple[str, bytes]]:
        yield ABOUT.key(self.origin.site, self.origin.asset), encode(self._about_message())

    def _answer_fatigue(self, query: Query) -> Iterator[tuple[str, bytes]]:
        key = FATIGUE.key(self.origin.site, self.origin.asset)
        for payload in self._cumulative.all():
            yield key, payload

    def _answer_flush(self, query: Query) -> Iterator[tuple[str, bytes]]:
        yield self._request("flush"), json.dumps({"sent": self.flush()}).encode()

    def _about_message(self) -> About:
        return About(**self._envelope(ABOUT), software=self._software, settings=self._about)

    def _envelope(self, stream: Stream) -> dict[str, Any]:
        return {
            "site": self.origin.site,
            "asset": self.origin.asset,
            "boot": self.origin.boot,
            "sequence": self._next_sequence(stream),
            "t_ns": self._clock.now_ns(),
        }

    def _next_sequence(self, stream: Stream) -> int:
        with self._lock:
            sequence = self._sequences[stream.name]
            self._sequences[stream.name] += 1
        return sequence

    def _send_message(self, stream: Stream, message: Message) -> None:
        self._send(stream, encode(message))

    def _send(self, stream: Stream, payload: bytes, *, encoding: str | None = None) -> None:
        """Publish; count a failure of the bus, as the spool keeps the features."""
        self._uplink.spend(len(payload))
        try:
            key = stream.key(self.origin.site, self.origin.asset)
            self._bus.publish(key, payload, encoding=encoding or stream.encoding)
        except Exception:
            self.count("not_sent")
            logger.exception("A %s message could not be sent.", stream.name)

    def _request(self, what: str) -> str:
        return request_key(self.origin.site, self.origin.asset, what)


def raw_message(block: Block, origin: Origin, sequence: int) -> tuple[RawHeader, bytes]:
    """Header and samples of a block, in the sensor's own type."""
    kind = block.samples.dtype.newbyteorder("<").str
    samples = block.samples if kind in ITEM_BYTES else block.samples.astype("<f8")
    kind, clock = samples.dtype.newbyteorder("<").str, block.clock
    header = RawHeader(
        **origin.model_dump(),
        sequence=sequence,
        t_ns=block.start_ns,
        rate_hz=block.rate_hz,
        first_index=block.first_index,
        dtype=kind,
        samples=len(samples),
        channels=block.channels,
        units=block.units,
        epoch=block.epoch,
        slow_time=block.slow_time,
        covariates=dict(block.covariates),
        truth=dict(block.truth) or None,
        clock=None if clock is None else ClockCorrection(relative=clock.relative, sd=clock.sd),
    )
    return header, np.ascontiguousarray(samples, dtype=kind).tobytes()


def _integer_parameter(query: Query, name: str, otherwise: int) -> int:
    text = query.parameters.get(name, str(otherwise))
    if not (text.isascii() and text.isdigit()):
        raise ValueError(
            f"{name}={text!r} is not a valid sequence number. Give a whole number from 0."
        )
    return int(text)


def _seconds(query: Query) -> float:
    text = query.parameters.get("seconds", "10")
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 < seconds < float("inf"):
        raise ValueError(
            f"seconds={text!r} is not a valid time. Give seconds above 0, such as 10."
        )
    return seconds
