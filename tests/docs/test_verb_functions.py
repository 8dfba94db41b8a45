"""Every command that computes or asks a server has a function, and docs/python.md names it."""

import inspect
import re
from functools import reduce
from pathlib import Path
from typing import Any

import click
import pytest

import slowtime as st
from slowtime_cli.verbs.tree import paths
from slowtime_services.client import Client
from tests.slowtime_cli.command_tree import commands

PAGE = Path(__file__).parents[2] / "docs/python.md"
ROW = re.compile(r"^\| `([a-z ]+)` \| (.+?) \| \[.+?\]\((\w+\.md)\) \|$", re.M)
TABLE = {verb: (names, page) for verb, names, page in ROW.findall(PAGE.read_text())}
COMMANDS = {words: command for words, command, _ in commands()}
COMPUTING = ("models", "records", "twins")
"""Folders of verbs that compute or ask a server; those of `operation` run processes."""
OF_FILES = {"mcap layout", "mcap recover"}
"""Verbs on the files of other programs, and on damaged files."""
RENAMED = {"model place": {"number": "sensors"}}
"""Verb → option → parameter, where their names differ."""
OWN_DEFAULTS = {("twin forecast", "points")}
"""A terminal shows fewer points than a picture."""


def functions(verb: str) -> list[Any]:
    """Return the functions that the page names for a verb."""
    found = []
    for name in re.findall(r"`(st|client)\.([\w.]+)`", TABLE[verb][0]):
        start = st if name[0] == "st" else Client
        found.append(reduce(getattr, name[1].split("."), start))
    return found


def test_each_computing_verb_has_a_row_and_each_row_a_verb():
    computing = {words for words, one in paths() if one.place.startswith(COMPUTING)}
    assert set(TABLE) == computing - OF_FILES


@pytest.mark.parametrize("verb", TABLE)
def test_the_functions_of_a_verb_exist_and_its_page_does(verb):
    found = functions(verb)
    assert found
    assert all(callable(one) and one.__doc__ for one in found)
    assert (PAGE.parent / TABLE[verb][1]).exists()


@pytest.mark.parametrize("verb", TABLE)
def test_an_option_and_a_parameter_of_one_name_have_one_default(verb):
    command = COMMANDS[verb]
    names = RENAMED.get(verb, {})
    said = [*command.params]
    for one in command.params:
        said += getattr(one, "settings", {}).values()
    options = {names.get(one.name or "", one.name): one for one in said}
    for function in functions(verb):
        for name, parameter in inspect.signature(function).parameters.items():
            option = options.get(name)
            default = parameter.default
            if option is None or default is inspect.Parameter.empty or default is None:
                continue
            if (verb, name) in OWN_DEFAULTS:
                continue
            own = option.get_default(click.Context(command))
            if isinstance(own, int | float | str) and own != "auto":
                assert default == own, (function.__qualname__, name)
