"""The units are ones that systemd takes, and start what the command understands."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from slowtime_cli.__main__ import app
from slowtime_services.shutdown import GRACE_S
from twin_server.settings import TwinSettings

FOLDER = Path(__file__).parents[2] / "services/systemd"
UNITS = {"edge": FOLDER / "slowtime-edge@.service", "twin": FOLDER / "slowtime-twin.service"}


def command(unit: Path) -> list[str]:
    (line,) = re.findall(r"^ExecStart=(.*)$", unit.read_text(), re.M)
    return shlex.split(line)


@pytest.mark.parametrize("name", UNITS)
def test_the_command_of_the_unit_parses(tmp_path, name):
    for file in ("beam.toml", "twin.toml"):
        (tmp_path / file).touch()
    for folder in ("edge-beam", "server"):
        (tmp_path / folder).mkdir()
    words = [
        word.replace("/etc/slowtime", str(tmp_path)).replace("%i", "beam")
        for word in command(UNITS[name])[1:]
    ]
    verb = words.index(name)
    app.make_context("slowtime", words[: verb + 1], resilient_parsing=True).close()
    command_of = app.get_command(click.Context(app), name)
    assert command_of is not None
    command_of.make_context(name, words[verb + 1 :]).close()


def test_the_server_is_waited_for_and_ended_by_systemd_later_than_by_itself():
    settings, unit = TwinSettings(), UNITS["twin"].read_text()
    assert "Type=notify" in unit
    (watchdog_s,), (stop_s,) = (
        map(float, re.findall(rf"^{name}=(\d+)$", unit, re.M))
        for name in ("WatchdogSec", "TimeoutStopSec")
    )
    assert watchdog_s > settings.progress.silent_s + 2.0
    assert stop_s > settings.shutdown_s + settings.progress.end_s
    (stop_s,) = map(
        float, re.findall(r"^TimeoutStopSec=(\d+)$", UNITS["edge"].read_text(), re.M)
    )
    assert stop_s > GRACE_S


@pytest.mark.parametrize("name", UNITS)
def test_systemd_finds_nothing_to_say(tmp_path, name):
    if (analyze := shutil.which("systemd-analyze")) is None:
        pytest.skip("systemd-analyze is not here")
    unit = tmp_path / UNITS[name].name
    text = UNITS[name].read_text()
    unit.write_text(text.replace(command(UNITS[name])[0], sys.executable))
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(unit).replace("@.", "@beam.")],
        capture_output=True, text=True, check=False, env={"SYSTEMD_LOG_LEVEL": "warning"},
    )  # fmt: skip
    said = [line for line in done.stderr.splitlines() if unit.name.partition("@")[0] in line]
    assert (done.returncode, said) == (0, [])
