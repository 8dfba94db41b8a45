"""What travels is recorded as it came; a killed recorder loses at most a second."""

import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from typing import Any

import pytest
from mcap.reader import make_reader

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import ABOUT, ACK, FEATURES, RAW, STATE
from slowtime_services.bus import MemoryBus, ZenohBus
from slowtime_services.clock import HandClock
from slowtime_services.record import Recorder, recover
from slowtime_services.replay import contents, read_recording

KEY = FEATURES.key("lab", "beam")


def test_every_recorded_stream_is_in_the_file_as_it_came(tmp_path):
    clock, sender = HandClock(2_000), HandClock(1_000)
    listening = MemoryBus(clock=clock)
    bus = MemoryBus(clock=sender, joins=listening)
    sent = []
    with Recorder(listening, tmp_path / "a.mcap", clock=clock) as recorder:
        for i, stream in enumerate([FEATURES, ABOUT, STATE, FEATURES, ACK]):
            clock.set_ns(2_000 + i)
            payload = b"not even json %d" % i
            bus.publish(stream.key("lab", "beam"), payload, encoding=stream.encoding)
            if stream.recorded:
                sent.append((2_000 + i, 1_000, stream.key("lab", "beam"), payload))
        bus.publish("slowtime/v1/other", b"", encoding="x")
        bus.publish("slowtime/v2/lab/unheard-of/174/beam", b"", encoding="x")
    assert [tuple(m) for m in read_recording(tmp_path / "a.mcap")] == sent
    assert recorder.recording.counts == {"features": 2, "about": 1, "state": 1}
    assert recorder.recording.dropped == recorder.recording.refused == 0


def test_streams_and_asset_can_be_chosen(tmp_path):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "a.mcap", streams=[ACK], asset="beam") as recorder:
        for asset in ("beam", "fan"):
            for stream in (ACK, FEATURES):
                bus.publish(stream.key("lab", asset), b"{}", encoding=stream.encoding)
    assert recorder.recording.counts == {"ack": 1}
    assert contents(tmp_path / "a.mcap").counts == {ACK.key("lab", "beam"): 1}


def test_what_does_not_fit_is_counted_and_never_silent(tmp_path, monkeypatch, caplog):
    bus, gate = MemoryBus(), threading.Event()
    recorder = Recorder(bus, tmp_path / "a.mcap", queue_bytes=100)
    write = recorder._write
    monkeypatch.setattr(recorder, "_write", lambda arrival: (gate.wait(60), write(arrival)))
    bus.publish(KEY, b"first", encoding="x")
    while recorder._inbox:
        time.sleep(0.001)
    for _ in range(10):
        bus.publish(KEY, b"x" * 30, encoding="x")
    gate.set()
    recording = recorder.close()
    assert (recording.counts["features"], recording.dropped) == (1 + 3, 7)
    assert "lacks 7 messages" in caplog.text


def test_a_payload_beyond_its_streams_limit_is_refused_and_counted(tmp_path):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "a.mcap") as recorder:
        bus.publish(KEY, bytes(FEATURES.max_bytes + 1), encoding="x")
        bus.publish(KEY, bytes(FEATURES.max_bytes), encoding="x")
    assert (recorder.recording.refused, recorder.recording.counts) == (1, {"features": 1})


def test_files_rotate_and_together_hold_everything(tmp_path, eventually):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "a.mcap", flush_s=0.02, rotate_bytes=3000) as recorder:
        for i in range(8):
            for k in range(20):
                payload = json.dumps({"i": i, "noise": os.urandom(40).hex()}).encode()
                bus.publish(KEY, payload, encoding=f"{k}")
            before = recorder.recording.bytes_written
            assert eventually(lambda b=before: recorder.recording.bytes_written > b)
    paths = recorder.recording.paths
    assert [path.name for path in paths[:2]] == ["a.mcap", "a-0001.mcap"]
    got = [json.loads(m.payload)["i"] for path in paths for m in read_recording(path)]
    assert got == [i for i in range(8) for _ in range(20)]


def _flood(bus, recorder, eventually, count):
    """Publish incompressible features of half a mebibyte, each kept before the next comes."""
    for number in range(count):
        before = recorder.recording.counts.get("raw", 0) + recorder.recording.unwritten
        bus.publish(RAW.key("lab", "beam"), bytes([number]) + os.urandom(2**19), encoding="x")
        assert eventually(
            lambda n=before: (
                recorder.recording.counts.get("raw", 0) + recorder.recording.unwritten > n
            )
        )


def test_a_bounded_recording_deletes_its_oldest_files_and_says_so(tmp_path, eventually, caplog):
    others = {"a.txt": b"x", "ab.mcap": b"x", "a-1.mcap": b"x", "a-0001.mcap.old": b"x"}
    for name, content in others.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "a-0007.mcap").write_bytes(bytes(3 * 2**20))  # of a run before
    bus, most = MemoryBus(), 16 * 2**20
    with Recorder(
        bus, tmp_path / "a.mcap", flush_s=0.02, streams=[RAW], keep_bytes=most
    ) as recorder:
        _flood(bus, recorder, eventually, 50)
    mine = {*tmp_path.iterdir()} - {tmp_path / name for name in others}
    assert sum(path.stat().st_size for path in mine) <= most
    assert {name: (tmp_path / name).read_bytes() for name in others} == others
    paths = recorder.recording.paths
    assert {*paths} == mine
    assert recorder.recording.deleted >= 5
    numbers = [m.payload[0] for path in paths for m in read_recording(path)]
    assert numbers == [*range(numbers[0], 50)]  # the newest, in order, without a gap
    assert numbers[0] > 10
    assert (
        "a-0007.mcap (3145728 bytes), the oldest of the recording, was deleted" in caplog.text
    )
    told = [
        record.metadata["deleted"]
        for path in paths
        for record in make_reader(io.BytesIO(path.read_bytes())).iter_metadata()
        if "deleted" in record.metadata
    ]
    assert any(name.startswith("a-00") for name in told)


def test_a_bounded_recording_may_end_instead_and_counts_what_came_after(
    tmp_path, eventually, caplog
):
    bus, most = MemoryBus(), 16 * 2**20
    bound: dict[str, Any] = {"streams": [RAW], "keep_bytes": most, "when_full": "stop"}
    with Recorder(bus, tmp_path / "a.mcap", flush_s=0.02, **bound) as recorder:
        _flood(bus, recorder, eventually, 40)
        recorder.run(threading.Event(), every_s=0.01)  # comes to an end by itself
    now = recorder.recording
    assert recorder.full
    assert (now.counts["raw"] + now.unwritten, now.deleted) == (40, 0)
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= most
    got = [m.payload[0] for path in now.paths for m in read_recording(path)]
    assert got == [*range(now.counts["raw"])]
    assert "Recording has ended" in caplog.text
    with pytest.raises(ValueError, match=r"bytes already.*Move some away, or allow more"):
        Recorder(bus, tmp_path / "a.mcap", **bound)


def test_a_bound_too_small_for_its_files_is_refused(tmp_path):
    for keep, rotate in ((2**20, None), (2**25, 2**25)):
        with pytest.raises(ValueError, match=r"Give at least 16777216, and twice the size"):
            Recorder(MemoryBus(), tmp_path / "a.mcap", keep_bytes=keep, rotate_bytes=rotate)
    assert not list(tmp_path.iterdir())


def test_an_idle_recorder_does_not_grow(tmp_path, eventually):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "a.mcap", flush_s=0.02) as recorder:
        assert eventually(lambda: recorder.recording.bytes_written > 0)
        size = recorder.recording.bytes_written
        time.sleep(0.2)
        assert (tmp_path / "a.mcap").stat().st_size == size


def test_a_disk_that_takes_no_more_ends_the_recording_with_its_reason(tmp_path, monkeypatch):
    bus = MemoryBus()
    recorder = Recorder(bus, tmp_path / "a.mcap", flush_s=0.02)

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder._writer, "flush", full)
    with pytest.raises(OSError, match="No space left"):
        recorder.run(threading.Event(), every_s=0.01)
    with pytest.raises(OSError, match="No space left"):
        recorder.close()


def test_run_reports_until_it_is_stopped(tmp_path):
    bus, stop, reports = MemoryBus(), threading.Event(), []
    with Recorder(bus, tmp_path / "a.mcap") as recorder:
        bus.publish(KEY, b"{}", encoding="x")

        def report(recording):
            reports.append(recording.counts)
            if recording.counts:
                stop.set()

        recorder.run(stop, report, every_s=0.01)
    assert reports[-1] == {"features": 1}


@pytest.mark.long
@pytest.mark.parametrize("after_s", [2.6])
def test_a_recorder_killed_loses_at_most_a_second(tmp_path, endpoint, features_of, after_s):
    path = tmp_path / "killed.mcap"
    script = f"""
        import threading
        from slowtime_services.bus import ZenohBus
        from slowtime_services.record import Recorder
        bus = ZenohBus("client", connect=[{endpoint!r}])
        with Recorder(bus, {str(path)!r}) as recorder:
            print("recording", flush=True)
            recorder.run(threading.Event())
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "recording\n"
    sent, begun, late_ns = [], math.inf, 0
    empty = path.stat().st_size
    with ZenohBus("client", connect=[endpoint]) as bus, process:
        for message in features_of(100_000):
            bus.publish(KEY, encode(message), encoding="application/json")
            sent.append(time.time_ns())
            if math.isinf(begun) and path.stat().st_size > empty:
                begun = time.monotonic()  # what is sent arrives and is written
            if time.monotonic() - begun > after_s:
                break
            time.sleep(0.005)
            # A machine that keeps us waiting keeps the recorder waiting too.
            late_ns = max(late_ns, time.time_ns() - sent[-1])
        killed_ns = time.time_ns()
        process.send_signal(signal.SIGKILL)
        process.wait()
    recovered = recover(path, tmp_path / "sound.mcap")
    assert not recovered.was_sound
    with (tmp_path / "sound.mcap").open("rb") as file:
        kept = [m for _, _, m in make_reader(file, validate_crcs=True).iter_messages()]
    sequences = [json.loads(m.data)["sequence"] for m in kept]
    assert sequences == list(range(sequences[0], sequences[0] + len(kept)))
    assert sequences[0] <= 2
    assert recovered.messages == len(kept)
    lost = sent[sequences[-1] + 1 :]
    assert all(when > killed_ns - 1e9 - late_ns for when in lost)
    assert len(kept) > 20


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")
@pytest.mark.parametrize("harm", ["moved", "deleted", "folder deleted"])
def test_a_recording_whose_file_is_taken_away_goes_on_in_another_and_says_so(
    tmp_path, eventually, caplog, harm
):
    bus, path = MemoryBus(), tmp_path / "recordings" / "a.mcap"
    path.parent.mkdir()
    with Recorder(bus, path, flush_s=0.02) as recorder:
        bus.publish(KEY, b"before", encoding="x")
        assert eventually(lambda: recorder.recording.bytes_written > 0)
        written = path.stat().st_size
        assert eventually(lambda: recorder.recording.bytes_written == written)
        if harm == "moved":
            path.rename(tmp_path / "elsewhere.mcap")
        elif harm == "deleted":
            path.unlink()
        else:
            shutil.rmtree(path.parent)
        assert eventually(path.exists)
        bus.publish(KEY, b"after", encoding="x")
    assert "the recording goes on in" in caplog.text
    assert recorder.recording.paths == (path,)
    assert [message.payload for message in read_recording(path)] == [b"after"]
    if harm == "moved":
        whole = read_recording(tmp_path / "elsewhere.mcap")
        assert [message.payload for message in whole] == [b"before"]


def chunks_of(path):
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return len(summary.chunk_indexes)


def test_a_closed_recording_has_few_chunks_though_each_message_was_flushed(
    tmp_path, eventually
):
    bus, path = MemoryBus(), tmp_path / "a.mcap"
    sent = [json.dumps({"i": i, "f": math.sqrt(i)}).encode() for i in range(40)]
    with Recorder(bus, path, flush_s=0.002) as recorder:
        for payload in sent:
            before = recorder.recording.bytes_written
            bus.publish(KEY, payload, encoding="x")
            assert eventually(lambda b=before: recorder.recording.bytes_written > b)
        shutil.copy(path, tmp_path / "live.mcap")
    recover(tmp_path / "live.mcap", tmp_path / "cut.mcap")
    for kept in (path, tmp_path / "cut.mcap"):
        assert [message.payload for message in read_recording(kept)] == sent, kept
    assert chunks_of(path) == 1
    assert path.stat().st_size < (tmp_path / "live.mcap").stat().st_size
    assert recorder.recording.bytes_written == path.stat().st_size
    assert [*tmp_path.glob("*.repacked*")] == []


def test_a_recording_that_cannot_be_repacked_stays_as_it_was_written(tmp_path, monkeypatch):
    bus, path = MemoryBus(), tmp_path / "a.mcap"
    refused = OSError("no space left on device")
    monkeypatch.setattr("slowtime_services.record.recovery.recover", lambda *_: raised(refused))
    with Recorder(bus, path, flush_s=0.002) as recorder:
        for i in range(9):
            bus.publish(KEY, b"%d" % i, encoding="x")
            time.sleep(0.01)
    assert recorder.recording.counts == {"features": 9}
    assert [message.payload for message in read_recording(path)] == [
        b"%d" % i for i in range(9)
    ]


def raised(error):
    raise error
