"""How much a newcomer has to take in, and what becomes of old names."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from slowtime_cli.__main__ import app
from slowtime_cli.shared.former_options import in_current_words
from slowtime_cli.shared.help_pages import SCREEN, Rare
from slowtime_cli.verbs.tree import OLD_NAMES, VERBS
from tests.slowtime_cli.command_tree import commands, leaf_options

ROOT = Path(__file__).parents[2]
MOST_VERBS, MOST_OPTIONS = 28, 350
SPEAKING = (
    "edge_agent", "schemas", "services", "slowtime", "slowtime_api", "slowtime_cli",
    "twin_server",
)  # fmt: skip
"""Packages whose messages may tell what to type."""
OTHERS = {"--data-checksums", "--force-reinstall", "--write"}
"""Options of other programs that messages name."""


def test_few_verbs_stand_at_top_level():
    shown = [name for name in app.list_commands(click.Context(app)) if name in VERBS]
    assert len(shown) == len(VERBS) <= MOST_VERBS


def test_all_leaves_together_have_few_options():
    names = [
        name
        for options in leaf_options().values()
        for option in options
        for name in {max(option.opts, key=len)} | {one for one in option.opts if "--" in one}
    ]
    assert len(names) <= MOST_OPTIONS


@pytest.mark.parametrize("words", ["", *[words for words, _, _ in commands() if words]])
def test_the_plain_help_fits_a_screen(run, words):
    done = run(*words.split(), "--help")
    assert done.status == 0
    assert len(done.out.splitlines()) <= SCREEN == 45


@pytest.mark.parametrize(
    ("words", "options"),
    [one for one in leaf_options().items() if one[1]],
    ids=lambda one: str(one)[:20],
)
def test_the_full_help_has_all_options_and_the_plain_one_says_where(run, words, options):
    plain = run(*words.split(), "--help").out
    whole = run(*words.split(), "--help-all").out
    missing = {max(one.opts, key=len) for one in options if one.opts[0] not in plain}
    assert all(max(one.opts, key=len) in whole for one in options)
    last = plain.splitlines()[-1]
    if missing:
        assert last == f"  All options and examples: slowtime {words} --help-all"
        assert {one.opts[0] for one in options if isinstance(one, Rare)} >= missing - {"--not"}
    for option in options:
        assert all(f"{key}=" in whole for key in getattr(option, "settings", ()))


@pytest.mark.parametrize("old", OLD_NAMES)
def test_an_old_name_works_and_names_the_new_one(run, old):
    done = run(old, "--help")
    new = run(*OLD_NAMES[old], "--help")
    assert (done.status, done.out, new.err) == (0, new.out, "")
    words = " ".join(OLD_NAMES[old])
    assert done.err == (
        f"`slowtime {old}` is now `slowtime {words}`; the old name ends with release 0.4.\n"
    )


def test_an_old_name_hands_its_arguments_on(refused):
    said = refused("quarantine", "list", "nonsense")
    assert "Usage: slowtime twin quarantine list [OPTIONS] TWIN" in said
    assert "'nonsense' is not a valid name" in said


def test_twin_with_options_or_nothing_runs_the_server(monkeypatch, run):
    ran = []
    monkeypatch.setattr("slowtime_cli.operation.twin.twin", lambda **given: ran.append(given))
    for words in (("twin", "--port", "1"), ("twin", "run", "--port", "1"), ("twin",)):
        assert run(*words).status == 0
    assert [given["port"] for given in ran] == [1, 1, None]
    assert "runs it" in run("twin", "--help").out


def test_router_with_options_runs_the_router(refused):
    said = refused("router", "--listen", "nonsense")
    assert said.startswith("Usage: slowtime router run")


@pytest.mark.parametrize(
    ("verb", "given", "now"),
    [
        (("identify",), "a.csv --skip-lines 3 --json", "a.csv --reading skip_lines=3 --out -"),
        (("identify",), "--not-wrapped a.csv", "--reading wrapped=no a.csv"),
        (("reliability",), "a.yaml --json", "a.yaml --out -"),
        (("fatigue",), "a.csv --sn=3", "a.csv --setting sn=3"),
        (("edge",), "--raw --recording a.mcap", "--setting raw=yes --file a.mcap"),
        (("modes", "distortion"), "a.csv --band 1 3", "a.csv --band-hz 1 3"),
        (("replay",), "a.mcap --fast", "a.mcap --speed 0"),
        (("demo",), "--frame --bridge", "--with frame --with bridge"),
        (("identify",), "--out --json -- --json", "--out --out - -- --json"),
    ],
)
def test_an_option_by_its_former_name_is_taken_and_names_the_new_one(verb, given, now, capsys):
    command = dict((words, one) for words, one, _ in commands())[" ".join(verb)]
    assert in_current_words(command, given.split()) == now.split()
    told = capsys.readouterr().err
    assert "the old name ends with release 0.4" in told
    assert in_current_words(command, now.split()) == now.split()
    assert capsys.readouterr().err == ""


def test_a_former_name_without_its_value_is_refused(refused):
    assert "--skip-lines needs 1 more" in refused("identify", "a.csv", "--skip-lines")


def test_what_a_verb_never_had_is_refused(refused):
    assert "No such option '--raw'" in refused("identify", "a.csv", "--raw")


def strings(package: str) -> Iterator[tuple[Path, int, str]]:
    """Yield the texts of a package, joined over the lines of a literal."""
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield path, node.lineno, " ".join(node.value.split())


def test_every_command_that_a_message_names_is_one_of_today():
    known = {words for words, _, _ in commands() if words}
    wrong = []
    for package in SPEAKING:
        for path, line, text in strings(package):
            for said in re.findall(r"`slowtime ((?:[a-z]+ ?)+)", text):
                first, *rest = said.split()
                nested = first in known and is_group(first) and rest
                if first not in known or (nested and f"{first} {rest[0]}" not in known):
                    wrong.append(f"{path.relative_to(ROOT)}:{line}: slowtime {said}")
    assert not wrong


def is_group(words: str) -> bool:
    """Whether these words lead to a group of commands."""
    return any(
        one == words and isinstance(command, click.Group) for one, command, _ in commands()
    )


def test_every_option_that_a_message_names_is_one_of_today():
    known = {
        name
        for options in leaf_options().values()
        for o in options
        for name in (*o.opts, *o.secondary_opts)
    }
    known |= {name for _, command, _ in commands() for o in command.params for name in o.opts}
    known |= {"--help", "--help-all"} | OTHERS
    wrong = {
        f"{path.relative_to(ROOT)}:{line}: {option}"
        for package in (
            "services/slowtime_services",
            "slowtime",
            "twin_server",
            "slowtime_cli",
            "edge_agent",
        )
        for path, line, text in strings(package)
        if " " in text
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+[a-z]", text)
        if option not in known
    }
    assert not wrong, "\n".join(sorted(wrong))


def test_every_key_that_a_message_names_is_one():
    keys = {
        key
        for options in leaf_options().values()
        for o in options
        for key in getattr(o, "settings", ())
    }
    assert {"skip_lines", "sn", "subject"} <= keys
    for package in SPEAKING:
        for path, line, text in strings(package):
            said = set(re.findall(r"(?<!A )--(?:reading|setting) (\w*_\w+|\w+(?==))", text))
            assert said <= keys | {"language"}, (path, line)
