"""What messages of other shards' assets cost: the router, and each shard that drops them.

    python -m benchmarks.processes.fan_out --shards 1 2 4 8

Each shard subscribes to the features of all assets, as shards do, and drops all of them, as it
does with those of others. Printed is the processor time of the router, and of one shard, per
message, from the kernel, each as the least of three passes. `docs/shards.md` computes from them
how many assets shards of one router can have.
"""

import argparse
import multiprocessing
import os
import sys
import time
from multiprocessing.connection import Connection

from slowtime_schemas.streams import FEATURES
from slowtime_services import router
from slowtime_services.bus import PartialBus, Sample, ZenohBus

from .router_lookup import PAYLOAD, cpu_s
from .transport import free_port

LAST = "last"
"""Asset whose message is taken, and shows that all before it have arrived."""

PATIENCE_S = 120.0
"""How long a pass may take [s]."""


def shard(endpoint: str, pipe: Connection) -> None:
    """Drop what arrives; tell when the last of a pass has."""

    def hear(_: Sample) -> None:
        pipe.send("last")

    with ZenohBus("client", [endpoint]) as bus:
        PartialBus(bus, lambda asset: asset == LAST).subscribe(FEATURES.everywhere, hear)
        pipe.send("listens")
        pipe.recv()
        os._exit(0)


def measure(shards: int, messages: int) -> tuple[float, float]:
    """Return the processor time of the router, and of one shard, per message [us]."""
    context = multiprocessing.get_context("spawn")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    routing = context.Process(target=router.run, args=([endpoint],), daemon=True)
    routing.start()
    started = [routing]
    pipes = []
    try:
        for _ in range(shards):
            ours, theirs = context.Pipe()
            process = context.Process(target=shard, args=(endpoint, theirs), daemon=True)
            process.start()
            started.append(process)
            pipes.append(ours)
        for pipe in pipes:
            pipe.recv()
        pids = [process.pid for process in started]
        with ZenohBus("client", [endpoint], open_timeout_s=30.0) as bus:
            passes = [publish(bus, messages, pids, pipes) for _ in range(3)]
    finally:
        for process in started[::-1]:
            process.kill()
    at_router, *at_shards = (min(times) for times in zip(*passes, strict=True))
    return at_router, sum(at_shards) / shards


def publish(
    bus: ZenohBus, messages: int, pids: list[int | None], pipes: list[Connection]
) -> list[float]:
    """Publish one pass; return the time of each process per message [us]."""
    keys = [FEATURES.key("lab", f"asset-{number}") for number in range(1000)]
    before = [cpu_s(pid) for pid in pids]
    for number in range(messages):
        bus.publish(keys[number % len(keys)], PAYLOAD, encoding=FEATURES.encoding)
    bus.publish(FEATURES.key("lab", LAST), PAYLOAD, encoding=FEATURES.encoding)
    until_s = time.monotonic() + PATIENCE_S
    for pipe in pipes:
        if not pipe.poll(max(0.0, until_s - time.monotonic())):
            raise TimeoutError(f"The last of {messages} messages did not come to every shard.")
        pipe.recv()
    return [1e6 * (cpu_s(pid) - was) / messages for pid, was in zip(pids, before, strict=True)]


def main() -> int:
    """Print a line for each number of shards."""
    parser = argparse.ArgumentParser(description="Cost of messages to shards that drop them.")
    parser.add_argument("--shards", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--messages", type=int, default=50_000)
    given = parser.parse_args()
    for shards in given.shards:
        at_router, at_shard = measure(shards, given.messages)
        print(
            f"{shards:>3} shards: router {at_router:5.1f} us/message, each shard "
            f"{at_shard:5.1f} us/message dropped; load {os.getloadavg()[0]:.0f}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
