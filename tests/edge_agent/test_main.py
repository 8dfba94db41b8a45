"""The agent as a process: settings alone make it run, on simulated and on real samples."""

import dataclasses
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Literal

import pytest

from edge_agent.__main__ import run
from edge_agent.publish import Spool
from edge_agent.settings import EdgeSettings
from slowtime_schemas.messages import About, Features
from slowtime_schemas.streams import ABOUT, FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.files import RecordError
from slowtime_services.shutdown import ended_by_signals
from slowtime_services.simulate import SimulatedStructure

TABLE_HZ = (26.27, 28.23, 30.82, 33.87, 37.55, 41.96)


def features_of(folder, **chosen):
    bus = MemoryBus()
    heard: list[bytes] = []
    bus.subscribe(FEATURES.everywhere, lambda sample: heard.append(sample.payload))
    publish = {"linger_s": 0.0}
    settings = EdgeSettings(spool={"folder": folder}, publish=publish, **chosen)
    assert run(settings, bus=bus, stop=threading.Event()) == 0
    return [Features.model_validate_json(payload) for payload in heard]


def test_a_simulated_structure_is_listened_to_until_its_last_epoch(tmp_path):
    structure = {"epochs": 5, "seconds": 20.0, "slow_time_step": 2.0}
    messages = features_of(
        tmp_path,
        input={"kind": "simulated", "structure": structure, "every_s": 0.0},
        extract={"method": "ambient"},
    )
    assert [m.slow_time for m in messages] == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert {m.slow_time_unit for m in messages} == {"T0"}
    assert {m.time_base for m in messages} == {"simulated"}
    assert len({m.boot for m in messages}) == 1


def test_a_file_that_cannot_be_read_ends_the_agent_with_the_reason(tmp_path):
    (tmp_path / "a.csv").write_text("a,b\n1,2\n3,4\n")
    with pytest.raises(RecordError, match="Give --rate-hz"):
        features_of(tmp_path, input={"kind": "file", "path": tmp_path / "a.csv"})


class SetBack:
    """A live sensor whose clock jumps by some hours after so many epochs."""

    time_base: Literal["live", "recorded", "simulated"] = "live"
    slow_time_unit = "d"

    def __init__(self, jumps_s, each=20):
        self.jumps_s, self.each = jumps_s, each

    def __iter__(self):
        structure = SimulatedStructure(seconds=2.0, interval_s=2.0, rate_hz=128.0)
        begin_ns = time.time_ns() - 10**13
        for number in range(self.each * len(self.jumps_s)):
            jump_s = self.jumps_s[number // self.each]
            for block in structure.epoch(number):
                off_ns = begin_ns + round(jump_s * 1e9) - structure.start_ns
                yield dataclasses.replace(block, start_ns=block.start_ns + off_ns)
            yield None


@pytest.mark.parametrize("jump_s", [-7200.0, 7200.0])
def test_a_clock_that_jumps_by_hours_costs_a_few_epochs_and_never_the_order(tmp_path, jump_s):
    bus = MemoryBus()
    heard: list[bytes] = []
    bus.subscribe(FEATURES.everywhere, lambda sample: heard.append(sample.payload))
    settings = EdgeSettings(
        spool={"folder": tmp_path}, publish={"linger_s": 0.0}, extract={"method": "peak"}
    )
    source = SetBack([0.0, jump_s, 0.0])
    assert run(settings, bus=bus, source=source, stop=threading.Event()) == 0
    messages = [Features.model_validate_json(payload) for payload in heard]
    boots = list(dict.fromkeys(m.boot for m in messages))
    assert len(boots) == 2
    for boot in boots:
        theirs = [m for m in messages if m.boot == boot]
        assert [m.sequence for m in theirs] == list(range(len(theirs)))
        assert all(a.t_ns < b.t_ns for a, b in itertools.pairwise(theirs))
    assert len(messages) >= 60 - 2 * 10
    spool = Spool(tmp_path / "demo.tower", "reader")
    assert [held.boot for held in spool.held()] == boots
    spool.close()


def test_about_tells_the_software_and_no_address(tmp_path):
    bus = MemoryBus()
    heard: list[bytes] = []
    bus.subscribe(ABOUT.everywhere, lambda sample: heard.append(sample.payload))
    stop = threading.Event()
    stop.set()
    settings = EdgeSettings(connect=("tcp/10.9.8.7:1",), spool={"folder": tmp_path})
    run(settings, bus=bus, stop=stop)
    about = About.model_validate_json(heard[0])
    assert about.software.startswith("slowtime ")
    assert b"10.9.8.7" not in heard[0]


def test_signals_end_the_agent_and_their_handlers_come_back():
    before = signal.getsignal(signal.SIGTERM)
    with ended_by_signals() as stop:
        assert not stop.is_set()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(1.0)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.long
@pytest.mark.system
def test_the_process_runs_without_a_router_and_ends_at_once_when_asked(tmp_path):
    environment = {
        **os.environ,
        "SLOWTIME_EDGE_SPOOL__FOLDER": str(tmp_path),
        "SLOWTIME_EDGE_CONNECT_WAIT_S": "0.1",
        "SLOWTIME_EDGE_EXTRACT__METHOD": "ambient",
        "SLOWTIME_EDGE_CONNECT": '["tcp/127.0.0.1:1"]',
    }
    command = [sys.executable, "-m", "edge_agent", "--asset", "mast"]
    command += ["--input.kind", "simulated", "--input.every_s", "0.05"]
    with subprocess.Popen(
        command, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        lines = [process.stderr.readline() for _ in range(2)]
        assert "No router at tcp/127.0.0.1:1 yet" in lines[0]
        assert "Edge demo.mast, boot" in lines[1]
        threading.Event().wait(0.5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    (path,) = (tmp_path / "demo.mast").glob("*.spool")
    assert path.stat().st_size > 500


@pytest.mark.long
def test_wrong_settings_are_said_in_words_and_end_with_status_2(tmp_path):
    command = [sys.executable, "-m", "edge_agent", "--input.kind", "telepathy"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "telepathy" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.data
def test_the_moving_roller_is_followed_through_its_dwells_and_never_at_its_second_mode(
    tmp_path, data
):
    messages = features_of(
        tmp_path,
        input={"kind": "file", "path": data / "moving_roller/slow10_test0.txt"},
        extract={"window_s": 1.0, "hop_s": 0.5},
    )
    found = [m.modes[0].frequency_hz for m in messages if m.modes]
    assert all(20.0 < frequency.value < 50.0 for frequency in found)
    near = [
        min(TABLE_HZ, key=lambda hz: abs(hz - frequency.value))
        for frequency in found
        if min(abs(hz - frequency.value) for hz in TABLE_HZ) < 0.5
    ]
    assert len(near) >= 20
    assert set(near) == set(TABLE_HZ)
