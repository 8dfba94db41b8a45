"""What a publication costs a router and a server beside many assets of one site.

    python -m benchmarks.processes.router_lookup                          1,000 and 10,000
    python -m benchmarks.processes.router_lookup --unwatched --assets 1000 100000
    python -m benchmarks.processes.router_lookup --former --assets 1000 4000

Agents, as sessions of 500 assets each, declare a token and a subscription to acknowledgements
for every asset, as edge agents do. A server subscribes to features and watches all tokens. Then
features of assets all over the site are published, and the processor time of the router and of
the server per message is taken from the kernel. The ratio is to the smallest number of assets;
the aim is at most 1.5. Each session waits until the router has worked off its declarations:
declared faster than that for five seconds, Zenoh closes the link, and all is declared again.
`--unwatched` leaves out that the server watches the tokens: Zenoh compares each new token with
all that match the same subscription to tokens, so that declaring takes a time that grows with
the square of the number of assets, at 100,000 more than 25 minutes of processor time.
`--former` measures keys of the former version, SITE/ASSET/STREAM, where
the time of a publication grows with the number of assets, and that of all declarations with
its square.
"""

import argparse
import functools
import multiprocessing
import multiprocessing.connection
import os
import sys
import time
from collections.abc import Callable

import zenoh

from slowtime_schemas.streams import ACK, FEATURES, alive_key, former_key
from slowtime_services import router
from slowtime_services.bus import BusUnreachableError, ZenohBus

from .transport import free_port

PER_SESSION = 500
"""Assets of one session: a session with more takes the longer for each declaration."""

PER_PROCESS = 25_000
"""Assets of one process of sessions."""

LEASE_S = 120.0
"""Time after which a silent process counts as gone [s]; a busy one may be silent for long."""

LEASE = {"transport/link/tx/lease": round(1000 * LEASE_S)}
"""The same for the router, in Zenoh's words."""

IDLE_S = 4
"""Seconds without work after which all declarations have been worked off."""

NOBODY = "slowtime/nobody"
"""A key that no process answers."""

PATIENCE_S = 1200.0
"""How long a router may take for what a session declares [s]; a busy one takes minutes."""

PAYLOAD = bytes(360)
"""As long as a features message of one mode."""

Pipe = multiprocessing.connection.Connection
Spell = Callable[[str], str]


def present(key: str) -> str:
    """Spell a key as the present version does."""
    return key


def former(key: str) -> str:
    """Spell a key as the former version did."""
    return former_key(key) or key


def cpu_s(pid: int | None) -> float:
    """Processor time of a process so far, of the system's part too [s]."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        user, system = file.read().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def agents(endpoint: str, spell: Spell, names: list[str], pipe: Pipe) -> None:
    """Declare what the agents of `names` declare, and hold it until told to end."""
    kept: list[object] = []
    channel: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(1)
    for begin in range(0, len(names), PER_SESSION):
        bus = _connected(endpoint)
        kept.append(bus)
        # A channel, since a callback has a thread: an agent of one asset can afford it.
        session = bus._session
        for name in names[begin : begin + PER_SESSION]:
            token = session.liveliness().declare_token(spell(alive_key("lab", name)))
            kept.append(token)
            kept.append(session.declare_subscriber(spell(ACK.key("lab", name)), channel))
        # A question to nobody is answered by the router, after what was declared before it.
        bus.ask(NOBODY, timeout_s=PATIENCE_S)
    pipe.send("declared")
    pipe.recv()
    os._exit(0)  # the kernel closes 50 sessions sooner than they say goodbye


def _connected(endpoint: str) -> ZenohBus:
    """Connect, and try again: a router that works off declarations lets nobody in meanwhile."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return ZenohBus("client", [endpoint], lease_s=LEASE_S)
        except BusUnreachableError:
            if time.monotonic() > until_s:
                raise


def server(endpoint: str, spell: Spell, watches: bool, pipe: Pipe) -> None:
    """Subscribe and watch as a twin server does; say how many features have come."""
    count = 0

    def hear(_: object) -> None:
        nonlocal count
        count += 1

    with ZenohBus("client", [endpoint], lease_s=LEASE_S) as bus:
        bus.subscribe(spell(FEATURES.everywhere), hear)
        if watches:
            bus.watch(spell(alive_key("*", "*")), lambda key, alive: None)
        pipe.send("listens")
        while pipe.recv() is not None:
            pipe.send(count)


def measure(
    assets: int, messages: int, spell: Spell, *, watches: bool = True
) -> tuple[float, float, float]:
    """Return the time of router and server a message [us], and the router's a declaration [us].

    The time of a message is the least of three passes: other processes of the machine, and
    declarations that are still being worked off, only add to it.
    """
    context = multiprocessing.get_context("spawn")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    routing = context.Process(
        target=router.run, args=([endpoint],), kwargs={"options": LEASE}, daemon=True
    )
    routing.start()
    processes, pipes = [routing], []

    def begin(work: Callable[..., None], *given: object) -> None:
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(endpoint, spell, *given, theirs))
        process.daemon = True
        process.start()
        processes.append(process)
        pipes.append(ours)

    names = [f"asset-{number}" for number in range(assets)]
    try:
        begin(server, watches)
        pipes[0].recv()
        before = cpu_s(routing.pid)
        for first in range(0, assets, PER_PROCESS):
            begin(agents, names[first : first + PER_PROCESS])
        for pipe in pipes[1:]:
            pipe.recv()
        busy = [routing.pid, processes[1].pid]
        settle(busy)
        declared_us = 1e6 * (cpu_s(routing.pid) - before) / assets
        with ZenohBus("client", [endpoint], lease_s=LEASE_S) as bus:
            passes = [publish(bus, names, messages, spell, pipes[0], busy) for _ in range(3)]
    finally:
        for process in processes[::-1]:
            process.kill()
    return *(min(times) for times in zip(*passes, strict=True)), declared_us


def publish(
    bus: ZenohBus,
    names: list[str],
    messages: int,
    spell: Spell,
    pipe: Pipe,
    busy: list[int | None],
) -> list[float]:
    """Publish features all over the site; the time of each process a message [us]."""
    keys = [spell(FEATURES.key("lab", name)) for name in names]
    stride = max(1, len(keys) // messages)
    count = functools.partial(_told, pipe)
    began, before = count(), [cpu_s(pid) for pid in busy]
    for number in range(messages):
        bus.publish(keys[number * stride % len(keys)], PAYLOAD, encoding=FEATURES.encoding)
    deadline = time.monotonic() + 120.0
    while count() - began < messages:
        if time.monotonic() > deadline:
            raise TimeoutError(f"{count() - began} of {messages} messages came.")
        time.sleep(0.05)
    return [1e6 * (cpu_s(pid) - was) / messages for pid, was in zip(busy, before, strict=True)]


def _told(pipe: Pipe) -> int:
    pipe.send("count")
    return int(pipe.recv())


def settle(pids: list[int | None]) -> None:
    """Wait until the processes have worked off what they were told."""
    before, idle = -1.0, 0
    while idle < IDLE_S:
        time.sleep(1.0)
        now = sum(map(cpu_s, pids))
        idle = idle + 1 if now - before < 0.1 else 0
        before = now


def main() -> int:
    """Print a line for each number of assets."""
    parser = argparse.ArgumentParser(description="Cost of a publication at a router.")
    parser.add_argument("--assets", type=int, nargs="+", default=[1_000, 10_000])
    parser.add_argument("--messages", type=int, default=20_000)
    parser.add_argument("--former", action="store_true")
    parser.add_argument("--unwatched", action="store_true")
    given = parser.parse_args()
    spell = former if given.former else present
    least = None
    for assets in given.assets:
        began = time.monotonic()
        at_router, at_server, declared = measure(
            assets, given.messages, spell, watches=not given.unwatched
        )
        least = least or at_router
        print(
            f"{assets:>8,} assets: router {at_router:7.1f} us/message, ratio "
            f"{at_router / least:5.2f} (aim 1.5); server {at_server:6.1f} us/message; router "
            f"{declared:6.0f} us/asset declared; {time.monotonic() - began:.0f} s in all",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
