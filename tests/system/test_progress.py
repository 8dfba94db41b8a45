"""One message stops neither the server nor others: real processes, real Zenoh on loopback."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from slowtime_schemas.codec import decode_sample
from slowtime_schemas.streams import ACK
from slowtime_services.bus import ZenohBus
from tests.twin_server.conftest import Edge, _features

from .conftest import PATIENCE_S, House, free_port

pytestmark = [pytest.mark.system, pytest.mark.long]

POISON = 7
"""Sequence of the message at which the estimation hangs."""


def messages(count: int, asset: str, first: int = 0) -> list[Any]:
    """Features of an asset, from a sequence on."""
    return [_features(n, asset=asset, frequency_hz=3.0 - 1e-4 * n) for n in range(first, count)]


class Servers:
    """Twin servers whose estimation hangs at one message, started and started again."""

    def __init__(self, house: House, how: str) -> None:
        self.house, self.how = house, how

    def start(self, name: str, port: int, *arguments: str, database: str = "twin") -> None:
        log = (self.house.home / f"{name}.log").open("ab")
        self.house._running[name] = subprocess.Popen(
            [
                sys.executable, "-m", "tests.system.hanging", self.how, "bad", str(POISON),
                "twin", "--connect", self.house.endpoint, "--port", str(port),
                "--database", str(self.house.home / f"{database}.sqlite"), *arguments,
            ],
            stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            cwd=Path(__file__).parents[2], env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        log.close()

    def at(self, port: int) -> House:
        """The same house, asked at another port."""
        other = House(self.house.home)
        other.url = f"http://127.0.0.1:{port}"
        return other


@pytest.fixture
def edges(house: House) -> Iterator[Any]:
    """Two edges on the bus, and the last sequence acknowledged to each."""
    house.router()
    acknowledged: dict[str, int] = {}
    with contextlib.ExitStack() as stack:
        bus = stack.enter_context(ZenohBus("client", connect=[house.endpoint]))

        def hear(sample: Any) -> None:
            ack = decode_sample(sample.key, sample.payload)
            acknowledged[ack.asset] = max(acknowledged.get(ack.asset, -1), ack.sequence)

        stack.callback(bus.subscribe(ACK.everywhere, hear).close)
        both = [Edge(bus, asset=asset) for asset in ("good", "bad")]
        for one in both:
            stack.callback(one.close)
        yield both, acknowledged


def features_of(house: House, twin_id: str) -> int:
    found = house.get(f"/api/v1/twins/{twin_id}/history/hash")
    return 0 if found is None else int(found["features"])


def test_a_step_over_its_budget_is_set_aside_and_the_leader_stays(house, edges):
    (good, bad), acknowledged = edges
    servers = Servers(house, "spin")
    config = house.home / "twin.json"
    config.write_text(json.dumps({"progress": {"step_s": 1.0, "step_s_per_message": 0.0}}))
    servers.start("twin", house.port, "--config", str(config))
    house.until(lambda: bool(house.get("/readyz")), "the server to be ready")
    pid = house._running["twin"].pid
    for message in messages(20, "bad"):
        bad.make(message)
    for message in messages(20, "good"):
        good.make(message)
    house.until(
        lambda: acknowledged.get("good") == 19 and acknowledged.get("bad") == 19,
        "both edges to have their acknowledgements",
    )
    assert house.get("/readyz") == {"status": "ok"}
    assert house._running["twin"].pid == pid
    assert house._running["twin"].poll() is None
    assert features_of(house, "lab.good") == features_of(house, "lab.bad") == 20
    aside = house.get("/api/v1/twins/lab.bad/quarantine")["messages"]
    assert [(one["sequence"], one["in_history"]) for one in aside] == [(POISON, True)]
    assert "processor time" in aside[0]["why"]


@pytest.mark.parametrize("how", ["hold", "wait"])
def test_a_step_that_never_returns_ends_the_process_and_a_standby_leads(house, edges, how):
    (good, bad), acknowledged = edges
    servers = Servers(house, how)
    standby_port = free_port()
    servers.start("leader", house.port)
    house.until(lambda: bool(house.get("/readyz")), "the leader to be ready")
    config = house.home / "standby.json"
    config.write_text(json.dumps({"standby": True}))
    servers.start("standby", standby_port, "--config", str(config))
    house.until(lambda: "Standing by" in house.said("standby"), "the standby to stand by")
    for message in messages(POISON, "bad"):
        bad.make(message)
    for message in messages(20, "good"):
        good.make(message)
    house.until(
        lambda: acknowledged.get("good") == 19 and acknowledged.get("bad") == POISON - 1,
        "what comes before the message to be acknowledged",
    )
    before = dict(acknowledged)
    sent_s = time.monotonic()
    bad.make(messages(POISON + 1, "bad", POISON)[0])
    house.until(lambda: house._running["leader"].poll() is not None, "the leader to end")
    took_s = time.monotonic() - sent_s
    print(f"{how}: the leader ended after {took_s:.1f} s")
    said = house.said("leader")
    assert "in estimate" in said  # its stack
    there = servers.at(standby_port)
    house.until(lambda: bool(there.get("/readyz")), "the standby to lead")
    for message in messages(30, "good", 20):
        good.make(message)
    for message in messages(20, "bad", POISON + 1):
        bad.make(message)
    house.until(
        lambda: acknowledged.get("good") == 29 and acknowledged.get("bad") == 19,
        "all to be acknowledged by the standby",
    )
    assert features_of(there, "lab.good") == 30
    assert features_of(there, "lab.bad") == 20
    assert before["good"] == 19
    aside = there.get("/api/v1/twins/lab.bad/quarantine")["messages"]
    assert [(one["sequence"], one["in_history"]) for one in aside] == [(POISON, True)]
    assert "HANGS" not in house.said("standby")  # it was not repeated
    assert took_s < 15.0 * _load()


def test_sigterm_ends_a_server_within_its_grace_time_while_a_step_hangs(house, edges):
    (_, bad), _ = edges
    servers = Servers(house, "hold")
    config = house.home / "twin.json"
    config.write_text(json.dumps({"shutdown_s": 1, "progress": {"silent_s": 600, "end_s": 4}}))
    servers.start("twin", house.port, "--config", str(config))
    house.until(lambda: bool(house.get("/readyz")), "the server to be ready")
    for message in messages(POISON + 1, "bad"):
        bad.make(message)
    house.until(lambda: "HANGS" in house.said("twin"), "the step to hang")
    process = house._running["twin"]
    process.send_signal(signal.SIGTERM)
    began_s = time.monotonic()
    process.wait(PATIENCE_S)
    took_s = time.monotonic() - began_s
    print(f"SIGTERM: ended after {took_s:.1f} s")
    assert took_s < 10.0 * _load()
    assert "has not ended 5 s after it was told to" in house.said("twin")


def _load() -> float:
    """Factor of time on a computer on which others work as well."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
