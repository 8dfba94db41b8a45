"""The command as a script runs it: its status, stdout and stderr by its arguments."""

import functools
import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration
from slowtime_cli.__main__ import ROOMS, main
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import ZenohBus
from slowtime_services.record import RecordingWriter

NESTED = re.compile(r"\t[\[{(]|^[\[{(][^\n]*\t", re.MULTILINE)
"""A mapping, a list or a tuple in a field of a line with tabs."""

RATE_HZ = 100.0
FREQUENCY_HZ = 3.0


class Done(NamedTuple):
    """What a run of the command left behind."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """What it wrote to stdout, where that is JSON."""
        return json.loads(self.out)


@pytest.fixture(autouse=True)
def _logging_as_before():
    """Take back what the command does to the logging of its process, which is ours here."""
    loggers = [logging.getLogger(name) for name in (None, *ROOMS)]
    levels, root = [logger.level for logger in loggers], loggers[0]
    yield
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)
    for handler in root.handlers[:]:
        if type(handler) is logging.StreamHandler:
            root.removeHandler(handler)


def _heeding_interrupts():
    """Undo what a background job inherits: a shell makes it deaf to Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run the command here, in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments) -> Done:
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(argument) for argument in arguments])
        status = left.value.code
        assert isinstance(status, int)
        done = Done(status, *capsys.readouterr())
        assert not NESTED.search(done.out), "a cell of a table holds a mapping or a list"
        return done

    return command


@pytest.fixture
def refused(run):
    """Run the command and expect it to refuse: status 2, a sentence, nothing on stdout."""

    def command(*arguments) -> str:
        done = run(*arguments)
        assert (done.status, done.out) == (2, ""), done
        assert "Traceback" not in done.err
        assert len(done.err) > 30
        return " ".join(done.err.split())

    return command


@pytest.fixture
def unawaited(monkeypatch):
    """Fail where a router is looked for."""

    def open_bus(*_args, **_options):
        pytest.fail("A router was looked for.")

    monkeypatch.setattr(ZenohBus, "__init__", open_bus)


@pytest.fixture
def start(tmp_path):
    """Start the command as a process, which ends with the test."""
    running = []

    def command(*arguments) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [sys.executable, "-m", "slowtime_cli", *map(str, arguments)],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
            preexec_fn=_heeding_interrupts,
        )
        running.append(process)
        return process

    yield command
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate()


@functools.cache
def vibration() -> np.ndarray:
    """A minute of two channels on one structure at `FREQUENCY_HZ`."""
    rng = np.random.default_rng(1)
    oscillator = Oscillator.from_modal(FREQUENCY_HZ, 0.02)
    first = ambient_acceleration(oscillator, 6000, RATE_HZ, rng)
    first = first / first.std()
    second = 0.5 * first + 0.1 * rng.standard_normal(6000)
    return np.column_stack([first, second])


@pytest.fixture
def samples() -> np.ndarray:
    """Shape (6000, 2)."""
    return vibration().copy()


@pytest.fixture
def clock(samples) -> np.ndarray:
    """Seconds, one for each of the samples."""
    return np.arange(len(samples)) / RATE_HZ


@pytest.fixture
def lines(samples, clock) -> list[str]:
    """The record as comma-separated text: header, then time and two channels."""
    rows = np.column_stack([clock, samples])
    return ["time,acc_x,acc_y"] + [",".join(f"{x:.6f}" for x in row) for row in rows]


@pytest.fixture
def text(tmp_path: Path) -> Callable[..., Path]:
    """Write lines to a file."""

    def write(lines: Sequence[str], name: str = "record.csv") -> Path:
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


@pytest.fixture
def record(text, lines):
    """The record as a CSV file."""
    return text(lines)


def features(count: int, asset: str = "beam") -> list[Features]:
    """What an edge agent says of an asset whose frequency falls."""
    return [
        Features(
            site="lab",
            asset=asset,
            boot="b1",
            sequence=number,
            t_ns=1_700_000_000_000_000_000 + number * 10**9,
            start_ns=1_700_000_000_000_000_000,
            slow_time=float(number),
            method="ambient",
            modes=(
                Mode(
                    frequency_hz=Quantity(value=3.0 - 1e-3 * number, sd=0.002),
                    damping_ratio=Quantity(value=0.02, sd=0.001),
                ),
            ),
            quality=Quality(samples=1000),
        )
        for number in range(count)
    ]


@pytest.fixture
def recorded(tmp_path):
    """Write a recording of features of some assets."""

    def write(count: int = 40, assets: Sequence[str] = ("beam",), name: str = "house.mcap"):
        path = tmp_path / name
        with RecordingWriter(path) as writer:
            for asset in assets:
                for message in features(count, asset):
                    writer.write(FEATURES, "lab", asset, encode(message), message.t_ns)
        return path

    return write


@pytest.fixture
def port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
    return number


@pytest.fixture
def router(start, port) -> str:
    """Endpoint of a router that runs as long as the test."""
    endpoint = f"tcp/127.0.0.1:{port}"
    process = start("router", "--listen", endpoint)
    assert process.stdout.readline() == f"Router on {endpoint}\n"
    return endpoint
