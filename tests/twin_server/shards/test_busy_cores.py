"""Start and recovery of shards while other processes of the same priority use every core.

Times are elapsed times, on a machine whose only load are the busy processes of this test: what
else runs there makes them longer. The line that the test prints gives the load at its end.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from slowtime_services.bus import ZenohBus
from slowtime_services.client import AnswerError, Client
from slowtime_services.shards import Share
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("default")]

ASSETS = tuple(f"mast-{number}" for number in range(6))
COUNT, EACH = 2, 30
UP_S = 30.0
"""Within which a fleet of two shards answers after its start, and after a shard was killed."""
POLL_S = 0.2
"""How often the fleet is asked [s]; each answer takes some milliseconds from the shards."""
BUSY_PER_CORE = 2
"""Busy processes for each core; with two cores they are four, as four busy edge agents."""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def busy_cores():
    """Processes without a pause, at the priority of the shards."""
    count = BUSY_PER_CORE * len(os.sched_getaffinity(0))
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


@contextlib.contextmanager
def fleet(folder, endpoint, engine):
    """A fleet as it is started from the command line; gives its client."""
    port = free_port()
    command = [
        sys.executable, "-m", "slowtime_cli", "twin", "--shards", str(COUNT),
        "--engine", engine, "--port", str(port), "--connect", endpoint,
        "--database", str(folder / "twin.sqlite"),
    ]  # fmt: skip
    environment = {
        **os.environ,
        "SLOWTIME_TWIN_HEALING": '{"grace_s": 0.05, "max_backoff_s": 1}',
    }
    with (folder / "log").open("ab") as log:
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    try:
        yield Client(f"http://127.0.0.1:{port}")
    finally:
        process.terminate()
        assert process.wait(60) == 0, (folder / "log").read_text()[-2000:]


def ready(client):
    with contextlib.suppress(AnswerError, OSError):
        return client.ready()
    return False


def found(client):
    digests = {}
    for asset in ASSETS:
        with contextlib.suppress(AnswerError, OSError):
            told = client.digest(f"lab.{asset}")
            digests[asset] = (told.sha256, told.features)
    return digests


def elapsed_s(condition, patience_s=300.0):
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() < begun + patience_s
        time.sleep(POLL_S)
    return time.monotonic() - begun


def process_of_shard(folder, index):
    """Process that holds the lock of a shard's database."""
    name = f"twin.shard-{index}-of-{COUNT}.sqlite.lock"
    for pid in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            for file in os.listdir(f"/proc/{pid}/fd"):
                if os.readlink(f"/proc/{pid}/fd/{file}") == str(folder / name):
                    return int(pid)
    raise AssertionError(f"no process holds {name}")


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="no /proc on this system")
@pytest.mark.parametrize("engine", ["local", "ray"])
def test_a_fleet_beside_busy_cores_is_up_in_good_time_and_lacks_nothing(
    tmp_path, engine, features, sample, edge, capsys
):
    if engine == "ray":
        pytest.importorskip("ray", reason="no Ray: pip install 'slowtime[ray]'")
    rng = np.random.default_rng(20261129)
    messages = [
        features(turn, asset=asset, frequency_hz=3.0 + 0.004 * rng.standard_normal())
        for turn in range(EACH)
        for asset in ASSETS
    ]
    with contextlib.closing(open_store(tmp_path / "single.sqlite")) as store:
        Pipeline(TwinSettings(), store).ingest(map(sample, messages))
        wanted = {asset: store.digest(f"lab.{asset}") for asset in ASSETS}
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ZenohBus("router", listen=[endpoint]), ZenohBus("client", [endpoint]) as bus:
        edges = {asset: edge(bus, asset=asset) for asset in ASSETS}
        with busy_cores(), fleet(tmp_path, endpoint, engine) as client:
            started_s = elapsed_s(lambda: ready(client))
            recovered_s: list[float] = []
            for place, message in enumerate(messages):
                edges[message.asset].make(message)
                if place in (len(messages) // 3, 2 * len(messages) // 3):
                    index = len(recovered_s)
                    (asset, *_) = (one for one in ASSETS if Share(index, COUNT).has(one))
                    os.kill(process_of_shard(tmp_path, index), signal.SIGKILL)
                    elapsed_s(lambda: not ready(client), 20)
                    recovered_s.append(elapsed_s(lambda asset=asset: asset in found(client)))
            complete_s = elapsed_s(lambda: found(client) == wanted)
    with capsys.disabled():
        print(
            f"\n{engine}: up {started_s:.1f} s after the start, "
            f"{' and '.join(f'{s:.1f}' for s in recovered_s)} s after a kill; complete "
            f"{complete_s:.1f} s after the last message; load {os.getloadavg()[0]:.0f}"
        )
    assert started_s < UP_S
    assert max(recovered_s) < UP_S
