"""Sensors that exist, or nearly: real processes from the device to REST."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from slowtime_services.board import COUNT_M_PER_S2, Board
from slowtime_services.board.senders import lines_of
from tests.edge_agent.acquire.live.sysfs import scan, tree

from .conftest import free_port

pytestmark = [pytest.mark.system, pytest.mark.long]
FREQUENCY_HZ, RATE_HZ = 5.0, 125.0
EXTRACT = {"window_s": 8.0, "band_hz": [3.0, 8.0], "channels": ["x", "y"]}
NOMINAL = {"frequency_hz": FREQUENCY_HZ, "damping_ratio": 0.01}
CSV = {
    "kind": "csv",
    "counter": {"at": 0, "bits": 32},
    "channels": [{"name": name, "scale": COUNT_M_PER_S2} for name in "xyz"],
}
JSON = {"kind": "json", "counter": {"at": "n"}, "channels": CSV["channels"]}


def begin(house, source, name="edge", **more):
    """Router, twin registered with its nominal model, and an edge that listens."""
    house.router()
    house.twin()
    house.put("/api/v1/twins/lab.bridge", {"changes": "stiffness", "nominal": NOMINAL})
    settings = {"kind": "live", "source": source, "rate_hz": RATE_HZ, **more}
    house.edge({"site": "lab", "asset": "bridge", "input": settings, "extract": EXTRACT}, name)


def state_of(house):
    return house.get("/api/v1/twins/lab.bridge") or {}


def until_valid(house, readings=2):
    """Wait for a valid state at the frequency of the structure, and give it."""

    def holds():
        now = state_of(house)
        return bool(now.get("valid")) and now.get("sequence", -1) >= readings - 1

    house.until(holds, "a valid state")
    state = state_of(house)
    assert state["frequency_hz"]["value"] == pytest.approx(FREQUENCY_HZ, rel=0.05)
    house.until(lambda: bool(state_of(house).get("sensor")), "health of the sensor")
    return state_of(house)


def publish(house, to, *more, name="board"):
    house.start(
        name, "publish", "--to", to, "--frequency-hz", str(FREQUENCY_HZ),
        "--rate-hz", str(RATE_HZ), "--connect", house.endpoint, *more,
    )  # fmt: skip


def events(house, kind):
    found = house.get("/api/v1/twins/lab.bridge/events") or {"events": []}
    return [event for event in found["events"] if event["kind"] == kind]


class Broker:
    """Mosquitto, as Debian packages it."""

    def __init__(self, home: Path) -> None:
        program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
        if program is None:
            pytest.skip("mosquitto is not installed: apt-get install mosquitto")
        self.port, self._program, self._home = free_port(), program, home
        self.url = f"mqtt://127.0.0.1:{self.port}/bridge/accel"
        self.start()

    def start(self) -> None:
        config = self._home / "mosquitto.conf"
        config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\n")
        with (self._home / "broker.log").open("ab") as log:
            self._process = subprocess.Popen([self._program, "-c", str(config)], stderr=log)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.05)
        pytest.fail("The broker does not listen.")

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def broker(tmp_path):
    broker = Broker(tmp_path)
    yield broker
    broker.kill()


def test_a_board_on_mqtt_ends_in_a_valid_twin(house, broker):
    begin(house, broker.url, layout=JSON)
    publish(house, broker.url, "--setting", "loss=0.02")
    state = until_valid(house)
    assert state["sensor"]["samples_received"] > 500
    house.until(lambda: state_of(house)["sensor"]["samples_lost"] > 0, "losses to be told")
    house.until(lambda: bool(events(house, "samples_lost")), "an event of losses")


def test_a_broker_that_is_killed_for_ten_seconds_costs_what_was_sent_meanwhile(house, broker):
    begin(house, broker.url, layout=JSON, silent_after_s=4.0)
    publish(house, broker.url)
    until_valid(house, readings=1)
    broker.kill()
    house.until(lambda: bool(events(house, "sensor_silent")), "an event of the silence")
    time.sleep(5.0)
    broker.start()
    house.until(lambda: bool(events(house, "sensor_back")), "the sensor to be back")
    before = state_of(house)["sequence"]
    house.until(lambda: state_of(house)["sequence"] > before + 1, "features after it")
    sensor = state_of(house)["sensor"]
    assert sensor["sensor_reconnects"] >= 1
    assert sensor["sensor_restarts"] == sensor["samples_refused"] == 0
    assert state_of(house)["valid"]


def test_lines_over_tcp_end_in_a_valid_twin(house):
    port = free_port()
    begin(house, f"tcp-listen://127.0.0.1:{port}", layout=CSV)
    house.until(lambda: "boot" in house.said("edge"), "the edge to listen")
    publish(house, f"tcp://127.0.0.1:{port}")
    assert until_valid(house)["sensor"]["garbage_bytes"] == 0


def test_a_program_that_publishes_samples_on_the_bus_ends_in_a_valid_twin(house):
    begin(house, "zenoh:")
    publish(house, "zenoh:lab/bridge")
    until_valid(house)


def test_what_another_program_prints_ends_in_a_valid_twin(house):
    house.router()
    house.twin()
    house.put("/api/v1/twins/lab.bridge", {"changes": "stiffness", "nominal": NOMINAL})
    config = house.home / "edge.json"
    config.write_text(
        json.dumps(
            {
                "connect": [house.endpoint], "site": "lab", "asset": "bridge",
                "extract": EXTRACT, "spool": {"folder": str(house.home / "spool")},
                "input": {
                    "kind": "live", "source": "stdin:", "layout": CSV, "rate_hz": RATE_HZ,
                },
            }
        )
    )  # fmt: skip
    slowtime = f"{sys.executable} -m slowtime_cli"
    line = (
        f"{slowtime} publish --to - --frequency-hz {FREQUENCY_HZ} --setting seconds=26 | "
        f"{slowtime} edge --config {config} > {house.home}/edge.log 2>&1"
    )
    piped = subprocess.Popen(["sh", "-c", line], cwd=house.home)
    try:
        until_valid(house)
        assert piped.wait(120) == 0
    finally:
        piped.kill()


def played(write, seconds, garbage=b""):
    """Play the lines of a board at their pace."""
    board = Board(rate_hz=RATE_HZ, frequency_hz=FREQUENCY_HZ)
    began = time.monotonic()
    for n, readings in enumerate(board.readings(25, np.random.default_rng(1))):
        time.sleep(max(0.0, began + (n + 1) * 0.2 - time.monotonic()))
        if n * 0.2 > seconds:
            return
        write(lines_of(readings))
        if garbage and n == 20:
            write(garbage)


def test_a_serial_port_with_garbage_on_it_ends_in_a_valid_twin(house):
    ours, theirs = os.openpty()
    os.set_blocking(ours, True)
    begin(house, f"serial://{os.ttyname(theirs)}?baud=115200", layout=CSV)
    house.until(lambda: "boot" in house.said("edge"), "the edge to listen")
    garbage = bytes(range(128, 256)) * 4 + b"\n"
    played(lambda data: os.write(ours, data), 26.0, garbage)
    state = until_valid(house)
    assert state["sensor"]["garbage_bytes"] >= 500
    os.close(ours)
    os.close(theirs)


def test_a_board_of_industrial_io_ends_in_a_valid_twin(house, tmp_path):
    root = tmp_path / "root"
    tree(root, rate_hz=RATE_HZ)
    settings = {
        "kind": "live", "source": "iio:///adxl355", "sysfs": str(root),
    }  # fmt: skip
    house.router()
    house.twin()
    house.put("/api/v1/twins/lab.bridge", {"changes": "stiffness", "nominal": NOMINAL})
    extract = EXTRACT | {"channels": ["accel_x", "accel_y"]}
    house.edge({"site": "lab", "asset": "bridge", "input": settings, "extract": extract})
    board, began_ns = Board(rate_hz=RATE_HZ, frequency_hz=FREQUENCY_HZ), time.time_ns()
    with (root / "dev/iio:device0").open("wb", buffering=0) as node:
        for readings in board.readings(25, np.random.default_rng(1)):
            taken_ns = began_ns + round((readings.counter + 25) * 1e9 / RATE_HZ)
            time.sleep(max(0.0, (taken_ns - time.time_ns()) / 1e9))
            if readings.counter > 26 * RATE_HZ:
                break
            for n, counts in enumerate(readings.counts.tolist()):
                stamp = began_ns + round((readings.counter + n) * 1e9 / RATE_HZ)
                node.write(scan(counts, stamp))
        state = until_valid(house)
    assert state["sensor"]["samples_lost"] == 0


def test_a_silent_sensor_is_an_alarm_and_its_return_an_event(house):
    port = free_port()
    begin(house, f"udp://127.0.0.1:{port}", layout=CSV, silent_after_s=3.0)
    house.until(lambda: "boot" in house.said("edge"), "the edge to listen")
    publish(house, f"udp://127.0.0.1:{port}", "--seconds", "14")
    until_valid(house, readings=1)
    house.until(lambda: state_of(house)["sensor"]["sensor_silent_s"] >= 3, "the silence")
    house.until(lambda: bool(events(house, "sensor_silent")), "an event of the silence")
    assert events(house, "sensor_silent")[0]["severity"] == "alarm"
    publish(house, f"udp://127.0.0.1:{port}", name="board-again")
    house.until(lambda: state_of(house)["sensor"]["sensor_silent_s"] == 0, "the sensor")
    house.until(lambda: bool(events(house, "sensor_back")), "an event of its return")
    house.until(lambda: state_of(house)["sensor"]["sensor_restarts"] == 1, "its restart")


def test_a_minute_of_silence_costs_its_own_samples_only_and_all_of_them_are_counted(house):
    """The device goes on counting while its cable is out for 60 s."""
    port, quiet_s = free_port(), 60.0
    begin(house, f"udp://127.0.0.1:{port}", layout=CSV, silent_after_s=3.0)
    house.until(lambda: "boot" in house.said("edge"), "the edge to listen")
    board, sent, unsent = Board(rate_hz=RATE_HZ, frequency_hz=FREQUENCY_HZ), 0, 0
    began = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as cable:
        for n, readings in enumerate(board.readings(25, np.random.default_rng(1))):
            at_s = 0.2 * (n + 1)
            if at_s > quiet_s + 60.0:
                break
            time.sleep(max(0.0, began + at_s - time.monotonic()))
            if 30.0 < at_s <= 30.0 + quiet_s:
                unsent += 25
                continue
            cable.sendto(lines_of(readings), ("127.0.0.1", port))
            sent += 25
        house.until(lambda: bool(events(house, "sensor_back")), "an event of its return")
        house.until(
            lambda: state_of(house)["sensor"]["samples_received"] >= sent, "all that was sent"
        )
    sensor = state_of(house)["sensor"]
    assert unsent == round(quiet_s * RATE_HZ)
    assert (sensor["samples_received"], sensor["samples_lost"]) == (sent, unsent)
    assert sensor["sensor_silences"] == len(events(house, "sensor_silent")) == 1
    assert sensor["sensor_restarts"] == sensor["samples_refused"] == 0
    assert events(house, "sensor_back")[0]["details"]["silent_s"] >= quiet_s - 5
    history = house.history("lab.bridge")
    assert [point["sequence"] for point in history] == list(range(len(history)))
    assert all(point["missing_before"] == 0 for point in history)
    house.until(lambda: bool(state_of(house)["valid"]), "a valid state after it")
