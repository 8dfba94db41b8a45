"""Over real Zenoh: the router dies while features flow, and not one of them is lost."""

import json
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from edge_agent.__main__ import run
from edge_agent.settings import EdgeSettings
from slowtime.signals.block import Block
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Acknowledgement, Features, Health, TimeBase
from slowtime_schemas.streams import ACK, FEATURES, HEALTH, request_key
from slowtime_services.bus import ZenohBus

pytestmark = pytest.mark.system
RATE = 50.0
SECONDS = 6.0
ROUTER = "import sys; from slowtime_services.router import run; run([sys.argv[1]])"


class Ticking:
    """An epoch of 64 samples every 20 ms; half of them once the gate is open."""

    time_base: TimeBase = "live"
    slow_time_unit = "s"

    def __init__(self, gate):
        self.gate = gate

    def __iter__(self):
        rng = np.random.default_rng(0)
        for number in range(round(SECONDS * RATE)):
            if number == round(SECONDS * RATE / 2):
                self.gate.wait(300)
            time.sleep(1 / RATE)
            yield Block(
                samples=rng.standard_normal((64, 1)).astype("<f4"),
                rate_hz=6400.0,
                first_index=64 * number,
                start_ns=time.time_ns(),
                channels=("z",),
                units=("g",),
                epoch=number,
                slow_time=float(number),
            )
            yield None


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def eventually(condition, timeout_s=60.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def start_router(endpoint):
    return subprocess.Popen([sys.executable, "-c", ROUTER, endpoint])


def test_a_router_that_is_killed_and_comes_back_costs_no_feature(tmp_path):
    endpoint = free_endpoint()
    settings = EdgeSettings(
        site="lab",
        asset="beam",
        connect=(endpoint,),
        spool={"folder": tmp_path},
        extract={"method": "peak"},
        publish={"linger_s": 20.0, "health_every_s": 0.2},
    )
    live: dict[int, bytes] = {}
    last: list[Health] = []

    def hear(sample):
        live[Features.model_validate_json(sample.payload).sequence] = sample.payload

    router, gone = start_router(endpoint), threading.Event()
    status: list[int] = []
    edge = threading.Thread(
        target=lambda: status.append(
            run(settings, source=Ticking(gone), stop=threading.Event())
        )
    )
    try:
        with ZenohBus("client", [endpoint]) as twin:
            twin.subscribe(FEATURES.key("lab", "beam"), hear)
            twin.subscribe(
                HEALTH.key("lab", "beam"),
                lambda sample: last.append(Health.model_validate_json(sample.payload)),
            )
            edge.start()
            eventually(lambda: len(live) > 40)
            router.kill()
            router.wait()
            gone.set()
            time.sleep(2.0)
            router = start_router(endpoint)
            wanted = round(SECONDS * RATE)
            eventually(lambda: bool(last) and last[-1].last_sequence == wanted - 1)
            assert len(live) < wanted
            (held,) = (
                json.loads(sample.payload)
                for sample in twin.ask(request_key("lab", "beam", "account"))
            )
            assert (held["first"], held["last"]) == (0, wanted - 1)
            again = twin.ask(
                request_key("lab", "beam", "features"), {"boot": held["boot"]}, timeout_s=60.0
            )
            kept = [sample.payload for sample in again]
            assert [Features.model_validate_json(p).sequence for p in kept] == [*range(wanted)]
            assert all(kept[sequence] == payload for sequence, payload in live.items())
            word = Acknowledgement(
                site="lab", asset="beam", boot=held["boot"], sequence=wanted - 1, t_ns=0
            )
            twin.publish(ACK.key("lab", "beam"), encode(word), encoding=ACK.encoding)
            edge.join(60)
            assert not edge.is_alive()
            assert status == [0]
            assert list((tmp_path / "lab.beam").glob("*.spool")) == []
    finally:
        router.kill()
        router.wait()
        edge.join(60)
