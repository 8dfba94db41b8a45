"""Every command that README and docs tell to type is one of today, with options of today."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import yaml

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
COMMANDS = {words: command for words, command, _ in commands()}
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


def ordered() -> Iterator[tuple[str, list[str]]]:
    """Yield file and words of the commands that Compose files give to containers."""
    for path in sorted(ROOT.glob("docker-compose*.yml")):
        services = yaml.load(path.read_text(), yaml.BaseLoader).get("services", {})
        for service in services.values():
            words = service.get("command") or []
            if words and words[0] in NAMES:
                yield path.name, words


@pytest.mark.parametrize(("name", "words"), list(ordered()))
def test_every_option_of_a_container_is_one_of_today(name, words):
    command = words[0] + (" run" if words[0] in ("router", "twin") else "")
    command = f"{command} {words[1]}" if command in GROUPS else command
    known = {flag for one in COMMANDS[command].params for flag in one.opts}
    given = {word.partition("=")[0] for word in words if word.startswith("--")}
    assert given <= known, name


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
