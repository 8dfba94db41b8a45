"""What an extra brings is named where it is missing."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest

from slowtime_cli.shared.deferred import Deferred
from slowtime_cli.shared.extras import LIBRARIES
from tests.slowtime_cli.command_tree import commands

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
IMPORTED_AS = {"pyyaml": "yaml"}
LIGHT = {
    "completion",
    "doctor",
    "edge",
    "plugins",
    "publish",
    "router run",
    "router status",
    "twin outputs",
}


def brought(extra):
    """Libraries of an extra, those of the extras that it names included."""
    for line in EXTRAS[extra]:
        name, *extras = re.split(r"[\[\],]|>=", line)
        if name == "slowtime":
            for other in filter(None, extras):
                yield from brought(other)
        else:
            yield IMPORTED_AS.get(name.lower(), name.lower())


def test_each_library_is_in_the_extras_that_are_named_for_it():
    for library, extras in LIBRARIES.items():
        if library != "starlette":  # which FastAPI brings
            assert all(library in set(brought(extra)) for extra in extras), library


def test_every_library_of_a_verb_is_in_the_table():
    assert set(brought("all")) <= set(LIBRARIES)


def test_no_library_of_an_extra_is_one_of_the_edge():
    small = {re.split(">=", line)[0].lower() for line in PROJECT["dependencies"]}
    assert not small & set(brought("all"))


WORKS = {words: one for words, one, _ in commands() if not isinstance(one, click.Group)}


@pytest.mark.parametrize("name", WORKS)
def test_every_verb_but_those_of_the_edge_names_an_extra(name):
    work = WORKS[name]
    assert isinstance(work, Deferred)
    assert (work.extra is None) == (name in LIGHT)
    assert work.extra is None or work.extra in EXTRAS


@pytest.mark.parametrize(
    ("arguments", "library", "extra"),
    [
        (["twin", "--port", "0"], "fastapi", "twin"),
        (["demo", "--duration", "1"], "uvicorn", "twin"),
        pytest.param(["record", "--out", "a.mcap"], "mcap", "analysis", marks=pytest.mark.long),
        pytest.param(["edge", "--file", __file__], "mcap", "analysis", marks=pytest.mark.long),
    ],
)
def test_a_verb_without_its_libraries_names_the_extra(arguments, library, extra, tmp_path):
    code = (
        f"import sys; sys.modules[{library!r}] = None\n"
        f"from slowtime_cli.__main__ import main; main({arguments!r})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        f"slowtime: `slowtime {arguments[0]}` needs the parts that `pip install "
        f"'slowtime[{extra}]'` installs: {library} is missing."
    )
