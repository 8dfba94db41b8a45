"""Runs a twin server beside busy processes for a while, and looks for false alarms.

    python -m tests.system.busy MINUTES

Four processes take all processor time they get. Meanwhile two edges send, a twin of elements
is registered again and again, which estimates its whole history anew, backups are made, and
another server opens a database of an old version, which is migrated. The server must neither
be ended by its watcher nor set anything aside, and has to have all readings at the end.
"""

import contextlib
import multiprocessing
import sqlite3
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from slowtime_services.bus import ZenohBus
from tests.twin_server.conftest import Edge, Frame, _features
from twin_server.persist.layout import APPLICATION

from .conftest import House, free_port

BUSY = 4
"""Processes that take all the processor time that they get."""

HISTORY = 60
"""Epochs of the twin of elements, each of which takes some tenths of a second to estimate."""

ALARMS = ("no sign of life", "Nothing was finished", "watcher of this process has ended")
"""Parts of lines of the log that there must not be."""

OLD = Path(__file__).parents[1] / "twin_server/persist/version_3.sql"


def burn() -> None:
    """Take all processor time that there is."""
    while True:
        pass


def migrate(house: House, number: int) -> None:
    """Let a server bring a database of an old version up to date."""
    old = house.home / f"old-{number}.sqlite"
    with contextlib.closing(sqlite3.connect(old)) as connection:
        connection.executescript(
            f"{OLD.read_text()}; pragma application_id={APPLICATION}; pragma user_version=259;"
        )
    port, name = free_port(), f"old-{number}"
    house.start(
        name, "twin", "--connect", house.endpoint, "--port", str(port), "--database", str(old)
    )
    house.until(lambda: "answers at" in house.said(name), "the old database to be opened", 600)
    house.end(name, 120)
    check_log(house, name)


def check_log(house: House, name: str) -> None:
    """Refuse a log with an alarm."""
    said = house.said(name)
    assert not any(alarm in said for alarm in ALARMS), said[-5000:]


def run(house: House, minutes: float) -> dict[str, Any]:
    """Run for a while; return how often each thing was done."""
    burning = [multiprocessing.Process(target=burn, daemon=True) for _ in range(BUSY)]
    for process in burning:
        process.start()
    done = {"readings": 0, "registrations": 0, "backups": 0, "migrations": 0, "not_ready": 0}
    try:
        house.router()
        house.twin()
        server = house._running["twin"]
        with contextlib.ExitStack() as stack:
            bus = stack.enter_context(ZenohBus("client", connect=[house.endpoint]))
            beam, frame = Edge(bus), Edge(bus, asset="frame")
            stack.callback(beam.close)
            stack.callback(frame.close)
            structure = Frame()
            house.put("/api/v1/twins/lab.frame", structure.registration())
            for number in range(HISTORY):
                frame.make(structure.epoch(number))
            until_s = time.monotonic() + 60.0 * minutes
            while time.monotonic() < until_s:
                for _ in range(20):
                    beam.make(_features(done["readings"], frequency_hz=3.0))
                    done["readings"] += 1
                number = done["registrations"]
                more = {"name": f"frame {number}"}
                house.put("/api/v1/twins/lab.frame", structure.registration(**more))
                done["registrations"] += 1
                copy = house.home / f"backup-{done['backups']}.sqlite"
                database = str(house.home / "twin.sqlite")
                house.start("backup", "db", "backup", database, "--out", str(copy))
                assert house.wait("backup", 600) == 0
                copy.unlink()
                done["backups"] += 1
                migrate(house, done["migrations"])
                done["migrations"] += 1
                done["not_ready"] += house.get("/readyz") is None
                assert server.poll() is None, house.said("twin")[-5000:]
                print(
                    f"{(time.monotonic() - until_s) / 60 + minutes:.1f} min: {done}", flush=True
                )
            house.until(
                lambda: _count(house, "lab.beam") == done["readings"], "all readings", 600
            )
        check_log(house, "twin")
        for twin_id in ("lab.beam", "lab.frame"):
            assert house.get(f"/api/v1/twins/{twin_id}/quarantine")["messages"] == []
    finally:
        for process in burning:
            process.kill()
        house.end_all()
    return done


def _count(house: House, twin_id: str) -> int:
    found = house.get(f"/api/v1/twins/{twin_id}/history/hash")
    return 0 if found is None else int(found["features"])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="slowtime-busy-") as folder:
        print(run(House(Path(folder)), float(sys.argv[1])))
