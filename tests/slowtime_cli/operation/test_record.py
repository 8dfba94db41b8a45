import json
import re
import signal
import threading
import time

import numpy as np
import pytest
import scipy.signal as sps

from edge_agent.__main__ import run as run_edge
from edge_agent.settings import EdgeSettings
from slowtime.signals.block import Block
from slowtime_schemas.messages import TimeBase
from slowtime_schemas.streams import FEATURES, parse_key
from slowtime_services.bus import MemoryBus, Sample, ZenohBus
from slowtime_services.record.writer import RecordingWriter
from slowtime_services.replay import contents, read_recording

NOBODY = ("--connect", "tcp/127.0.0.1:1")


def test_a_recording_gives_the_same_history_each_time(run, recorded):
    path = recorded(assets=("beam", "fan"))
    first = run("replay", path, "--into", "a.sqlite")
    assert (first.status, first.err) == (0, "")
    lines = first.out.splitlines()
    assert [line.split()[0] for line in lines] == ["lab.beam", "lab.fan"]
    assert all(re.search(r"  sha256:[0-9a-f]{64}  of 40 features$", line) for line in lines)
    assert run("replay", path, "--into", "b.sqlite").out == first.out


def test_the_history_of_another_recording_is_another(run, recorded):
    a = run("replay", recorded(40, name="a.mcap"), "--into", "a.sqlite").out
    b = run("replay", recorded(39, name="b.mcap"), "--into", "b.sqlite").out
    assert a != b


@pytest.mark.long
def test_a_recording_of_samples_alone_is_read_by_an_edge_agent_on_the_way(run, tmp_path):
    run("simulate", "--structure", "tank", "--epochs", 2, "--seed", 1, "--out", "raw.mcap")
    done = run("replay", "raw.mcap", "--into", "a.sqlite")
    assert done.status == 0
    assert re.fullmatch(r"demo.tank  sha256:[0-9a-f]{64}  of 2 features\n", done.out)
    assert "raw.mcap holds samples but no features; an edge agent with default" in done.err
    assert run("replay", "raw.mcap", "--into", "b.sqlite").out == done.out
    said = run("mcap", "layout", "raw.mcap", "--out", "layout.json")
    assert said.status == 2
    assert "slowtime edge --recording" in said.err


class Shaken:
    """Forty seconds of two channels that ring."""

    time_base: TimeBase = "recorded"
    slow_time_unit = "s"

    def __iter__(self):
        ringing = sps.lfilter(
            [1.0], [1.0, -1.9, 0.99], np.random.default_rng(1).normal(size=2000)
        )
        yield Block(
            samples=np.outer(ringing, [1.0, 0.5]), rate_hz=50.0, first_index=0, start_ns=0,
            channels=("x", "y"), units=("m/s^2", "m/s^2"),
        )  # fmt: skip


def rewritten(path, to, change):
    """The same recording, its features as `change` makes them."""
    with RecordingWriter(to) as writer:
        for message in read_recording(path):
            stream, site, asset = parse_key(message.key)
            payload = change(message.payload) if stream is FEATURES else message.payload
            writer.write(stream, site, asset, payload, message.publish_ns)
    return to


def as_version_2(payload):
    content = json.loads(payload)
    del content["units"]
    return json.dumps(content | {"version": 2}).encode()


def in_feet(payload):
    content = json.loads(payload)
    return json.dumps(content | {"units": ["ft"] * len(content["units"])}).encode()


@pytest.mark.parametrize(("change", "same"), [(as_version_2, 2), (in_feet, 0)])
def test_an_edge_that_tells_more_than_it_did_still_tells_the_same(run, tmp_path, change, same):
    path, bus = tmp_path / "raw.mcap", MemoryBus()
    with RecordingWriter(path) as writer:
        bus.subscribe("slowtime/**", lambda s: writer.write(*parse_key(s.key), s.payload, 0))
        settings = EdgeSettings(
            publish={"raw": "on", "linger_s": 0}, extract={"method": "modes", "window_s": 20},
            spool={"folder": tmp_path / "spool", "fsync": "never"},
        )  # fmt: skip
        run_edge(settings, bus=bus, source=Shaken(), stop=threading.Event())
    done = run("replay", rewritten(path, tmp_path / "old.mcap", change), "--edge")
    assert f"{same} of 2 features identical to those recorded" in done.out


def test_a_recording_of_features_evolves_by_asset(run, refused, recorded):
    path = recorded(assets=("beam", "fan"))
    assert "holds lab.beam, lab.fan. Name one with --asset." in refused("twin", "evolve", path)
    assert "has no lab.gong, but: lab.beam, lab.fan" in refused(
        "twin", "evolve", path, "--asset", "lab.gong"
    )
    flags = ("--asset", "lab.fan", "--nominal-hz", 3, "--out", "-")
    found = run("twin", "evolve", path, *flags).json["points"]
    assert {state["id"] for state in found} == {"lab.fan"}
    assert len(found) == 40


def test_what_cannot_be_replayed_is_refused_before_a_router_is_waited_for(
    refused, run, recorded, record, unawaited, tmp_path
):
    path = recorded()
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[:-50])
    run("simulate", "--structure", "tank", "--epochs", 1, "--out", "raw.mcap")
    for arguments, says in [
        (("missing.mcap",), "File 'missing.mcap' does not exist"),
        ((record, *NOBODY), "is not a recording: it begins with"),
        (("cut.mcap", *NOBODY), "Run `slowtime mcap recover"),
        (("cut.mcap", "--into", "a.sqlite"), "Run `slowtime mcap recover"),
        (("raw.mcap", "--edge"), "does not hold the settings of the edge agent of demo.tank"),
        (
            (path, "--edge"),
            "holds no raw blocks. Run the edge with --setting raw=yes while recording.",
        ),
        ((path, "--into", path), "exists. Give a new file, so that the history is fresh."),
        ((path, "--into", "nowhere/a.sqlite"), "There is no folder nowhere"),
        ((path, "--edge", "--into", "a.sqlite"), "--edge and --into exclude each other."),
        ((path, "--speed", "-1"), "is not in the range x>=0"),
        ((path, "--speed", "nan"), "nan is not a finite number"),
        (
            (path, "--connect", "nonsense"),
            "'nonsense' is not a valid endpoint. Give PROTOCOL/ADDRESS",
        ),
    ]:
        assert says in refused("replay", *arguments)
    assert not (tmp_path / "a.sqlite").exists()


def test_what_cannot_be_recorded_is_refused_before_a_router_is_waited_for(
    refused, recorded, unawaited
):
    path = recorded()
    for arguments, says in [
        ((), "Missing option '--out'"),
        (("--out", path, *NOBODY), "--number to have one put after it."),
        (("--out", "a.txt"), "does not end in .mcap"),
        (
            ("--out", "a.mcap", "--streams", "noise"),
            "No stream is called 'noise'. Allowed:",
        ),
        (
            ("--out", "a.mcap", "--asset", "beam"),
            "'beam' is not a valid name. Allowed: SITE.ASSET",
        ),
        (("--out", "a.mcap", "--duration", "-1"), "-1.0 is not in the range"),
        (("--out", "a.mcap", "--connect", "nonsense"), "'nonsense' is not a valid endpoint"),
    ]:
        assert says in refused("record", *arguments)


@pytest.mark.long
@pytest.mark.system
def test_what_travels_is_recorded_and_ctrl_c_ends_both_ends(start, router, recorded, tmp_path):
    heard: list[Sample] = []
    with ZenohBus("client", [router]) as bus:
        bus.subscribe(FEATURES.key("*", "*"), heard.append)
        recorder = start("record", "--out", "new.mcap", "--connect", router)
        deadline = time.monotonic() + 300
        while not (tmp_path / "new.mcap").exists():
            assert time.monotonic() < deadline
            time.sleep(0.02)
        time.sleep(0.5)  # until the recorder's subscription has reached the router
        player = start("replay", recorded(), "--connect", router, "--speed", "2")
        while not heard:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        time.sleep(1.0)
        player.send_signal(signal.SIGINT)
        said, _ = player.communicate(timeout=300)
        assert player.returncode == 130
        assert "features in" in said
    recorder.send_signal(signal.SIGINT)
    said, err = recorder.communicate(timeout=300)
    # To record until Ctrl-C is what it was asked for.
    assert recorder.returncode == 0
    assert "Traceback" not in err
    assert "features" in said
    found = contents(tmp_path / "new.mcap", streams=[FEATURES])
    assert 1 <= found.counts[FEATURES.key("lab", "beam")] < 40
