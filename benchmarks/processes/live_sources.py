"""Four channels at 1 kHz over a real broker into an edge agent: what is lost, what it costs.

    python -m benchmarks.processes.live_sources                  an hour, in real time
    python -m benchmarks.processes.live_sources --seconds 300

A publisher sends blocks with a counter to Mosquitto, QoS 1; the agent is a process of its own,
whose processor time and memory the kernel tells. Health tells what was received and lost.
Leaves with 1 where a sample is missing. Ratios: processor time of the agent to the time that
passed, memory at the end to memory after a sixth of the time.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from slowtime_schemas.codec import decode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import HEALTH
from slowtime_services.bus import Sample, ZenohBus

from .transport import free_port

RATE_HZ, CHANNELS, BLOCK = 1_000, 4, 50


def main() -> int:
    """Run, print, and say by the exit status whether anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3_600.0)
    parser.add_argument("--window-s", type=float, default=60.0)
    given = parser.parse_args()
    broker = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if broker is None:
        raise SystemExit("mosquitto is not installed: apt-get install mosquitto")
    with tempfile.TemporaryDirectory() as folder:
        return measured(Path(folder), broker, given.seconds, given.window_s)


def measured(home: Path, broker: str, seconds: float, window_s: float) -> int:
    """Start everything, publish, and look at the agent now and then."""
    mqtt, zenoh = free_port(), free_port()
    (home / "broker.conf").write_text(f"listener {mqtt} 127.0.0.1\nallow_anonymous true\n")
    settings = {
        "site": "lab", "asset": "bench", "connect": [f"tcp/127.0.0.1:{zenoh}"],
        "spool": {"folder": str(home / "spool")}, "extract": {"window_s": window_s},
        "publish": {"linger_s": 0},
        "input": {
            "kind": "live", "source": f"mqtt://127.0.0.1:{mqtt}/bench", "rate_hz": RATE_HZ,
            "layout": {
                "kind": "json", "counter": {"at": "n"},
                "channels": [{"name": f"c{n}"} for n in range(CHANNELS)],
            },
        },
    }  # fmt: skip
    (home / "edge.json").write_text(json.dumps(settings))
    slowtime = [sys.executable, "-m", "slowtime_cli"]
    started = []

    def start(*words: str) -> subprocess.Popen[bytes]:
        started.append(subprocess.Popen(words, stdout=sys.stderr, stderr=sys.stderr))
        return started[-1]

    start(broker, "-c", str(home / "broker.conf"))
    start(*slowtime, "-q", "router", "--listen", f"tcp/127.0.0.1:{zenoh}")
    try:
        heard: list[Health] = []
        bus = ZenohBus("client", (f"tcp/127.0.0.1:{zenoh}",), open_timeout_s=60)
        bus.subscribe(HEALTH.key("lab", "bench"), lambda sample: _hear(sample, heard))
        edge = start(*slowtime, "edge", "--config", str(home / "edge.json"))
        _until(lambda: bool(heard))
        time.sleep(2)
        sent, rows = _publish(mqtt, edge.pid, seconds)
        _until(lambda: heard[-1].counters["samples_received"] >= sent, patience_s=30)
        counters = heard[-1].counters
        bus.close()
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()
    return _told(sent, counters, rows)


def _publish(
    port: int, agent: int, seconds: float
) -> tuple[int, list[tuple[float, float, float]]]:
    """Send at the pace of a device; of the agent: time [s], processor time [s], memory [MB]."""
    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    client.loop_start()
    rows: list[tuple[float, float, float]] = []
    rng, began, sent = np.random.default_rng(1), time.monotonic(), 0
    began_cpu = _cpu_s(agent)
    while (passed := time.monotonic() - began) < seconds:
        if passed * 20 > len(rows) * seconds / 3:
            rows.append((passed, _cpu_s(agent) - began_cpu, _memory_mb(agent)))
        block = rng.normal(size=(CHANNELS, BLOCK)).round(5).tolist()
        told = {"n": sent} | {f"c{n}": channel for n, channel in enumerate(block)}
        client.publish("bench", json.dumps(told), qos=1).wait_for_publish(60)
        sent += BLOCK
        time.sleep(max(0.0, began + sent / RATE_HZ - time.monotonic()))
    rows.append((time.monotonic() - began, _cpu_s(agent) - began_cpu, _memory_mb(agent)))
    client.disconnect()
    client.loop_stop()
    return sent, rows


def _told(sent: int, counters: dict[str, int], rows: list[tuple[float, float, float]]) -> int:
    lost = sent - counters["samples_received"]
    seconds, cpu_s, memory_mb = rows[-1]
    early_mb = rows[max(1, len(rows) // 6)][2]
    print(f"sent {sent:,} samples of {CHANNELS} channels in {seconds:,.0f} s")
    print(
        f"lost between broker and window: {lost:,} (Health: {counters['samples_lost']:,} lost,"
    )
    print(
        f"  {counters['samples_dropped']:,} dropped, {counters['samples_refused']:,} refused)"
    )
    print(f"true rate {counters['sampling_rate_uhz'] / 1e6:.4f} Hz")
    print(f"agent: {cpu_s / seconds:.1%} of one core; {memory_mb:.0f} MB at the end,")
    windows = counters.get("features", 0)
    print(f"  {memory_mb / early_mb:.2f} x that after a sixth; {windows} windows")
    return int(lost != 0 or counters["samples_lost"] != 0)


def _hear(sample: Sample, heard: list[Health]) -> None:
    message = decode(HEALTH, sample.payload)
    if isinstance(message, Health):
        heard.append(message)


def _cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory_mb(process: int) -> float:
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _until(holds: Callable[[], bool], patience_s: float = 300.0) -> None:
    deadline = time.monotonic() + patience_s
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.1)


if __name__ == "__main__":
    sys.exit(main())
