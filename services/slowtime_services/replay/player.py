"""Replay of a recording onto a bus.

No transport is lossless for a slow receiver, however it is asked. So the recording behaves as
an edge does: it is alive under the edge's name, tells what it holds (`request/account`), sends
again what is asked for (`request/features`), closes with the health message that states the
last sequence, and waits until the twin has acknowledged it. It never has more than `window`
features on the way unacknowledged. Where nobody acknowledges, it says so in the end.
"""

import contextlib
import dataclasses
import functools
import itertools
import json
import logging
import math
import threading
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from slowtime_schemas.codec import Refused, decode_sample, encode
from slowtime_schemas.streams import (
    ABOUT,
    ACK,
    ASSET_EVENT,
    FATIGUE,
    FEATURES,
    HEALTH,
    REGISTRATION,
    VIRTUAL,
    Stream,
    address_of,
    alive_key,
    parse_key,
    request_key,
)
from slowtime_services.bus import Bus, Query, Sample
from slowtime_services.clock import Clock, SystemClock
from slowtime_services.feature_runs import AgentRun, run_and_sequence

from .feature_holdings import RunFeatures, features_again, features_by_run, health_messages
from .recording_reader import Contents, RecordedMessage, contents, read_recording

logger = logging.getLogger(__name__)

PLAYED = (REGISTRATION, ABOUT, FEATURES, HEALTH, ASSET_EVENT, FATIGUE, VIRTUAL)
LONGEST_PAUSE_S = 3600.0
"""Longest pause between two messages [s], whatever their stamps say: a recorder whose clock was
set while it ran has stamps that are decades apart. Longer ones are cut, which is logged."""
SLOWEST = 1e-3
"""Least speed [1]: an hour would take six weeks."""
_REMIND_S = 0.5
"""How long without any acknowledgement until the twin is told again how far each run is."""


class ReplayProgress(NamedTuple):
    """Progress of a replay."""

    done: int
    total: int
    log_ns: int
    """Where in the recording."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """Results of a replay."""

    counts: dict[str, int]
    """Messages published, by stream."""
    features: int
    """Different features the recording holds."""
    acknowledged: int
    """How many of them a twin has confirmed as durable."""
    duration_s: float
    stopped: bool
    """Whether it was stopped before its end."""

    @property
    def complete(self) -> bool:
        """Whether all was played and, as far as features go, confirmed."""
        return not self.stopped and self.acknowledged == self.features


def replay(
    path: Path | str,
    bus: Bus,
    *,
    speed: float = 1.0,
    streams: Collection[Stream] = PLAYED,
    clock: Clock | None = None,
    progress: Callable[[ReplayProgress], None] | None = None,
    stop: threading.Event | None = None,
    window: int = 1000,
    patience_s: float = 5.0,
) -> Played:
    """Publish a recording again, in its order, at `speed` times its pace.

    Parameters
    ----------
    speed
        1 as it was, ``math.inf`` as fast as it is acknowledged.
    streams
        What to publish; by default what comes from the edge, and what the twin was told of its
        structure: it makes the rest anew.
    clock
        Keeps the pace.
    progress
        Told now and then how far it is, and at the end.
    stop
        Set from outside to end early.
    window
        Most features under way without acknowledgement.
    patience_s
        How long without any acknowledgement until nobody is believed to acknowledge.

    Raises
    ------
    RecordingError
        If the file cannot be read as a recording of ours.
    """
    if not speed >= SLOWEST or window < 1:
        raise ValueError(
            f"{speed=}, {window=} cannot be played. Give a speed of at least {SLOWEST:g} (inf "
            "is as fast as possible) and a window of at least 1."
        )
    path = Path(path)
    inside = contents(path, streams=streams)
    player = _Player(path, bus, window, patience_s, stop or threading.Event())
    player.progress, player.total = progress, inside.messages
    started = time.monotonic()
    with player.on_stage(inside):
        for message in _paced(
            read_recording(path, streams=streams), speed, clock or SystemClock(), player.stop
        ):
            player.publish(message)
        player.finish(streams)
    return player.played(time.monotonic() - started)


def _paced(
    messages: Iterator[RecordedMessage], speed: float, clock: Clock, stop: threading.Event
) -> Iterator[RecordedMessage]:
    """Yield each message at its time."""
    if math.isinf(speed):
        yield from itertools.takewhile(lambda _: not stop.is_set(), messages)
        return
    due_ns, before_ns, longest_ns = clock.elapsed_ns(), None, LONGEST_PAUSE_S * 1e9
    for message in messages:
        # Back in time: the recorder's clock was set back, and messages go on as they came.
        pause_ns = max(0, message.log_ns - (before_ns or message.log_ns)) / speed
        if pause_ns > longest_ns:
            logger.warning(
                "A pause of %.0f s was cut to %.0f s.", pause_ns / 1e9, LONGEST_PAUSE_S
            )
        # Whole nanoseconds: of a part of one, no clock would ever say that it has passed.
        before_ns, due_ns = message.log_ns, due_ns + round(min(pause_ns, longest_ns))
        while not stop.is_set() and (now := clock.elapsed_ns()) < due_ns:
            clock.sleep(min((due_ns - now) / 1e9, 0.1))
        if stop.is_set():
            return
        yield message


@functools.lru_cache(maxsize=65536)
def _stream_of(key: str) -> Stream:
    return parse_key(key)[0]


class _Player:
    """The edges of a recording on a bus, and the account of confirmed features."""

    def __init__(
        self, path: Path, bus: Bus, window: int, patience_s: float, stop: threading.Event
    ) -> None:
        self._path, self._bus = path, bus
        self._window, self._patience_s, self.stop = window, patience_s, stop
        self._holdings = features_by_run(path)
        self._outstanding = 0
        """Features published and not acknowledged, of all runs."""
        self._runs: dict[tuple[str, str], list[tuple[AgentRun, RunFeatures]]] = {}
        for run, holding in self._holdings.items():
            self._runs.setdefault((run.site, run.asset), []).append((run, holding))
        self._changed = threading.Condition()
        self._silent_s = 0.0
        self._believes = True
        self._credit = 0
        self._counts: dict[str, int] = {}
        self._told = 0.0
        self._log_ns = 0
        self.progress: Callable[[ReplayProgress], None] | None = None
        self.total = 0

    @contextlib.contextmanager
    def on_stage(self, inside: Contents) -> Iterator[None]:
        """Be alive, answer and listen under the name of every asset of the recording."""
        addresses = {parse_key(key)[1:] for key in inside.counts}
        with contextlib.ExitStack() as handles:
            for site, asset in sorted(addresses):
                for handle in (
                    self._bus.subscribe(ACK.key(site, asset), self._hear),
                    self._bus.answer(request_key(site, asset, "account"), self._account),
                    self._bus.answer(request_key(site, asset, "features"), self._again),
                    self._bus.announce(alive_key(site, asset)),
                ):
                    handles.callback(handle.close)
            yield

    def publish(self, message: RecordedMessage) -> None:
        """Send one message, once there is room for it in the window."""
        stream = _stream_of(message.key)
        if (
            stream is FEATURES
            and (known := run_and_sequence(message.key, message.payload)) is not None
        ):
            if self._credit == 0:
                self._wait_reminding(lambda: self._outstanding < self._window)
                self._credit = max(1, self._window - self._outstanding)
            self._credit -= 1
            with self._changed:
                holding = self._holdings[known[0]]
                before = holding.outstanding
                holding.published = max(holding.published, known[1])
                self._outstanding += holding.outstanding - before
        self._bus.publish(message.key, message.payload, encoding=stream.encoding, replayed=True)
        self._counts[stream.name] = self._counts.get(stream.name, 0) + 1
        self._log_ns = message.log_ns
        self._tell()

    def finish(self, streams: Collection[Stream]) -> None:
        """Publish the end of each run until all is confirmed, or no twin seems to listen."""
        if FEATURES in streams and not self.stop.is_set():
            self._silent_s, self._believes = 0.0, True
            if self._outstanding:
                self._remind()
            self._wait_reminding(lambda: not self._outstanding)
        self._tell(at_last=True)

    def played(self, duration_s: float) -> Played:
        """Sum up."""
        return Played(
            counts=dict(self._counts),
            features=sum(len(h.sequences) for h in self._holdings.values()),
            acknowledged=sum(h.up_to(h.acknowledged) for h in self._holdings.values()),
            duration_s=duration_s,
            stopped=self.stop.is_set(),
        )

    def _wait_reminding(self, condition: Callable[[], bool]) -> None:
        """Wait until patience ends; remind the twin if features or messages were lost."""
        pause_s = _REMIND_S
        while not condition() and self._believes and not self.stop.is_set():
            self._wait_until(condition, at_most_s=pause_s)
            if condition() or self._silent_s < pause_s:
                pause_s = _REMIND_S
            else:  # and less and less often: who is slow has them all to read
                self._remind()
                pause_s *= 2

    def _remind(self) -> None:
        """Publish how far each run is, so that a twin requests and acknowledges again."""
        for run, health in health_messages(self._holdings):
            self._bus.publish(
                HEALTH.key(run.site, run.asset),
                encode(health),
                encoding=HEALTH.encoding,
                replayed=True,
            )

    def _wait_until(self, condition: Callable[[], bool], at_most_s: float) -> None:
        """Wait for acknowledgements, until patience with their absence is at an end."""
        deadline = time.monotonic() + at_most_s
        with self._changed:
            while self._believes and not condition() and not self.stop.is_set():
                began = time.monotonic()
                if began >= deadline:
                    return
                self._changed.wait(min(0.05, self._patience_s - self._silent_s))
                self._silent_s += time.monotonic() - began
                self._believes = self._silent_s < self._patience_s

    def _hear(self, sample: Sample) -> None:
        try:
            ack = decode_sample(sample.key, sample.payload)
        except Refused:
            return
        with self._changed:
            holding = self._holdings.get(AgentRun(ack.site, ack.asset, ack.boot))
            if holding is None:
                return
            sequence = min(ack.sequence, holding.published)  # beyond, nothing was sent
            if sequence > holding.acknowledged:
                before, holding.acknowledged = holding.outstanding, sequence
                self._outstanding += holding.outstanding - before
                self._silent_s, self._believes = 0.0, True
                self._changed.notify_all()

    def _account(self, query: Query) -> list[tuple[str, bytes]]:
        with self._changed:
            return [
                (
                    request_key(run.site, run.asset, "account"),
                    json.dumps(
                        {
                            "boot": run.boot,
                            "first": holding.sequences[0],
                            "last": holding.published,
                        }
                    ).encode(),
                )
                for run, holding in self._requested_runs(query.key, "account")
                if holding.published >= 0
            ]

    def _again(self, query: Query) -> Iterator[tuple[str, bytes]]:
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        first = max(0, first)
        for run, holding in self._requested_runs(query.key, "features"):
            if run.boot == query.parameters["boot"]:
                for payload in features_again(self._path, run, holding, first, last):
                    yield FEATURES.key(run.site, run.asset), payload

    def _requested_runs(self, key: str, what: str) -> list[tuple[AgentRun, RunFeatures]]:
        address = address_of(key)
        if address is None or key != request_key(*address, what):
            return []
        return self._runs.get(address, [])

    def _tell(self, *, at_last: bool = False) -> None:
        if self.progress is None:
            return
        now = time.monotonic()
        if at_last or now - self._told > 0.1:
            self._told = now
            done = sum(self._counts.values())
            self.progress(ReplayProgress(done, self.total, self._log_ns))
