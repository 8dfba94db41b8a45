"""`event`: repairs and inspections are recorded, listed and taken back; and told to a file."""

import contextlib
import json
import threading

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.client import Client
from twin_server.__main__ import run as run_server
from twin_server.settings import TwinSettings


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A twin server with one registered beam."""
    home = tmp_path_factory.mktemp("house")
    with contextlib.ExitStack() as stack:
        settings = TwinSettings(database=home / "twin.sqlite", port=0)
        stop, ready, urls = threading.Event(), threading.Event(), []

        def told(url):
            urls.append(url)
            ready.set()

        bus = MemoryBus()
        thread = threading.Thread(
            target=run_server,
            args=(settings,),
            kwargs={"bus": bus, "stop": stop, "ready": told},
        )
        for end in (bus.close, thread.join, stop.set):
            stack.callback(end)
        thread.start()
        assert ready.wait(60)
        Client(urls[0]).register("lab.beam", {"nominal": {"frequency_hz": 3.0}})
        yield urls[0]


def test_events_are_recorded_listed_and_taken_back(run, server, tmp_path):
    own = ("--server", server, "--person", "Ann")
    done = run(
        "twin", "event", "add", "lab.beam", "--kind", "repair", "--perfect", "--id", "r1", *own
    )
    assert (done.status, done.out.strip()) == (
        0,
        "r1: Repair recorded by Ann: perfect, all damage restored.",
    )
    file = tmp_path / "events.json"
    share = {"restored_share": 0.7, "restored_share_sd": 0.1}
    events = [
        {"event": "r2", "kind": "repair", "at": "2026-01-02T03:04:05Z", "repair": share},
        {"event": "n1", "kind": "note", "text": "Looked at.", "person": "Bob"},
    ]
    file.write_text(json.dumps(events))
    for _ in range(2):
        done = run("twin", "event", "add", "lab.beam", "--file", file, "--server", server)
        assert done.status == 0
        assert "r2: Repair recorded by" in done.out
        assert "70 % ± 10 % of the damage restored" in done.out
    scan = (
        "--kind",
        "inspection",
        "--not-detected",
        "--setting",
        "a50=0.1",
        "--setting",
        "slope=2",
    )
    when = ("--at", "2026-01-03T00:00:00Z")
    ids = {run("twin", "event", "add", "lab.beam", *scan, *when, *own).out for _ in range(2)}
    assert len(ids) == 1
    gauge = ("--kind", "inspection", "--value", -0.12, "--sd", 0.03)
    done = run("twin", "event", "add", "lab.beam", *gauge, *own)
    assert "Inspection recorded by Ann: -12 % ± 3 %" in done.out
    done = run("twin", "event", "undo", "lab.beam", "r1", *own)
    assert (done.status, done.out.strip()) == (0, "Ann took back the event r1.")
    rows = [
        line.split("\t")
        for line in run(
            "twin", "event", "list", "lab.beam", "--server", server
        ).out.splitlines()
    ]
    assert rows[0][:2] == ["event", "kind"]
    assert [row[0] for row in rows if row[0] in ("r1", "r2", "n1", "undo-r1")] == [
        "undo-r1", "n1", "r2", "r1",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((), "Give --kind, or --file"),
        (("--kind", "note", "--at", "slow:x"), "is not a valid"),
        (("--kind", "inspection", "--value", -0.1), "--value needs --sd"),
        (("--kind", "inspection", "--detected"), "need the settings a50 and slope"),
        (("--kind", "repair", "--perfect", "--restored-share", 0.5), "exclude each other"),
        (("--kind", "inspection"), "An inspection has one result"),
    ],
)
def test_what_cannot_be_recorded_is_refused_with_what_to_do(run, server, arguments, match):
    done = run("twin", "event", "add", "lab.beam", *arguments, "--server", server)
    assert done.status == 2
    assert match in done.err


def test_a_forecast_of_a_file_restarts_from_its_events(run, tmp_path):
    rows = [f"{n},{3.0 * (1.0 - 0.004 * n) ** 0.5:.6f},0.002" for n in range(60)]
    history, events = tmp_path / "modes.csv", tmp_path / "events.json"
    history.write_text("slow_time,frequency_hz,frequency_sd\n" + "\n".join(rows))
    events.write_text(
        json.dumps({"event": "r1", "kind": "repair", "repair": {"restored_share": 1.0}})
    )

    def first(*more):
        done = run(
            "twin", "forecast", history, "--nominal-hz", 3, "--setting", "points=1",
            "--horizon", 1, *more, "--out", "-",
        )  # fmt: skip
        assert done.status == 0, done.err
        return json.loads(done.out)["points"][0]["stiffness_change"]["value"]

    assert first() == pytest.approx(-0.24, abs=0.01)
    assert first("--events", events) == pytest.approx(-0.004, abs=0.01)
    events.write_text('[{"event": "r1", "kind": "mend"}]')
    refused = run("twin", "forecast", history, "--nominal-hz", 3, "--events", events)
    assert refused.status == 2
    assert "Event 1, at kind: Input should be 'repair'" in refused.err


def test_a_recording_brings_its_events(run, tmp_path, server):
    del server
    from slowtime_schemas.streams import ASSET_EVENT
    from slowtime_services.record import RecordingWriter
    from tests.twin_server.conftest import _features
    from twin_server.events.asset_events import AssetEventOrder, accepted

    order = AssetEventOrder(event="r1", kind="repair", slow_time=59.0, person="Ann")
    path = tmp_path / "house.mcap"
    with RecordingWriter(path) as writer:
        for n in range(60):
            one = _features(n, frequency_hz=3.0 * (1.0 - 0.004 * n) ** 0.5)
            writer.write(FEATURES, "lab", "beam", encode(one), one.t_ns)
        told = accepted(order, "lab.beam", 1, one.t_ns + 1, "ann", None)
        writer.write(ASSET_EVENT, "lab", "beam", encode(told), told.t_ns)
    done = run(
        "twin",
        "forecast",
        path,
        "--nominal-hz",
        3,
        "--setting",
        "points=1",
        "--horizon",
        1,
        "--out",
        "-",
    )
    assert done.status == 0, done.err
    change = json.loads(done.out)["points"][0]["stiffness_change"]
    # Nobody has said how much was restored: from none to all of it.
    assert change["value"] == pytest.approx(-0.12, abs=0.02)
    assert change["sd"] == pytest.approx(0.07, abs=0.02)
