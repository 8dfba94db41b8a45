"""Files of running processes that are moved, deleted or overwritten."""

import contextlib
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from slowtime_schemas.codec import decode_sample
from slowtime_schemas.messages import Acknowledgement
from slowtime_schemas.streams import ACK
from slowtime_services.bus import ZenohBus
from twin_server.persist import backup

pytestmark = [pytest.mark.system, pytest.mark.long]

FEATURES, RATE = 1200, 20
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
AWAY_S = 6.0
HELD_S = 60.0
"""How long another process holds the database; beyond all limits of waiting and of silence."""
HOLDER = """
import sqlite3, sys
held = sqlite3.connect(sys.argv[1], isolation_level=None, timeout=30)
held.execute(sys.argv[2])
held.execute("select count(*) from features").fetchone()
print(flush=True)
sys.stdin.read()
"""


class Acknowledged:
    """The highest sequence that was acknowledged."""

    def __init__(self, endpoint):
        self.sequence, self._lock = -1, threading.Lock()
        self.bus = ZenohBus("client", [endpoint])
        self.bus.subscribe(ACK.everywhere, self._hear)

    def _hear(self, sample):
        message = decode_sample(sample.key, sample.payload)
        assert isinstance(message, Acknowledgement)
        with self._lock:
            self.sequence = max(self.sequence, message.sequence)


def sequences(house):
    return [point["sequence"] for point in house.history("lab.beam")]


def lost(house):
    events = house.get("/api/v1/twins/lab.beam/events?limit=1000")["events"]
    return {
        number
        for event in events
        if event["kind"] == "features_lost"
        for number in range(event["details"]["first"], event["details"]["last"] + 1)
    }


def kinds(house):
    events = house.get("/api/v1/twins/lab.beam/events?limit=1000")["events"]
    return [event["kind"] for event in events]


@contextlib.contextmanager
def held(path, statement):
    """Let another process hold a database."""
    command = [sys.executable, "-c", HOLDER, str(path), statement]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        yield
    finally:
        holder.communicate()
        assert holder.returncode == 0


def beside(path, *ends):
    return [path.with_name(path.name + end) for end in ends]


@pytest.mark.parametrize("harm", ["moved", "deleted", "log removed", "overwritten"])
def test_nothing_that_was_acknowledged_is_lost_with_a_database_that_is_taken_away(
    house, harm, capsys
):
    path = house.home / "twin.sqlite"
    house.router()
    house.twin()
    told = Acknowledged(house.endpoint)
    house.edge(EDGE)
    house.until(lambda: len(house.history("lab.beam")) > 100, "the first features")
    backup(path, house.home / "monday.sqlite")
    copied = len(house.history("lab.beam"))
    house.until(lambda: told.sequence > copied + 100, "acknowledgements after the backup")
    if harm == "moved":
        path.rename(house.home / "elsewhere")
    elif harm == "deleted":
        path.unlink()
    elif harm == "log removed":
        beside(path, "-wal")[0].unlink()
    else:
        shutil.copyfile(house.home / "monday.sqlite", path)
    house.until(lambda: house.get("/readyz") is None, "the server to say that it is not ready")
    at_harm = told.sequence
    time.sleep(AWAY_S)
    assert told.sequence == at_harm
    assert house.get("/readyz") is None
    assert house.get("/api/v1/twins/lab.beam/history") is None  # 503
    if harm == "moved":
        (house.home / "elsewhere").rename(path)
    else:
        assert house.end("twin") == 0
        if harm == "deleted":
            rescued = beside(path, ".rescued-1")[0]
            for one in beside(path, "-wal", "-shm"):
                one.unlink(missing_ok=True)
            rescued.rename(path)
        house.twin()
    house.until(
        lambda: set(sequences(house)) | lost(house) >= set(range(FEATURES)), "all features"
    )
    found, gone = sequences(house), lost(house)
    said = house.said("twin")
    with capsys.disabled():
        print(
            f"\ndatabase {harm}: acknowledged up to {at_harm} before, none while it was away; "
            f"{len(found)} of {FEATURES} in history, {len(gone)} reported as lost; "
            f"{said.count(' ERROR ')} lines of ERROR in the log"
        )
    assert len(found) == len(set(found))
    if harm == "overwritten":  # whoever copied over it gave up what was acknowledged since
        assert gone <= set(range(copied, at_harm + 1))
    else:
        assert not gone
    assert said.count(" ERROR ") <= 8
    if harm == "moved":
        assert kinds(house).count("database_away") == 1
    told.bus.close()


@pytest.mark.parametrize("statement", ["begin exclusive", "begin"])
def test_a_database_that_another_process_holds_is_read_and_loses_nothing(
    house, statement, capsys
):
    house.router()
    house.twin()
    told = Acknowledged(house.endpoint)
    house.edge(EDGE)
    house.until(lambda: told.sequence > 50, "the first acknowledgements")
    writes, slowest_s = statement == "begin exclusive", 0.0
    with held(house.home / "twin.sqlite", statement):
        at_hold, begun_s = told.sequence, time.monotonic()
        while time.monotonic() < begun_s + HELD_S:
            asked_s = time.monotonic()
            assert house.history("lab.beam")
            slowest_s = max(slowest_s, time.monotonic() - asked_s)
            time.sleep(1.0)
        at_end = told.sequence
        if writes:
            assert house.get("/readyz") is None
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "all features")
    assert sequences(house) == list(range(FEATURES))
    assert not lost(house)
    if writes:
        assert at_end <= at_hold + 20  # of messages that were under way
        assert "locked" in house.said("twin")
        assert "Another process holds it: end that one" in house.said("twin")
        assert kinds(house).count("database_away") == 1
    else:
        assert at_end > at_hold + RATE * HELD_S / 4
    with capsys.disabled():
        print(
            f"\nheld for {HELD_S:.0f} s by `{statement}`: acknowledged {at_hold} before and "
            f"{at_end} at its end; slowest read {slowest_s:.1f} s; {FEATURES} of {FEATURES} in "
            "history"
        )
    told.bus.close()


@pytest.mark.parametrize("harm", ["deleted", "moved", "replaced"])
def test_an_agent_whose_spool_is_taken_away_and_a_recorder_lose_nothing_that_is_current(
    house, harm, capsys
):
    house.router()
    house.twin()
    (house.home / "rec").mkdir()
    house.start("recorder", "record", "--connect", house.endpoint, "--out", "rec/a.mcap")
    house.edge(EDGE)
    house.until(lambda: len(house.history("lab.beam")) > 100, "the first features")
    house.kill("twin")  # so that the spool holds what follows
    time.sleep(3.0)
    for name in ("edge-spool", "rec"):
        folder = house.home / name
        if harm == "deleted":
            shutil.rmtree(folder)
            continue
        folder.rename(house.home / f"{name}-elsewhere")
        if harm == "replaced":
            former = house.home / f"{name}-elsewhere"
            for file in filter(Path.is_file, former.rglob("*")):
                other = folder / file.relative_to(former)
                other.parent.mkdir(parents=True, exist_ok=True)
                other.write_bytes(b"another file")
    time.sleep(3.0)
    house.twin()
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "all features")
    assert sequences(house) == list(range(FEATURES))
    assert "It is written again" in house.said("edge")
    house.until(lambda: "the recording goes on in" in house.said("recorder"), "the recorder")
    assert list((house.home / "rec").glob("a*.mcap"))
    with capsys.disabled():
        print(f"\nspool {harm} beside a killed server: {FEATURES} of {FEATURES} in history")
