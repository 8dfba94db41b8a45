"""The command as a script meets it: arguments in; status, stdout and stderr out."""

import functools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from slowtime.dynamics.oscillator import Oscillator
from slowtime.dynamics.stepping import ambient_acceleration
from slowtime_cli.__main__ import main

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


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run the command here, in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments) -> Done:
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(argument) for argument in arguments])
        return Done(left.value.code, *capsys.readouterr())

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
def text(tmp_path):
    """Write lines to a file."""

    def write(lines: list[str], name: str = "record.csv") -> Path:
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


@pytest.fixture
def record(text, lines) -> Path:
    """The record as a CSV file."""
    return text(lines)
