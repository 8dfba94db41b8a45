"""The unit of the edge is one that systemd takes, and starts what the command understands."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from slowtime_cli.__main__ import app

UNIT = Path(__file__).parents[2] / "services/systemd/slowtime-edge@.service"


def command() -> list[str]:
    (line,) = re.findall(r"^ExecStart=(.*)$", UNIT.read_text(), re.M)
    return shlex.split(line)


def test_the_command_of_the_unit_parses(tmp_path):
    (tmp_path / "beam.toml").touch()
    (tmp_path / "edge-beam").mkdir()
    words = [
        word.replace("/etc/slowtime", str(tmp_path)).replace("%i", "beam")
        for word in command()[1:]
    ]
    verb = words.index("edge")
    app.make_context("slowtime", words[: verb + 1], resilient_parsing=True).close()
    edge = app.get_command(click.Context(app), "edge")
    assert edge is not None
    edge.make_context("edge", words[verb + 1 :]).close()


def test_systemd_finds_nothing_to_say(tmp_path):
    if (analyze := shutil.which("systemd-analyze")) is None:
        pytest.skip("systemd-analyze is not here")
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace(command()[0], sys.executable))
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(unit).replace("@.", "@beam.")],
        capture_output=True, text=True, check=False, env={"SYSTEMD_LOG_LEVEL": "warning"},
    )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if UNIT.name.partition("@")[0] in line]
    assert (done.returncode, said) == (0, [])
