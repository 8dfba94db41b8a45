import os
import shutil
import subprocess
import sys

import click
import pytest

from slowtime_cli.__main__ import app
from slowtime_cli.verbs.tree import VERBS


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_each_shell_asks_the_command(run, shell):
    done = run("completion", shell)
    assert done.status == 0
    assert f"_SLOWTIME_COMPLETE={shell}_complete" in done.out
    assert "%(" not in done.out


def test_a_shell_that_is_not_known_is_refused(refused):
    assert "'tcsh' is not one of 'bash', 'zsh', 'fish'" in refused("completion", "tcsh")


def test_bash_accepts_the_script(run):
    if (bash := shutil.which("bash")) is None:
        pytest.skip("bash is not here")
    script = run("completion", "bash").out
    done = subprocess.run([bash, "-n"], input=script, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "place", "told"),
    [
        ("slowtime de", 1, {"demo", "design"}),
        ("slowtime twin f", 2, {"forecast"}),
        ("slowtime twin --ho", 2, {"--host"}),
        ("slowtime whatif --lo", 2, {"--load"}),
        ("slowtime identify --reading time", 3, {"time_column=", "time_unit="}),
        ("slowtime edge --sim", 2, {"--simulate"}),
        ("slowtime simulate --structure t", 3, {"tank", "tower"}),
    ],
)
def test_verbs_options_and_choices_are_completed(words, place, told):
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli"],
        capture_output=True, text=True, check=False,
        env=os.environ | {
            "_SLOWTIME_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(place)
        },
    )  # fmt: skip
    completed = {line.partition(",")[2] for line in done.stdout.splitlines()}
    assert completed == told, done.stderr


def test_verbs_are_completed_without_importing_them():
    context = click.Context(app)
    assert {one.value for one in app.shell_complete(context, "")} == set(VERBS)
    assert {one.value for one in app.shell_complete(context, "--verb")} == {"--verbose"}
