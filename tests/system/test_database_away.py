"""PostgreSQL that is killed or stands still under a running server, and its answers."""

import os
import signal
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests import postgres

pytestmark = [pytest.mark.system, pytest.mark.long]

RATE, FEATURES = 20, 1200
EDGE = {
    "site": "lab",
    "asset": "beam",
    "extract": {"method": "peak"},
    "publish": {"linger_s": 120.0},
    "input": {
        "kind": "simulated",
        "every_s": 1 / RATE,
        "structure": {
            "epochs": FEATURES, "seconds": 2.0, "interval_s": 2.0, "rate_hz": 64.0, "seed": 5,
        },
    },
}  # fmt: skip
WITHOUT_END = "/live"
"""Ends of the addresses that stream for ever."""


@pytest.fixture
def server():
    """Folder and URL of a PostgreSQL of its own."""
    with tempfile.TemporaryDirectory(prefix="slowtime-pg-") as name:
        folder = Path(name) / "pg"
        with postgres.server(folder) as url:
            yield folder, url


def send(folder, signal_number):
    first = int((folder / "data" / "postmaster.pid").read_text().split()[0])
    children = Path(f"/proc/{first}/task/{first}/children").read_text().split()
    for pid in (first, *map(int, children)):
        os.kill(pid, signal_number)


def addresses(house):
    """Every address of a GET of the OpenAPI document, of the one twin."""
    document = house.get("/api/v1/openapi.json")
    found = []
    for path, methods in document["paths"].items():
        if "get" in methods and not path.endswith(WITHOUT_END):
            filled = path.replace("{twin_id}", "lab.beam").replace("{number}", "1")
            found.append(filled if "{" not in filled else filled.partition("{")[0] + "nothing")
    return found


def answered(house, path):
    """Status and wait that an address answers with; it may take as long as a statement."""
    try:
        with urllib.request.urlopen(house.url + path, timeout=90) as answer:
            answer.read(1 << 20)
            return answer.status, None
    except urllib.error.HTTPError as error:
        error.read()
        return error.code, error.headers.get("Retry-After")


def faults(told):
    """Addresses that answered with a fault of the server, or with 503 and no wait."""
    return {
        path: (status, wait)
        for path, (status, wait) in told.items()
        if status == 500 or (status == 503 and wait is None and path != "/readyz")
    }


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_reads_answer_503_with_retry_after_while_postgresql_is_away_and_nothing_is_lost(
    house, server, how, capsys
):
    folder, url = server
    house.router()
    house.twin("--database", url)
    house.edge(EDGE)
    house.until(lambda: len(house.history("lab.beam")) > 50, "the first features")
    paths = addresses(house)
    assert not faults({path: answered(house, path) for path in paths})
    if how == "killed":
        postgres.kill(folder)
    else:
        send(folder, signal.SIGSTOP)
    begun = time.monotonic()
    told = {path: answered(house, path) for path in paths}
    took_s = time.monotonic() - begun
    assert not faults(told)
    assert told["/healthz"] == (200, None)
    assert told["/readyz"][0] == 503
    assert told["/api/v1/twins/lab.beam/history"] == (503, "5")
    if how == "killed":
        postgres.restart(folder)
    else:
        send(folder, signal.SIGCONT)
    back = time.monotonic()
    house.until(lambda: answered(house, "/readyz")[0] == 200, "the server to be ready")
    ready_s = time.monotonic() - back
    assert not faults({path: answered(house, path) for path in paths})
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "all features")
    numbers = [point["sequence"] for point in house.history("lab.beam")]
    assert numbers == list(range(FEATURES))
    away = sorted(path for path, (status, _) in told.items() if status == 503)
    with capsys.disabled():
        print(
            f"\nPostgreSQL {how}: {len(away)} of {len(paths)} addresses answered 503, none "
            f"500; all within {took_s:.0f} s; ready {ready_s:.1f} s after it was back; "
            f"{len(numbers)} of {FEATURES} features in history"
        )
