"""What the tutorials tell to type does what they say."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest

from slowtime_cli.__main__ import app

TUTORIALS = Path(__file__).parents[2] / "docs/tutorials"
PAGES = sorted(TUTORIALS.glob("*.md"))


def typed(page: Path) -> list[list[str]]:
    """Words of every line to type."""
    lines = re.findall(r"^ {4}(\S.*)$", page.read_text(), re.MULTILINE)
    return [shlex.split(line) for line in lines]


def of_slowtime() -> list[list[str]]:
    return [words[1:] for page in PAGES for words in typed(page) if words[0] == "slowtime"]


@pytest.mark.parametrize("arguments", of_slowtime(), ids=" ".join)
def test_every_command_of_a_tutorial_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "found").mkdir()
    for word in arguments:
        if re.fullmatch(r"[\w/-]+\.\w+(@[\d.:]*)?", word):
            (tmp_path / word.partition("@")[0]).touch()
    command = app.get_command(click.Context(app), arguments[0])
    assert command is not None
    command.make_context(arguments[0], list(arguments[1:])).close()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_tutorial_links_to_is_there(page):
    links = re.findall(r"\]\(([^)]+)\)", page.read_text())
    assert links
    missing = [x for x in links if "://" not in x and not (page.parent / x).exists()]
    assert missing == []


def test_an_effect_of_ones_own_is_short_and_goes_the_whole_way(tmp_path):
    """Measured with the branch, named by the command, simulated from what that wrote."""
    assert len((TUTORIALS / "maxwell_branch.py").read_text().splitlines()) < 60
    for file in TUTORIALS.iterdir():
        if file.suffix in (".py", ".yaml"):
            shutil.copy(file, tmp_path)
    for words in typed(TUTORIALS / "own_effect.md"):
        if "without" not in words:  # what the catalogue makes of it is in the words, not here
            module = ["-m", "slowtime_cli"] if words[0] == "slowtime" else []
            done = subprocess.run(
                [sys.executable, *module, *words[1:]],
                cwd=tmp_path, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "found/report.json").read_text())
    (effect,) = report["effects"]
    assert effect["effect"] == "maxwell_branch"
    for name, true in (("k_n_per_m", 1.2e5), ("c_n_s_per_m", 1500.0)):
        told = effect["parameters"][name]
        assert abs(told["value"] - true) < 5 * told["sd"] < 0.02 * true
    with np.load(tmp_path / "judge.npz") as judge, np.load(tmp_path / "again.npz") as again:
        left = judge["x"] - again["x"]
        assert np.std(left) < 0.01 * np.std(judge["x"])
