"""Clocks of edge agent and server that are set by hours, years and centuries while they run."""

import datetime
import mmap
import shutil
import struct
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import pytest

pytestmark = [pytest.mark.system, pytest.mark.long]

FEATURES, RATE = 2400, 20
EDGE = {
    "site": "lab",
    "asset": "beam",
    "extract": {"method": "peak"},
    "publish": {"linger_s": 300.0},
    "input": {
        "kind": "simulated",
        "every_s": 1 / RATE,
        "structure": {
            "epochs": FEATURES, "seconds": 2.0, "interval_s": 2.0, "rate_hz": 64.0, "seed": 5,
        },
    },
}  # fmt: skip
HOUR_S = 3600.0
INSTANTS = {
    "summer time ends in Berlin": "2026-10-25T00:59:58Z",
    "summer time begins in Berlin": "2027-03-28T00:59:58Z",
    "leap day": "2028-02-28T23:59:58Z",
    "1970": "1970-01-02T00:00:00Z",
    "2262, the last day that 63 bits of nanoseconds reach": "2262-04-11T12:00:00Z",
}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Compile what shifts the clock of a process; libfaketime 0.9.10 makes its sleeps fail."""
    compiler = shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("no C compiler for Linux: apt install gcc libc6-dev")
    out = tmp_path_factory.mktemp("library") / "realtime_offset.so"
    source = Path(__file__).with_name("realtime_offset.c")
    command = [compiler, "-shared", "-fPIC", "-o", str(out), str(source), "-ldl"]
    subprocess.run(command, check=True)
    return out


class Setting:
    """The clock of one process, which is set while it runs; its monotonic clock is left."""

    def __init__(self, house, name, library):
        path = house.home / f"{name}.offset"
        path.write_bytes(bytes(8))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 8)
        house.environments[name] = {
            "LD_PRELOAD": str(library),
            "REALTIME_OFFSET": str(path),
            "TZ": "Europe/Berlin",
        }

    def set(self, off_s):
        self._map[:] = struct.pack("<q", round(off_s))


def settings_of_clocks():
    """Names, and how many seconds the clock is then off."""
    yield "two hours ahead", 2 * HOUR_S
    yield "two hours behind", -2 * HOUR_S
    for name, instant in INSTANTS.items():
        yield name, datetime.datetime.fromisoformat(instant).timestamp() - time.time()
    yield "right again", 0.0


class Listener(threading.Thread):
    """A client of the live stream."""

    def __init__(self, house):
        super().__init__(daemon=True)
        self._url, self.lines = house.url + "/api/v1/twins/lab.beam/live", 0

    def run(self):
        with urllib.request.urlopen(self._url, timeout=300) as answer:
            for _ in answer:
                self.lines += 1


@pytest.mark.parametrize("whose", ["twin", "edge"])
def test_a_clock_that_is_set_costs_nothing_that_was_acknowledged_and_is_said(
    house, library, whose, capsys
):
    setting = Setting(house, whose, library)
    key = house.home / "ledger.pem"
    house.start("key", "ledger", "key", str(key))
    assert house.wait("key") == 0
    house.router()
    house.twin("--ledger-key", str(key))
    house.edge(EDGE)
    house.until(lambda: len(house.history("lab.beam")) > 50, "the first features")
    listener = Listener(house)
    listener.start()
    seen = []
    for name, off_s in settings_of_clocks():
        setting.set(off_s)
        time.sleep(6.0)
        assert house.get("/healthz") == {"status": "ok"}, name
        seen.append(f"{name}: {len(house.history('lab.beam'))} features")
    heads = house.get("/api/v1/ledger/heads")
    lines = listener.lines
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "all features")
    points = house.history("lab.beam")
    house.until(lambda: house.get("/api/v1/ledger/heads?limit=1000") != heads, "another head")
    metrics = urllib.request.urlopen(house.url + "/metrics", timeout=60).read().decode()
    refused = [
        line for line in metrics.splitlines()
        if line.startswith("slowtime_twin_refused_total") and "clock" in line
    ]  # fmt: skip
    with capsys.disabled():
        print(f"\nclock of the {whose}: " + "; ".join(seen))
        print(f"{len(points)} of {FEATURES} in history; refused meanwhile: {refused}")
    assert [point["sequence"] for point in points] == list(range(FEATURES))
    assert len({point["boot"] for point in points}) == 1
    assert any("future_clock" in line or "stale_clock" in line for line in refused)
    assert listener.lines > lines
    assert house.end("twin") == 0
