"""The containers of docker-compose.yml: each is restarted, and nothing measured goes."""

import json
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest

from slowtime_services.client import Client

ROOT = Path(__file__).parents[2]
PROJECT = "slowtime-restarted"
OURS = ("router", "twin", "edge-tower", "edge-tank", "recorder")
TWINS = ("demo.tower", "demo.tank")


def _engine() -> str | None:
    docker = shutil.which("docker")
    if docker is None:
        return None
    asked = subprocess.run([docker, "compose", "version"], capture_output=True, check=False)
    alive = subprocess.run([docker, "info"], capture_output=True, check=False)
    return docker if asked.returncode == alive.returncode == 0 else None


def _compose(*arguments: str, port: int = 8000, files: tuple[str, ...] = ()) -> str:
    given = [part for file in files for part in ("-f", str(ROOT / file))]
    done = subprocess.run(
        ["docker", "compose", "-p", PROJECT, *given, *arguments],
        cwd=ROOT, capture_output=True, text=True, check=False,
        env=os.environ | {"SLOWTIME_PORT": str(port)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


pytestmark = [
    pytest.mark.system,
    pytest.mark.slow,
    pytest.mark.skipif(_engine() is None, reason="no Docker engine with compose is here"),
]


@pytest.fixture(scope="module")
def port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def house(port):
    """All containers of ours, running."""
    try:
        _compose("up", "-d", "--build", port=port)
        client = Client(f"http://127.0.0.1:{port}")
        assert _until(client.ready, 600.0), _compose("ps", port=port)
        yield client
    finally:
        _compose("down", "-v", "--timeout", "8", port=port)


def _until(happens, patience_s=600.0):
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        try:
            if happens():
                return True
        except (ConnectionError, OSError):
            pass
        time.sleep(0.5)
    return False


def test_every_file_and_profile_is_one_that_compose_understands():
    both = ("docker-compose.yml", "docker-compose.postgres.yml")
    told = json.loads(
        _compose("--profile", "grafana", "config", "--format", "json", files=both)
    )
    assert {"postgres", "prometheus", "grafana", *OURS} <= told["services"].keys()
    for service in told["services"].values():
        for published in service.get("ports", ()):
            assert published["host_ip"] == "127.0.0.1"


@pytest.mark.parametrize("service", OURS)
def test_no_process_has_a_capability_or_writes_into_its_image(house, port, service):
    told = _compose(
        "exec", "-T", service, "sh", "-c",
        "grep -E 'CapEff|NoNewPrivs' /proc/self/status; "
        "touch /opt/x 2>/dev/null || echo refused",
        port=port,
    )  # fmt: skip
    assert told.split() == ["CapEff:", "0" * 16, "NoNewPrivs:", "1", "refused"]


@pytest.mark.parametrize("service", OURS)
def test_a_service_that_is_restarted_loses_no_feature(house, port, service):
    assert _until(lambda: all(house.digest(twin).features >= 5 for twin in TWINS))
    before = {twin: house.digest(twin).features for twin in TWINS}
    _compose("restart", service, port=port)
    grown = _until(lambda: all(house.digest(t).features > before[t] + 5 for t in TWINS))
    assert grown, _compose("logs", "--tail", "20", port=port)
    for twin in TWINS:
        history = house.history(twin, max_points=100_000)
        assert all(state.missing_before == 0 for state in history)
        by_boot: dict[str, list[int]] = {}
        for state in history:
            by_boot.setdefault(state.boot, []).append(state.sequence)
        assert all(found == list(range(len(found))) for found in by_boot.values())
        assert not [e for e in house.events(twin) if e.kind == "features_lost"]


def test_each_life_of_the_recorder_leaves_a_recording_that_can_be_read(house, port):
    def recordings():
        listed = _compose("exec", "recorder", "sh", "-c", "ls /recordings/*.mcap", port=port)
        return listed.split()

    assert _until(lambda: len(recordings()) >= 2)
    closed = "/recordings/house.mcap"
    read = (
        "from slowtime_services.replay import contents\n"
        "from slowtime_schemas.streams import FEATURES\n"
        f"print(contents('{closed}', streams=[FEATURES]).messages)\n"
    )
    assert int(_compose("exec", "recorder", "python", "-c", read, port=port)) > 0


def test_what_prometheus_asks_is_answered_under_the_name_it_uses(house, port):
    told = _compose(
        "exec", "recorder", "python", "-c",
        "import urllib.request as u; print(u.urlopen('http://twin:8000/metrics').read().decode())",
        port=port,
    )  # fmt: skip
    assert "slowtime_twin_lost_total 0" in told
    assert 'slowtime_asset_alive{site="demo",twin="demo.tower"} 1.0' in told
