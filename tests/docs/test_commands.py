"""Every command that README and docs tell to type is one of today, with options of today."""

import re
import shlex
from pathlib import Path

import click
import pytest

from slowtime_cli.verbs.tree import OLD_NAMES
from tests.docs.commands import parse
from tests.slowtime_cli.command_tree import commands

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
] + sorted((ROOT / "docs").rglob("*.md"))
ENDINGS = (".yaml", ".yml", ".service")
FILES = [
    *ROOT.glob("docker-compose*.yml"),
    *(path for path in (ROOT / "services").rglob("*") if path.suffix in ENDINGS),
]  # fmt: skip
HASHED = ("tree head", "ledger 1")
"""Beginnings of what is hashed, and no commands."""
GROUPS = {words for words, command, _ in commands() if isinstance(command, click.Group)}
NAMES = {words for words, _, _ in commands() if words}
SAID = re.compile(r"(?:`|^ {4}|&& |\| )slowtime ((?:[a-z]+ ?)+)", re.M)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_of_a_page_has_its_name_of_today(page):
    for said in SAID.findall(page.read_text()):
        first, *rest = said.split()
        if said.startswith(HASHED):
            continue
        assert first in NAMES, said
        if first in GROUPS and rest and "twin" != first:
            assert f"{first} {rest[0]}" in NAMES, said


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_command_of_a_service_has_its_name_of_today(path):
    for word in re.findall(r"\bslowtime(?:,|\")? *\"?([a-z]+)", path.read_text()):
        assert word not in OLD_NAMES


def typed() -> list[list[str]]:
    """Words behind `slowtime` of the lines to type in pages of docs, comments left out."""
    found = []
    for page in sorted((ROOT / "docs").glob("*.md")):
        for line in re.findall(r"^ {4}(slowtime .*)$", page.read_text(), re.M):
            words = shlex.split(re.split(r" [&|>]", line)[0], comments=True)
            if not any("…" in word or word == "..." for word in words):
                found.append(words[1:])
    return found


@pytest.mark.parametrize("arguments", typed(), ids=" ".join)
def test_every_line_to_type_in_the_docs_parses(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parse(arguments, tmp_path)
