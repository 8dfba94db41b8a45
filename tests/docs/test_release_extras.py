"""The trial of extras knows every extra, and judges lines as users would."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from release.extras import FOR_DEVELOPERS, LARGE, LINES, end_group, extras_of, verdict_of
from slowtime_cli.shared.extras import missing_extra

ROOT = Path(__file__).parents[2]


def test_the_page_on_installation_lists_every_extra_of_users():
    rows = re.findall(r"^\| `([\w-]+)` \|", (ROOT / "docs/installation.md").read_text(), re.M)
    assert sorted(rows) == sorted(extras_of())
    assert LARGE < set(extras_of())
    assert not FOR_DEVELOPERS & set(extras_of())


def test_lines_of_single_extras_name_extras_that_exist():
    assert {needed for needed, _ in LINES.values()} <= set(extras_of())


@pytest.mark.parametrize(
    ("status", "output", "verdict"),
    [
        (0, "natural frequency 5.0 Hz", "answers"),
        (2, missing_extra("slowtime twin", "twin", ModuleNotFoundError(name="fastapi")),
         "names the extra"),
        (1, "Traceback (most recent call last):\n  ...\nModuleNotFoundError: h5py", "fault"),
        (2, "a.csv has no column x.", "fault"),
        (1, "Traceback (most recent call last):\nImportError: Install it: pip install mcap",
         "names the extra"),
        (1, "Install it: pip install 'slowtime[formats]' or pip install obspy.",
         "names the extra"),
    ],
)  # fmt: skip
def test_a_line_answers_or_names_what_to_install(status, output, verdict):
    assert verdict_of(status, output) == verdict


POLITE = """
import signal, sys, time
def end(*_):
    open(sys.argv[1], "w").write("ended")
    sys.exit()
signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
time.sleep(60)
"""


def test_what_a_line_started_in_the_background_is_asked_before_it_is_killed(tmp_path):
    mark = tmp_path / "mark"
    line = f"{sys.executable} -c '{POLITE}' {mark} & sleep 60"
    with subprocess.Popen(
        ["bash", "-c", line], start_new_session=True, stdout=subprocess.PIPE
    ) as shell:
        assert shell.stdout is not None
        shell.stdout.readline()
        end_group(shell)
        assert mark.read_text() == "ended"
        assert shell.returncode == -signal.SIGTERM


def test_what_does_not_end_when_asked_is_killed():
    line = "trap '' TERM; echo ready; while true; do sleep 0.1; done"
    with subprocess.Popen(
        ["bash", "-c", line], start_new_session=True, stdout=subprocess.PIPE
    ) as shell:
        assert shell.stdout is not None
        shell.stdout.readline()
        began = time.monotonic()
        end_group(shell, patience_s=0.3)
        assert shell.returncode == -signal.SIGKILL
        assert time.monotonic() - began < 20
