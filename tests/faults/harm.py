"""How each kind of fault is begun and ended."""

import contextlib
import json
import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable
from urllib.parse import urlparse

from slowtime_schemas.streams import FEATURES, HEALTH, ROOT
from slowtime_services.bus import BusUnreachableError, ZenohBus

from .history import databases, hold
from .house import House
from .schedule import FLEET, RATE_HZ, Fault

Undo = Callable[[], None]

POISON = (
    b"",
    b"\xff\xfe\x00",
    b"{",
    b"null",
    b"[" * 20_000,
    b'{"version": 999}',
    b'{"version": 2, "site": "lab", "asset": "nobody"}',
    b"9" * 5_000,
    b"x" * (2**20 + 1),
)


def inflict(fault: Fault, house: House) -> Undo:
    """Begin a fault; what is given back ends it."""
    return _KINDS[fault.kind](fault, house)


def _nothing() -> None:
    pass


def _signal(pid: int, number: signal.Signals) -> None:
    if pid:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def _kill(fault: Fault, house: House) -> Undo:
    names = house.shards if fault.who == FLEET else [fault.who]
    for pid in map(house.shard, names):
        _signal(pid, signal.SIGKILL)
    if fault.who in house.shards:
        return _nothing  # the front starts it again
    if fault.who == FLEET:
        house.down("twin", signal.SIGKILL)
        return lambda: house.up("twin")
    house.down(fault.who, signal.SIGKILL)
    return lambda: house.up(fault.who)


def _end(fault: Fault, house: House) -> Undo:
    if fault.who in house.shards:
        _signal(house.shard(fault.who), signal.SIGTERM)
        return _nothing
    house.down(fault.who, signal.SIGTERM)
    return lambda: house.up(fault.who)


def _freeze(fault: Fault, house: House) -> Undo:
    if fault.who in house.shards:
        pid = house.shard(fault.who)
        _signal(pid, signal.SIGSTOP)
        return lambda: _signal(pid, signal.SIGCONT)
    house.freeze(fault.who, True)
    return lambda: house.freeze(fault.who, False)


def _cut(fault: Fault, house: House) -> Undo:
    gate = house.gates[fault.who]
    gate.set(cut=True, stalled=False)
    return lambda: gate.set(cut=False, stalled=False)


def _stall(fault: Fault, house: House) -> Undo:
    gate = house.gates[fault.who]
    gate.set(cut=False, stalled=True)
    return lambda: gate.set(cut=False, stalled=False)


def _burst(fault: Fault, house: House) -> Undo:
    rate = house.rates[fault.who]
    rate.value = 10 * RATE_HZ

    def over() -> None:
        rate.value = min(rate.value, RATE_HZ)  # it may have been silenced meanwhile

    return over


def _clock(fault: Fault, house: House) -> Undo:
    clock = house.clocks[fault.who]
    clock.value = fault.amount

    def over() -> None:
        clock.value = 0.0

    return over


def _disk(fault: Fault, house: House) -> Undo:
    house.fill_disk(fault.who, 1)
    return lambda: house.fill_disk(fault.who, -1)


def _rot(fault: Fault, house: House) -> Undo:
    """Kill an edge, and flip a few bits of its spool before it starts again."""
    house.down(fault.who, signal.SIGKILL)
    rng = random.Random(fault.at_s)
    for path in sorted((house.home / "spool" / f"lab.{fault.who}").glob("*.spool")):
        data = bytearray(path.read_bytes())
        for _ in range(rng.randrange(3) if data else 0):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
    return lambda: house.up(fault.who)


def _lock(fault: Fault, house: House) -> Undo:
    parts = databases(house.database, house.plan.shards)
    return hold(parts[round(1000 * fault.at_s) % len(parts)])


def _poison(fault: Fault, house: House) -> Undo:
    rng = random.Random(fault.at_s)
    made, _ = house.ledger.snapshot()
    ours = [payload for (asset, _, _), payload in made.items() if asset == fault.who]
    payloads = list(POISON)
    for payload in rng.sample(ours, min(10, len(ours))):
        broken = bytearray(payload)
        for _ in range(3):
            broken[rng.randrange(len(broken))] = rng.randrange(256)
        # Whatever it has become, no account can know it for another than itself.
        payloads += [payload[: rng.randrange(len(payload))], _foreign(bytes(broken))]
    keys = [FEATURES.key("lab", fault.who), HEALTH.key("lab", fault.who), f"{ROOT}/x"]
    _send(house, [(rng.choice(keys), payload) for payload in payloads])
    return _nothing


def _foreign(payload: bytes) -> bytes:
    """Leave a payload that still reads as features of this asset unsaid."""
    try:
        content = json.loads(payload)
        return b"{}" if isinstance(content, dict) and "sequence" in content else payload
    except ValueError:
        return payload


def _echo(fault: Fault, house: House) -> Undo:
    """Send what was sent before again, shuffled, some of it twice."""
    rng = random.Random(fault.at_s)
    made, kept = house.ledger.snapshot()
    ours = [payload for key, payload in made.items() if key[0] == fault.who and key in kept]
    again = rng.choices(ours, k=60) if ours else []
    _send(house, [(FEATURES.key("lab", fault.who), payload) for payload in again])
    return _nothing


def _slow(fault: Fault, house: House) -> Undo:
    return _slow_subscriber(house) if fault.who == "bus" else _slow_client(house)


def _slow_subscriber(house: House) -> Undo:
    try:
        bus = ZenohBus("client", [house.endpoint], open_timeout_s=1.0)
    except BusUnreachableError:
        return _nothing
    bus.subscribe(f"{ROOT}/**", lambda _: time.sleep(0.5))
    return lambda: threading.Thread(target=bus.close, daemon=True).start()


def _slow_client(house: House) -> Undo:
    """Ask for the live stream and never read it."""
    where = urlparse(house.url())
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    try:
        client.settimeout(2.0)
        client.connect((where.hostname, where.port or 0))
        client.sendall(b"GET /api/v1/twins/lab.beam/live HTTP/1.1\r\nHost: x\r\n\r\n")
    except (OSError, TypeError):
        client.close()
        return _nothing
    return client.close


def _send(house: House, messages: list[tuple[str, bytes]]) -> None:
    with contextlib.suppress(BusUnreachableError):
        with ZenohBus("client", [house.endpoint], open_timeout_s=1.0) as bus:
            for key, payload in messages:
                bus.publish(key, payload, encoding="application/json")
            time.sleep(0.3)


_KINDS: dict[str, Callable[[Fault, House], Undo]] = {
    "kill": _kill, "end": _end, "freeze": _freeze, "cut": _cut, "stall": _stall,
    "burst": _burst, "poison": _poison, "echo": _echo, "clock": _clock, "disk": _disk,
    "lock": _lock, "rot": _rot, "slow": _slow,
}  # fmt: skip
