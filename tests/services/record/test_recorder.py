"""What travels is recorded as it came; a killed recorder loses at most a second."""

import json
import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest
from mcap.reader import make_reader

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import ABOUT, ACK, FEATURES, STATE
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
        bus.publish("slowtime/v1/lab/beam/unheard-of", b"", encoding="x")
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
