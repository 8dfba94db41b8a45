"""Examples are promises: those in the help of every verb parse, and the short ones run."""

import itertools
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

from slowtime_cli.__main__ import app
from slowtime_cli.shared.examples import ENDLESS_VERBS, EXAMPLES, FIRST_EXAMPLE, HEADING
from slowtime_cli.verbs.tree import VERBS, paths
from tests.docs.tutorials import can_run

FILE = re.compile(
    r"[\w.-]+\.(csv|txt|npy|npz|mat|mcap|tdms|json|toml|yaml|sqlite|pem|py|bdf|inp)"
)
RUN = ("simulate", "identify", "twin evolve")
PATHS = [words for words, _ in paths()]


def verb(name: str) -> click.Command:
    command: click.Command | None = app
    for word in name.split():
        assert isinstance(command, click.Group)
        command = command.get_command(click.Context(command), word)
    assert command is not None
    return command


def examples(epilog: str) -> list[list[str]]:
    """Arguments of each `slowtime` in lines of examples, without what is said beside them."""
    found = []
    for line in epilog.replace("\\\n", " ").splitlines():
        example = re.split(r"(?<=\S)\s{2,}", line.strip())[0]
        lexer = shlex.shlex(example, posix=True, punctuation_chars="|&")
        lexer.whitespace_split = True
        for divides, part in itertools.groupby(lexer, lambda word: set(word) <= set("|&")):
            words = [] if divides else list(itertools.takewhile(_is_argument, part))
            while words and re.fullmatch(r"[A-Z_]+=\S+", words[0]):
                words = words[1:]
            if words[:1] == ["slowtime"]:
                found.append(words[1:])
    return found


def _is_argument(word: str) -> bool:
    return word not in (">", ">>")  # what follows is a file of the shell


def of_help(name: str) -> list[list[str]]:
    return examples((verb(name).epilog or "").partition(HEADING)[0])


def parse(arguments: list[str]) -> None:
    """Let click parse, with all files and folders named in place, and run nothing."""
    for before, word in itertools.pairwise(arguments):
        if before in ("--credentials", "--batch"):
            os.makedirs(word, exist_ok=True)
    for word in arguments:
        if FILE.fullmatch(word):
            open(word, "a").close()
    assert arguments[0] in VERBS
    command: click.Command = app
    context = click.Context(app, info_name="slowtime")
    while isinstance(command, click.Group):
        inner = command.make_context("slowtime", arguments, parent=context)
        name, found, arguments = command.resolve_command(
            inner, [*inner._protected_args, *inner.args]
        )
        assert found is not None
        command, context = found, inner
    command.make_context(name, arguments, parent=context).close()


def test_examples_are_found_as_they_are_written():
    said = """\b
Examples:
  slowtime demo --port 8080            another port
  SLOWTIME_EDGE_SITE=lab slowtime edge --config a.toml
  slowtime twin & slowtime edge --simulate tower   # both
  curl http://127.0.0.1:8000/slowtime
"""
    assert examples(said) == [
        ["demo", "--port", "8080"],
        ["edge", "--config", "a.toml"],
        ["twin"],
        ["edge", "--simulate", "tower"],
    ]


def test_an_example_with_a_wrong_flag_does_not_parse(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(click.NoSuchOption):
        parse(["identify", "record.csv", "--rate", "200"])
    with pytest.raises(click.BadParameter):
        parse(["simulate", "--structure", "cathedral", "--out", "a.mcap"])
    with pytest.raises(click.UsageError, match="unexpected extra argument"):
        parse(["identify", "record.csv", "other.csv"])


@pytest.mark.parametrize("name", PATHS)
def test_every_help_ends_with_examples_of_its_verb_that_parse(run, name):
    said = run(*name.split(), "--help-all")
    assert (said.status, said.err) == (0, "")
    assert "\n  Examples:\n    " in said.out.partition("Options:")[2]
    found = of_help(name)
    if found:  # the example of `twin run` is that of `twin`
        words = name.removesuffix(" run").split()
        assert words in [example[: len(words)] for example in found]
    for arguments in found:
        parse(arguments)


def test_the_first_help_has_examples_that_parse(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = examples(app.epilog or "")
    assert len(found) >= 3
    for arguments in found:
        parse(arguments)


@pytest.mark.long
def test_the_short_examples_run_one_after_the_other(run, tmp_path):
    """Those that name only what an earlier one has written."""
    done = []
    for arguments in (example for name in RUN for example in of_help(name)):
        inputs = [
            word
            for before, word in itertools.pairwise(arguments)
            if FILE.fullmatch(word) and before != "--out"
        ]
        if all((tmp_path / name).exists() for name in inputs):
            result = run(*arguments)
            assert result.status == 0, (arguments, result.err)
            done.append(" ".join(arguments[:2]) if arguments[0] == "twin" else arguments[0])
    assert set(done) == set(RUN)
    assert len(done) >= 4
    assert (tmp_path / "states.json").exists()


@pytest.mark.parametrize("name", PATHS)
def test_every_help_ends_with_a_line_to_paste_that_parses(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "house").mkdir()
    (tmp_path / "house/twin.sqlite").touch()
    (tmp_path / "tokens.json").touch()
    ends = (verb(name).epilog or "").partition(HEADING)[2]
    found = examples(re.sub(r"\\\n\s+", "", ends).replace(";", "&"))
    words = name.removesuffix(" run").split()
    assert any(example[: len(words)] == words[: len(example)] for example in found)
    for arguments in found:
        parse(arguments)


def test_the_first_help_ends_with_a_line_to_paste():
    pasted = (app.epilog or "").partition(HEADING)[2]
    assert pasted.replace("\\", "").split() == FIRST_EXAMPLE.split()


@pytest.mark.slow
@pytest.mark.system
@pytest.mark.parametrize("name", ["--help", *EXAMPLES])
def test_what_a_help_ends_with_works_when_pasted(name, tmp_path):
    if reason := can_run():
        pytest.skip(reason)
    command = app if name == "--help" else verb(name)
    (tmp_path / ".typed").write_text((command.epilog or "").partition(HEADING)[2])
    patience = 25 if name in ENDLESS_VERBS else 300
    shell = f"ip link set lo up; timeout -s INT -k 9 {patience} bash -m ./.typed"
    place = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["unshare", "-rn", "--kill-child", "--pid", "--fork", "bash", "-c", shell],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=330,
        env=os.environ | {"PATH": place, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode in ((0, 124, 137) if name in ENDLESS_VERBS else (0,)), done
    assert "Error" not in done.stderr
    assert "Traceback" not in done.stderr
