"""Files of running processes that are moved, deleted or overwritten."""

import shutil
import threading
import time

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
    told.bus.close()


def test_an_agent_whose_spool_is_taken_away_and_a_recorder_lose_nothing_that_is_current(
    house, capsys
):
    house.router()
    house.twin()
    (house.home / "rec").mkdir()
    house.start("recorder", "record", "--connect", house.endpoint, "--out", "rec/a.mcap")
    house.edge(EDGE)
    house.until(lambda: len(house.history("lab.beam")) > 100, "the first features")
    house.kill("twin")  # so that the spool holds what follows
    time.sleep(3.0)
    shutil.rmtree(house.home / "edge-spool")
    shutil.rmtree(house.home / "rec")
    time.sleep(3.0)
    house.twin()
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "all features")
    assert sequences(house) == list(range(FEATURES))
    assert "It is written again" in house.said("edge")
    house.until(lambda: "the recording goes on in" in house.said("recorder"), "the recorder")
    assert (house.home / "rec" / "a.mcap").exists()
    with capsys.disabled():
        print(f"\nspool deleted beside a killed server: {FEATURES} of {FEATURES} in history")
