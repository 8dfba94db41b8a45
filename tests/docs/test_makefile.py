"""The first `make` in a fresh clone says what it is doing."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("target", "steps"), [(".venv/run", 1), (".venv/dev", 2)])
def test_each_step_of_an_installation_is_said_and_pip_is_heard(target, steps):
    if (make := shutil.which("make")) is None:
        pytest.skip("make is not here")
    told = subprocess.run(
        [make, "--dry-run", "--always-make", target],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    lines = told.splitlines()
    installs = [number for number, line in enumerate(lines) if "pip" in line]
    assert len(installs) == steps
    for number in installs:
        assert lines[number - 1].startswith("echo ")
        assert "Installing" in lines[number - 1]
        assert "--quiet" not in lines[number]
        assert " -q " not in lines[number]
