"""Forecasts: what jumps cost to learn, what requests cost after many readings, what bands hold.

`python -m benchmarks.methods.forecasts` takes some minutes, `--quick` one. All costs are ratios
within one run: to learning without jumps, to a request for 500 points of history, to a twin
with 1,000 readings.
"""

import argparse
import http.client
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from slowtime.dynamics.evolution_functions import mass_change
from slowtime.evolution.forecasting import forecast, scores
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus, Sample
from twin_server.__main__ import run
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

READINGS, JUMPS = 400, (0, 2, 5, 10, 20)
LONG_READINGS, LONG_JUMPS = 4_000, (0, 5, 20)
COST_OF_JUMPS = 3.0
"""Learning with 20 jumps over learning with none, at most."""

FOUND = 18
"""Of 20 jumps of 5 to 9 standard deviations, at least, in the median."""

LENGTHS = (1_000, 10_000, 100_000)
GROWTH, TO_HISTORY = 1.5, 3.0
"""A forecast after 100,000 readings over one after 1,000; and over 500 points of history."""

TIMED = 300
EVERY = 4
"""Requests, and after how many of them another reading has come."""

ORIGIN_NS = 1_767_225_600_000_000_000


def with_jumps(
    count: int, seed: int, readings: int = READINGS
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Make a drifting history with jumps at random: times, readings, their sds, jumps."""
    rng = np.random.default_rng([41, seed, count])
    time, sd = np.arange(float(readings)), 0.01
    gaps = rng.exponential(size=count + 1)
    room = readings - 8 * (count + 1)
    at = np.cumsum(8 + room * gaps / gaps.sum())[:count].astype(int)
    sizes = rng.choice([-1.0, 1.0], count) * rng.uniform(5.0, 9.0, count) * sd
    truth = -1e-4 * time + (sizes * (time[:, None] >= at)).sum(axis=1)
    return time, truth + sd * rng.standard_normal(readings), np.full(readings, sd), at


def jumps(seeds: int) -> bool:
    """Print what learning costs with jumps, and how many are found."""
    for count in (0, 20):
        forecast.fit(*with_jumps(count, 99)[:3])
    print(f"Learning from {READINGS} readings, jumps of 5 to 9 standard deviations")
    costs, passed = {}, True
    for count in JUMPS:
        spent, hits, wrong = [], [], 0
        for seed in range(seeds):
            time_, value, sd, at = with_jumps(count, seed)
            begun = time.process_time()
            outlook = forecast.fit(time_, value, sd)
            spent.append(time.process_time() - begun)
            found = np.array([since + 1.0 for since, _ in outlook.jumps])
            near = np.abs(found[:, None] - at) <= 2
            hits.append(int(near.any(axis=0).sum()))
            wrong += int((~near.any(axis=1)).sum())
        costs[count] = statistics.median(spent)
        ratio = costs[count] / costs[0]
        print(
            f"  {count:2d} jumps  {1e3 * costs[count]:8.1f} ms  x {ratio:6.2f}"
            f"   found {statistics.median(hits):4.1f}   false {wrong} in {seeds} histories"
        )
        passed &= count < 20 or statistics.median(hits) >= FOUND
    ratio = costs[20] / costs[0]
    print(f"  20 over none              {ratio:6.2f}      (held to {COST_OF_JUMPS})")
    return passed and ratio <= COST_OF_JUMPS


def long_histories() -> None:
    """Print what learning from a long history costs with jumps, over learning without."""
    forecast.fit(*with_jumps(LONG_JUMPS[-1], 99, LONG_READINGS)[:3])
    print(f"Learning from {LONG_READINGS} readings, processor time")
    plain = None
    for count in LONG_JUMPS:
        spent = []
        for seed in range(3):
            history = with_jumps(count, seed, LONG_READINGS)[:3]
            begun = time.process_time()
            forecast.fit(*history)
            spent.append(time.process_time() - begun)
        plain = plain or statistics.median(spent)
        ratio = statistics.median(spent) / plain
        print(
            f"  {count:2d} jumps  {statistics.median(spent):8.2f} s   x {ratio:6.2f}   aim 2.0"
        )


def message(asset: str, sequence: int) -> bytes:
    """One epoch of a structure that ages slowly, as an edge sends it."""
    rng = np.random.default_rng([7, sequence])
    t_ns = ORIGIN_NS + sequence * 10**9
    frequency = 3.0 * np.exp(-1e-7 * sequence) + 0.002 * rng.standard_normal()
    mode = Mode(
        frequency_hz=Quantity(value=float(frequency), sd=0.002),
        damping_ratio=Quantity(value=0.02, sd=0.001),
    )
    features = Features(
        site="load", asset=asset, boot="b1", sequence=sequence, t_ns=t_ns,
        start_ns=t_ns - 10**9, time_base="simulated", slow_time=float(sequence),
        method="ambient", modes=(mode,), quality=Quality(samples=6000),
    )  # fmt: skip
    return encode(features)


def samples(asset: str, first: int, last: int) -> Iterator[Sample]:
    """Messages of one twin, in order."""
    key = FEATURES.key("load", asset)
    for sequence in range(first, last):
        yield Sample(key, message(asset, sequence), None, True)


def requests(lengths: tuple[int, ...]) -> bool:
    """Print what a forecast costs after so many readings, while others arrive."""
    with tempfile.TemporaryDirectory() as folder:
        settings = TwinSettings(database=Path(folder) / "twin.sqlite", port=0)
        fill(settings, lengths)
        bus, stop, ready = MemoryBus(), threading.Event(), threading.Event()
        urls: list[str] = []

        def told(url: str) -> None:
            urls.append(url)
            ready.set()

        server = threading.Thread(
            target=lambda: run(settings, bus=bus, stop=stop, ready=told), daemon=True
        )
        server.start()
        ready.wait(120)
        door = http.client.HTTPConnection("127.0.0.1", int(urls[0].rsplit(":", 1)[1]))
        try:
            return timed(door, bus, lengths)
        finally:
            door.close()
            stop.set()
            server.join(60)


def fill(settings: TwinSettings, lengths: tuple[int, ...]) -> None:
    """Give each twin its history."""
    store = open_store(settings.database, synchronous="NORMAL")
    pipeline = Pipeline(settings, store)
    for length in lengths:
        nominal = {"frequency_hz": 3.0, "damping_ratio": 0.02}
        pipeline.register(f"load.n{length}", Registration.model_validate({"nominal": nominal}))
        pipeline.ingest(samples(f"n{length}", 0, length))
    store.close()


def timed(door: http.client.HTTPConnection, bus: MemoryBus, lengths: tuple[int, ...]) -> bool:
    """Ask each twin in turn, so that what else the machine does meets all alike."""

    def ask(path: str) -> float:
        begun = time.perf_counter()
        door.request("GET", f"/api/v1/twins/{path}")
        answer = door.getresponse()
        answer.read()
        if answer.status != 200:
            raise RuntimeError(f"{path} was answered by {answer.status}.")
        return time.perf_counter() - begun

    kinds: dict[str, Callable[[int], str]] = {
        "forecast": lambda n: f"load.n{n}/forecast?points=40",
        "threshold": lambda n: f"load.n{n}/forecast?points=40&threshold=-0.1",
        "history": lambda n: f"load.n{n}/history?max_points=500",
    }
    for path in kinds.values():
        for length in lengths:
            ask(path(length))
    spent: dict[tuple[str, int], list[float]] = {}
    for number in range(TIMED):
        for length in lengths:
            if number % EVERY == 0:
                sample = next(samples(f"n{length}", length + number // EVERY, 2**40))
                bus.publish(
                    sample.key, sample.payload, encoding=FEATURES.encoding, replayed=True
                )
                time.sleep(0.01)
            for kind, path in kinds.items():
                if kind == "history" and number % 10:
                    continue
                spent.setdefault((kind, length), []).append(ask(path(length)))
    print(f"\nRequests while a reading arrives every {EVERY}: median and p99 [ms]")
    for (kind, length), each in spent.items():
        p99 = float(np.quantile(each, 0.99))
        print(
            f"  {kind:10s} {length:8,d} readings {1e3 * np.median(each):8.1f} {1e3 * p99:8.1f}"
        )
    least, most = min(lengths), max(lengths)
    middle = {key: float(np.median(each)) for key, each in spent.items()}
    growth = middle["forecast", most] / middle["forecast", least]
    ratio = middle["forecast", most] / middle["history", least]
    print(f"  {most:,} over {least:,} readings   {growth:6.2f}      (held to {GROWTH})")
    print(f"  over 500 points of history {ratio:6.2f}      (held to {TO_HISTORY})")
    return growth <= GROWTH and ratio <= TO_HISTORY


TIME = np.linspace(0.0, 1000.0, 120)
PAST = TIME <= 750.0


def truths(number: int) -> tuple[str, np.ndarray, np.random.Generator]:
    """One of four kinds of history: drift, oscillation, sawtooth, jump."""
    rng = np.random.default_rng([43, number])

    def wander(share: float) -> np.ndarray:
        steps = rng.standard_normal(len(TIME)) / np.sqrt(len(TIME))
        return 1.0 + share * np.cumsum(steps)

    drift = np.cumsum(-rng.uniform(1e-4, 4e-4) * wander(0.5)) * (TIME[1] - TIME[0])
    period, phase = rng.uniform(60.0, 200.0), rng.uniform(0.0, 6.0)
    kind = ("drift", "oscillation", "sawtooth", "jump")[number % 4]
    if kind == "oscillation":
        wave = np.cos(2 * np.pi * TIME / period + phase)
        drift = drift + rng.uniform(0.02, 0.06) * wander(0.3) * wave
    elif kind == "sawtooth":
        teeth = mass_change(TIME, amplitude=rng.uniform(0.1, 0.3), rate=2 * np.pi / period)
        drift = teeth * wander(0.3)
    elif kind == "jump":
        step = rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.15)
        drift = drift + np.where(rng.uniform(300.0, 700.0) < TIME, step, 0.0)
    return kind, drift, rng


def bands(runs: int) -> bool:
    """Print how often 95 % bands hold what comes, and their score beside persistence."""
    found: dict[str, list[tuple[float, float, float]]] = {}
    for number in range(runs):
        kind, truth, rng = truths(number)
        sd = np.full(len(TIME), rng.uniform(0.005, 0.015))
        value = truth + sd * rng.standard_normal(len(TIME))
        past = TIME[PAST], value[PAST], sd[PAST]
        ahead = forecast.forecast(*past, TIME[~PAST])
        true = truth[~PAST]
        found.setdefault(kind, []).append(
            (
                float(scores.covered(true, ahead.lo, ahead.hi).mean()),
                float(scores.crps(true, ahead.mean, ahead.sd).mean()),
                float(np.abs(true - value[PAST][-1]).mean()),
            )
        )
    print(f"\nBands of 95 % over {runs} histories: held, score (CRPS), that of persistence")
    for kind, rows in found.items():
        held, own, stay = np.mean(rows, axis=0)
        print(f"  {kind:12s} {held:6.3f} {own:9.4f} {stay:9.4f}")
    pooled = float(np.mean([row[0] for rows in found.values() for row in rows]))
    print(f"  pooled       {pooled:6.3f}                      (held to 0.90 or more)")
    return pooled >= 0.90


def main(arguments: list[str] | None = None) -> int:
    """Print every figure; 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer histories and readings")
    asked = parser.parse_args(arguments)
    passed = jumps(5 if asked.quick else 20)
    long_histories()
    passed &= requests(LENGTHS[:2] if asked.quick else LENGTHS)
    passed &= bands(16 if asked.quick else 80)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
