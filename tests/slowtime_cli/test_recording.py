import re
import signal
import time

import pytest

from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import Sample, ZenohBus
from slowtime_services.replay import contents

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
    assert "raw.mcap holds samples and no features; an edge agent with default" in done.err
    assert run("replay", "raw.mcap", "--into", "b.sqlite").out == done.out
    said = run("layout", "raw.mcap", "--out", "layout.json")
    assert said.status == 2
    assert "slowtime edge --recording" in said.err


def test_a_recording_of_features_evolves_by_asset(run, refused, recorded):
    path = recorded(assets=("beam", "fan"))
    assert "holds lab.beam, lab.fan. Name one with --asset." in refused("evolve", path)
    assert "has no lab.gong, but: lab.beam, lab.fan" in refused(
        "evolve", path, "--asset", "lab.gong"
    )
    flags = ("--asset", "lab.fan", "--nominal-hz", 3, "--out", "-")
    found = run("evolve", path, *flags).json["points"]
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
        ((record, *NOBODY), "is no recording: it begins with"),
        (("cut.mcap", *NOBODY), "Run `slowtime recover"),
        (("cut.mcap", "--into", "a.sqlite"), "Run `slowtime recover"),
        (("raw.mcap", "--edge"), "does not hold the settings of the edge agent of demo.tank"),
        ((path, "--edge"), "holds no raw blocks. Run the edge with --raw while recording."),
        ((path, "--into", path), "exists. Give a new file, so that the history is fresh."),
        ((path, "--into", "nowhere/a.sqlite"), "There is no folder nowhere"),
        ((path, "--edge", "--into", "a.sqlite"), "--edge and --into exclude each other."),
        ((path, "--speed", "0"), "0.0 is not in the range x>0"),
        ((path, "--speed", "nan"), "nan is not a finite number"),
        ((path, "--connect", "nonsense"), "'nonsense' is no endpoint. Give PROTOCOL/ADDRESS"),
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
        (("--out", "a.mcap", "--asset", "beam"), "'beam' is no name. Allowed: SITE.ASSET"),
        (("--out", "a.mcap", "--duration", "-1"), "-1.0 is not in the range"),
        (("--out", "a.mcap", "--connect", "nonsense"), "'nonsense' is no endpoint"),
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
