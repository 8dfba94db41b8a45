"""What docs/reliability.md shows runs, and names everything there is."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from slowtime.reliability import FAMILIES, METHODS
from slowtime_services.problem_files.expressions import FUNCTIONS
from slowtime_services.problem_files.reliability import read_stated_problem
from tests.docs.commands import parse

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reliability.md").read_text()
LINES = [
    shlex.split(line.strip(), comments=True)[1:]
    for line in re.findall(r"^ {4}slowtime .*$", PAGE, re.M)
]


def block(language):
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.S)
    assert found is not None
    return found[1]


def test_the_page_names_every_method_marginal_and_function():
    named = set(re.findall(r"`([a-z0-9_-]+)`", PAGE))
    assert set(METHODS) <= named
    assert set(FAMILIES) <= named
    formula = next(line for line in PAGE.splitlines() if line.startswith("| `limit_state`"))
    assert set(FUNCTIONS) <= set(re.findall(r"[a-z0-9]+", formula))


@pytest.mark.parametrize("arguments", LINES, ids=" ".join)
def test_every_command_of_the_page_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    parse(arguments, tmp_path)


def test_the_python_of_the_page_runs():
    names: dict[str, Any] = {}
    exec(block("python").replace("print(", "shown = ("), names)
    probability, interval, _, _, warnings = names["shown"]
    assert interval[0] < probability < interval[1]
    assert warnings == ()


def test_the_file_of_the_page_is_one(tmp_path):
    path = tmp_path / "page.yaml"
    path.write_text(block("yaml"))
    assert read_stated_problem(path)[0].names == ("strength", "load")
