"""What carrying and keeping costs, as ratios to the bare libraries in the same run.

`python -m benchmarks.processes.transport` takes less than a minute. A ratio of 1 means that our
part costs nothing beside the library's; the aim stands beside it.
"""

import contextlib
import itertools
import math
import multiprocessing
import multiprocessing.connection
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import zenoh
from mcap.reader import make_reader
from mcap.writer import Writer

from slowtime_schemas.codec import decode, decode_sample, encode
from slowtime_schemas.messages import Acknowledgement, Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import ACK, FEATURES
from slowtime_services.bus import Bus, Inbox, MemoryBus, Sample, ZenohBus
from slowtime_services.feature_runs import run_and_sequence
from slowtime_services.record import Recorder, RecordingWriter
from slowtime_services.record.recovery import repack
from slowtime_services.replay import read_recording, replay

COUNT = 20_000
SLOW = 3_000
"""Messages of the recording that is flushed at each of them [1]."""
KEY = FEATURES.key("lab", "beam")


def features() -> list[bytes]:
    """Make features messages as an edge sends them."""
    made = []
    for i in range(COUNT):
        mode = Mode(
            frequency_hz=Quantity(value=3 + i / 7e6, sd=0.0021456789),
            damping_ratio=Quantity(value=0.0213456789, sd=0.000912345),
            snr_db=31.72345,
        )
        message = Features(
            site="lab",
            asset="beam",
            boot="b1",
            sequence=i,
            t_ns=1_700_000_000_000_000_000 + i,
            start_ns=0,
            slow_time=i / 7,
            method="ambient",
            modes=(mode,),
            quality=Quality(samples=5000),
        )
        made.append(encode(message))
    return made


def seconds(*functions: Callable[[], object], rounds: int = 3) -> list[float]:
    """Median time of each function, run in turn so that they share the weather [s]."""
    times: list[list[float]] = [[] for _ in functions]
    for _ in range(rounds):
        for function, kept in zip(functions, times, strict=True):
            began = time.perf_counter()
            function()
            kept.append(time.perf_counter() - began)
    return [statistics.median(kept) for kept in times]


def say(what: str, ours: float, bare: float, aim: str = "-") -> None:
    """Print both rates and their ratio."""
    print(
        f"{what:<66} {COUNT / ours:>9,.0f}/s  bare {COUNT / bare:>9,.0f}/s"
        f"  ratio {bare / ours:5.2f}  aim {aim}"
    )


def compare_decoding(payloads: list[bytes]) -> None:
    """Set our decoder beside pydantic alone."""

    def ours() -> None:
        for payload in payloads:
            decode(FEATURES, payload)

    def bare() -> None:
        for payload in payloads:
            Features.model_validate_json(payload)

    with_us, alone = seconds(ours, bare)
    say("decode / model_validate_json", with_us, alone, "0.80")


def compare_writing(payloads: list[bytes], folder: Path) -> None:
    """Set our writer and recorder beside mcap's writer."""
    numbers = itertools.count()

    def new_path() -> Path:
        return folder / f"{next(numbers)}.mcap"

    def bare() -> None:
        with new_path().open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("features", "jsonschema", b"{}")
            channel = writer.register_channel(KEY, "json", schema)
            for i, payload in enumerate(payloads):
                writer.add_message(channel, i, payload, i, i)
            writer.finish()  # type: ignore[no-untyped-call]

    def record() -> None:
        bus = MemoryBus()
        with Recorder(bus, new_path()) as recorder:
            for payload in payloads:
                bus.publish(KEY, payload, encoding=FEATURES.encoding)
        assert recorder.recording.counts == {"features": COUNT}

    written, recorded, floor = seconds(lambda: write(new_path(), payloads), record, bare)
    say("RecordingWriter / mcap writer", written, floor, "0.50")
    say("bus, inbox, thread, file / mcap writer", recorded, floor)


def write(path: Path, payloads: list[bytes]) -> Path:
    """Write a recording."""
    with RecordingWriter(path) as writer:
        for i, payload in enumerate(payloads):
            writer.write(FEATURES, "lab", "beam", payload, i, i)
    return path


def read_bare(path: Path) -> None:
    """Read with mcap alone, in file order."""
    with path.open("rb") as file:
        for _ in make_reader(file).iter_messages(log_time_order=False):
            pass


def compare_reading(path: Path) -> None:
    """Set our reader, with and without decoding, beside mcap's."""

    def decoded() -> None:
        for message in read_recording(path):
            decode_sample(message.key, message.payload)

    def read() -> None:
        for _ in read_recording(path):
            pass

    def played() -> None:
        replay(path, MemoryBus(), speed=math.inf, window=2 * COUNT, patience_s=0.0)

    ours, with_replay, with_decoding, bare = seconds(
        read, played, decoded, lambda: read_bare(path)
    )
    say("read_recording / mcap reader", ours, bare, "0.50")
    say("replay onto a bus nobody hears / mcap reader", with_replay, bare, "0.50")
    say("read_recording and decode / mcap reader", with_decoding, bare)


def compare_chunks(payloads: list[bytes], folder: Path) -> None:
    """Set a recording flushed at each message, live and closed, beside one of large chunks."""

    def read(path: Path) -> None:
        for _ in read_recording(path):
            pass

    whole, slow = write(folder / "whole.mcap", payloads), folder / "slow.mcap"
    with RecordingWriter(slow) as writer:
        for i, payload in enumerate(payloads):
            writer.write(FEATURES, "lab", "beam", payload, i * 10**9, i * 10**9)
            writer.flush()
    for state in ("live", "closed"):
        if state == "closed":
            repack(slow)
        spent = [1e6 * took / len(payloads) for took in processor_seconds(slow, whole, read)]
        size = [path.stat().st_size / len(payloads) for path in (slow, whole)]
        print(
            f"a slow feature of a {state} recording: {size[0]:.0f} bytes, {spent[0]:.1f} us; "
            f"in large chunks {size[1]:.0f} bytes, {spent[1]:.1f} us: ratios "
            f"{size[0] / size[1]:.2f}, {spent[0] / spent[1]:.2f}, aim closed 1.50"
        )


def processor_seconds(
    one: Path, other: Path, read: Callable[[Path], None]
) -> tuple[float, float]:
    """Least processor time of reading each of two files, in turn [s]."""
    times: dict[Path, list[float]] = {one: [], other: []}
    for _ in range(3):
        for path, kept in times.items():
            began = time.process_time()
            read(path)
            kept.append(time.process_time() - began)
    return min(times[one]), min(times[other])


def compare_replay(path: Path, endpoint: str) -> None:
    """Set a whole replay, decoded and confirmed at the other end, beside the bare reader."""
    (bare,) = seconds(lambda: read_bare(path))
    with MemoryBus() as near, MemoryBus(joins=near) as far:
        say("replay in memory, confirmed / mcap reader", confirmed(path, near, far), bare)
    with ZenohBus("client", [endpoint]) as one, ZenohBus("client", [endpoint]) as other:
        say("replay over Zenoh, confirmed / mcap reader", confirmed(path, one, other), bare)


def confirmed(path: Path, sender: Bus, receiver: Bus) -> float:
    """Time of a replay to a receiver that decodes and acknowledges all of it [s]."""
    inbox: Inbox[bytes] = Inbox(max_items=COUNT)
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            batch = [decode(FEATURES, payload) for payload in inbox.take(500, timeout_s=0.05)]
            if batch:
                ack = Acknowledgement(
                    site="lab", asset="beam", boot="b1", sequence=batch[-1].sequence, t_ns=0
                )
                receiver.publish(ACK.key("lab", "beam"), encode(ack), encoding=ACK.encoding)

    def arrive(sample: Sample) -> None:
        inbox.put(sample.payload)

    receiver.subscribe(KEY, arrive)
    thread = threading.Thread(target=work)
    thread.start()
    played = replay(path, sender, speed=math.inf)
    stop.set()
    thread.join()
    assert played.complete, played
    return played.duration_s


def hear(endpoint: str, bare: bool, pipe: multiprocessing.connection.Connection) -> None:
    """Be the far end of a replay in a process of its own, and report when all was heard.

    Of ours, each message is confirmed by its sequence, as a twin does; of the bare peer, the
    payloads are counted.
    """
    heard = threading.Event()
    if bare:
        session, count = zenoh.open(bare_config(endpoint)), itertools.count(1)
        channel: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(2048)
        entity = session.declare_subscriber(KEY, channel)
        pipe.send("listening")
        while next(count) <= COUNT:
            (entity.handler.try_recv() or entity.handler.recv()).payload.to_bytes()
    else:
        bus = ZenohBus("client", [endpoint])

        def arrive(sample: Sample) -> None:
            known = run_and_sequence(sample.key, sample.payload)
            assert known is not None
            last = known[1] == COUNT - 1
            if last or known[1] % 500 == 499:
                ack = Acknowledgement(
                    site="lab", asset="beam", boot="b1", sequence=known[1], t_ns=0
                )
                bus.publish(ACK.key("lab", "beam"), encode(ack), encoding=ACK.encoding)
            if last:
                heard.set()

        bus.subscribe(KEY, arrive)
        pipe.send("listening")
        heard.wait()
    pipe.send("heard")
    pipe.recv()
    if bare:
        session.close()  # type: ignore[no-untyped-call]
    else:
        bus.close()


def until_heard(path: Path, endpoint: str, *, bare: bool) -> tuple[float, float]:
    """Time until the far end has heard all, and processor time of router and sender [s]."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=hear, args=(endpoint, bare, there))
    process.start()
    here.recv()
    session, bus = zenoh.open(bare_config(endpoint)), ZenohBus("client", [endpoint])
    time.sleep(0.3)
    began, spent = time.perf_counter(), time.process_time()
    if bare:
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                session.put(
                    channel.topic, message.data,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )  # fmt: skip
    else:
        assert replay(path, bus, speed=math.inf, window=5_000).complete
    here.recv()
    taken = time.perf_counter() - began, time.process_time() - spent
    here.send("enough")
    process.join()
    session.close()  # type: ignore[no-untyped-call]
    bus.close()
    return taken


def compare_heard(path: Path, endpoint: str, rounds: int = 5) -> None:
    """Set a replay as it is heard in another process beside the bare reader, over Zenoh too."""
    times: dict[str, list[tuple[float, float]]] = {"ours": [], "zenoh": [], "reader": []}
    for _ in range(rounds):
        times["ours"].append(until_heard(path, endpoint, bare=False))
        times["zenoh"].append(until_heard(path, endpoint, bare=True))
        began, spent = time.perf_counter(), time.process_time()
        read_bare(path)
        times["reader"].append((time.perf_counter() - began, time.process_time() - spent))
    for i, kind in enumerate(("", ", CPU of sender and router")):
        ours, over_zenoh, reader = (
            statistics.median(taken[i] for taken in times[name]) for name in times
        )
        say(f"replay heard far away{kind} / reader + Zenoh", ours, over_zenoh, "0.30")
        say(f"replay heard far away{kind} / mcap reader", ours, reader, "0.30")


def listen(endpoint: str, bare: bool, pipe: multiprocessing.connection.Connection) -> None:
    """Receive in a process of its own, and report the one-way latencies [ns]."""
    latencies: list[int] = []

    def keep(payload: bytes) -> None:
        latencies.append(time.monotonic_ns() - struct.unpack_from("<q", payload)[0])

    if bare:
        session = zenoh.open(bare_config(endpoint))
        session.declare_subscriber(KEY, lambda sample: keep(sample.payload.to_bytes()))
    else:
        bus = ZenohBus("client", [endpoint])
        bus.subscribe(KEY, lambda sample: keep(sample.payload))
    pipe.send("listening")
    pipe.recv()
    pipe.send(latencies)
    if bare:
        session.close()  # type: ignore[no-untyped-call]
    else:
        bus.close()


def free_port() -> int:
    """Find a port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@contextlib.contextmanager
def running_router() -> Iterator[str]:
    """Run a router of this machine, and give its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = subprocess.Popen(
        [sys.executable, "-m", "slowtime_cli", "router", "--listen", endpoint],
        stdout=subprocess.DEVNULL,
    )
    try:
        time.sleep(2.0)
        yield endpoint
    finally:
        router.terminate()
        router.wait()


def bare_config(endpoint: str) -> zenoh.Config:
    """Configure a client with nothing but where to connect."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def latency(endpoint: str, *, bare: bool, rate_hz: int = 500, count: int = 1000) -> list[float]:
    """One-way latency through a router, sorted, without the first tenth [us]."""
    here, there = multiprocessing.get_context("spawn").Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=listen, args=(endpoint, bare, there)
    )
    process.start()
    here.recv()
    session = zenoh.open(bare_config(endpoint))
    bus = ZenohBus("client", [endpoint])
    time.sleep(0.3)
    for _ in range(count):
        payload = struct.pack("<q", time.monotonic_ns()) + bytes(348)
        if bare:
            session.put(KEY, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        else:
            bus.publish(KEY, payload, encoding=FEATURES.encoding)
        time.sleep(1 / rate_hz)
    time.sleep(0.2)
    here.send("enough")
    received = here.recv()
    process.join()
    session.close()  # type: ignore[no-untyped-call]
    bus.close()
    assert len(received) == count
    return sorted(ns / 1e3 for ns in received[count // 10 :])


def compare_latency(endpoint: str) -> None:
    """Set our bus beside bare Zenoh, process to process through a router."""
    ours, bare = latency(endpoint, bare=False), latency(endpoint, bare=True)
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        mine, theirs = (kept[round(share * (len(kept) - 1))] for kept in (ours, bare))
        print(
            f"{'one-way latency ' + name + ', 356 B, 500/s':<66} {mine:>9,.0f} us"
            f"  bare {theirs:>9,.0f} us  ratio {theirs / mine:5.2f}  aim 0.80"
        )


def main() -> None:
    """Print every ratio."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    payloads = features()
    print(f"{COUNT:,} features messages of {len(payloads[0])} bytes")
    compare_decoding(payloads)
    with tempfile.TemporaryDirectory() as folder, ZenohBus("router", listen=[endpoint]):
        compare_writing(payloads, Path(folder))
        compare_chunks(payloads[:SLOW], Path(folder))
        path = write(Path(folder) / "features.mcap", payloads)
        compare_reading(path)
        compare_replay(path, endpoint)
        compare_heard(path, endpoint)
        compare_latency(endpoint)


if __name__ == "__main__":
    main()
