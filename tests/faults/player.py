"""Edge agents of many assets as a few sessions: they play a recording and keep an account."""

import json
import threading
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Health, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ACK, FEATURES, HEALTH, alive_key, request_key
from slowtime_services.bus import Query, Sample, ZenohBus
from slowtime_services.shards import Share

SITE, BOOT = "lab", "b1"
ORIGIN_NS = 1_767_225_600_000_000_000

HEALTH_S = 1.0
"""How often each asset tells its health [s], as an edge agent does."""


class Recorded(NamedTuple):
    """One features message of the recording."""

    asset: str
    sequence: int
    payload: bytes


class Noted(NamedTuple):
    """An event, and when it happened [s]."""

    what: str
    at_s: float


def recording(assets: int, each: int, seed: int) -> list[Recorded]:
    """Make the recording of a seed: assets that lose stiffness, in turn."""
    rng = np.random.default_rng(seed)
    return [
        Recorded(f"mast-{number}", turn, _payload(f"mast-{number}", turn, float(noise)))
        for turn in range(each)
        for number, noise in enumerate(rng.standard_normal(assets))
    ]


def _payload(asset: str, sequence: int, noise: float) -> bytes:
    t_ns = ORIGIN_NS + sequence * 10**10
    frequency = Quantity(value=3.0 - 2e-4 * sequence + 2e-3 * noise, sd=2e-3)
    mode = Mode(frequency_hz=frequency, damping_ratio=Quantity(value=0.02, sd=1e-3))
    return encode(
        Features(
            site=SITE, asset=asset, boot=BOOT, sequence=sequence, t_ns=t_ns,
            start_ns=t_ns - 10**9, time_base="simulated", slow_time=float(sequence),
            method="ambient", modes=(mode,), quality=Quality(samples=1000),
        )
    )  # fmt: skip


def sample_of(message: Recorded) -> Sample:
    """Give a message as it arrives on a bus."""
    return Sample(FEATURES.key(SITE, message.asset), message.payload, None, True)


class Player:
    """Plays a recording evenly; assets are divided among sessions that connect as edges do.

    Parameters
    ----------
    endpoint
        Of the router.
    sessions, shards
        How many sessions there are, and how many shards recover from an event.
    """

    def __init__(
        self, endpoint: str, messages: list[Recorded], sessions: int, shards: int
    ) -> None:
        self._messages = messages
        self._assets = sorted({message.asset for message in messages})
        self._shards = [Share(index, shards) for index in range(shards)]
        self._kept: dict[str, dict[int, bytes]] = {asset: {} for asset in self._assets}
        self._made: dict[str, int] = dict.fromkeys(self._assets, -1)
        self._acknowledged: dict[str, int] = dict.fromkeys(self._assets, -1)
        self._made_s: dict[tuple[str, int], float] = {}
        self._took_s: list[tuple[str, float, float]] = []
        self._noted: list[Noted] = []
        self._lock = threading.Lock()
        self._next = self._told = self.again = 0
        self._began_ns = time.time_ns()
        self._began_s = self._told_s = time.monotonic()
        self._seconds = 1.0
        # A peer opens at once and waits for its router, as an edge agent does.
        self._buses = [ZenohBus("peer", [endpoint]) for _ in range(sessions)]
        for place, asset in enumerate(self._assets):
            bus = self._buses[place % sessions]
            bus.subscribe(ACK.key(SITE, asset), self._hear)
            bus.answer(request_key(SITE, asset, "account"), self._account)
            bus.answer(request_key(SITE, asset, "features"), self._features)
            bus.announce(alive_key(SITE, asset))

    def open(self, patience_s: float) -> bool:
        """Send the first feature of each asset; whether all were acknowledged in time."""
        for _ in self._assets:
            self._send()
        until_s = time.monotonic() + patience_s
        while self.waiting and time.monotonic() < until_s:
            self._tell_health()
            time.sleep(0.05)
        self._took_s.clear()
        return not self.waiting

    def begin(self, seconds: float) -> None:
        """Play the rest within so many seconds, by `step`."""
        self._first, self._seconds = self._next, seconds
        self._began_s = time.monotonic()

    def step(self) -> float:
        """Send what is due; return the time since `begin` [s]."""
        now_s = time.monotonic() - self._began_s
        left = len(self._messages) - self._first
        due = self._first + min(left, int(left * now_s / self._seconds))
        while self._next < due:
            self._send()
        self._tell_health()
        return now_s

    @property
    def playing(self) -> bool:
        """Whether there is more to send."""
        return self._next < len(self._messages)

    @property
    def waiting(self) -> int:
        """Number of features that were not acknowledged."""
        with self._lock:
            return len(self._made_s)

    def acknowledged(self) -> dict[str, int]:
        """Return the last acknowledged sequence of each asset."""
        with self._lock:
            return dict(self._acknowledged)

    def note(self, what: str) -> None:
        """Note that something happens now."""
        self._noted.append(Noted(what, time.monotonic()))

    def report(self) -> list[str]:
        """Say how long features took to become durable, and how long each recovery lasted."""
        took_s = np.array([took for _, _, took in self._took_s] or [np.nan])
        lines = [
            f"{len(self._messages)} features, {self.again} asked for again; made to "
            f"acknowledged p50 {np.median(took_s):.3f} s, p99 {np.percentile(took_s, 99):.2f} s"
        ]
        found: dict[str, list[float]] = {}
        for noted in self._noted:
            kind = noted.what.partition("-")[0]
            found.setdefault(kind, []).append(self._recovery_s(noted))
        lines += [
            f"{kind}: {len(lasted)} times; recovered after {np.median(lasted):.1f} s (median), "
            f"{max(lasted):.1f} s at most"
            for kind, lasted in sorted(found.items())
        ]
        slowest = sorted(self._noted, key=self._recovery_s)[-3:]
        lines.append(
            "slowest: "
            + ", ".join(
                f"{noted.what} at {noted.at_s - self._began_s:.1f} s took "
                f"{self._recovery_s(noted):.1f} s"
                for noted in slowest
            )
        )
        return lines

    def close(self) -> None:
        """Leave."""
        for bus in self._buses:
            bus.close()

    def _recovery_s(self, noted: Noted) -> float:
        """Time until each shard has acknowledged a feature that was made after an event [s]."""
        lasted = []
        for share in self._shards:
            done = [
                made_s + took
                for asset, made_s, took in self._took_s
                if made_s > noted.at_s and share.has(asset)
            ]
            if done:
                lasted.append(min(done) - noted.at_s)
        return max(lasted, default=0.0)

    def _bus(self, asset: str) -> ZenohBus:
        return self._buses[self._assets.index(asset) % len(self._buses)]

    def _send(self) -> None:
        message = self._messages[self._next]
        self._next += 1
        with self._lock:
            self._kept[message.asset][message.sequence] = message.payload
            self._made[message.asset] = message.sequence
            self._made_s[message.asset, message.sequence] = time.monotonic()
        key = FEATURES.key(SITE, message.asset)
        self._bus(message.asset).publish(key, message.payload, encoding=FEATURES.encoding)

    def _tell_health(self) -> None:
        now_s = time.monotonic()
        due = (now_s - self._told_s) * len(self._assets) / HEALTH_S
        for _ in range(min(int(due), len(self._assets))):
            self._told_s = now_s
            asset = self._assets[self._told % len(self._assets)]
            self._told += 1
            with self._lock:
                held = min(self._kept[asset], default=-1)
            now_ns = time.time_ns()
            message = Health(
                site=SITE, asset=asset, boot=BOOT, sequence=0, t_ns=now_ns,
                last_sequence=self._made[asset], first_held=held,
                uptime_s=(now_ns - self._began_ns) / 1e9,
            )  # fmt: skip
            key = HEALTH.key(SITE, asset)
            self._bus(asset).publish(key, encode(message), encoding=HEALTH.encoding)

    def _hear(self, sample: Sample) -> None:
        asset = sample.key.rpartition("/")[2]
        last, now_s = json.loads(sample.payload)["sequence"], time.monotonic()
        with self._lock:
            for sequence in range(self._acknowledged[asset] + 1, last + 1):
                made_s = self._made_s.pop((asset, sequence))
                self._took_s.append((asset, made_s, now_s - made_s))
                self._kept[asset].pop(sequence)
            self._acknowledged[asset] = max(last, self._acknowledged[asset])

    def _account(self, query: Query) -> Iterator[tuple[str, bytes]]:
        asset = query.key.rpartition("/")[2]
        with self._lock:
            first, last = min(self._kept[asset], default=-1), self._made[asset]
        if first >= 0:
            held = {"boot": BOOT, "first": first, "last": last}
            yield query.key, json.dumps(held).encode()

    def _features(self, query: Query) -> Iterator[tuple[str, bytes]]:
        asset = query.key.rpartition("/")[2]
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        with self._lock:
            kept = sorted(self._kept[asset].items())
            found = [payload for sequence, payload in kept if first <= sequence <= last]
            self.again += len(found)
        for payload in found:
            yield FEATURES.key(SITE, asset), payload
