"""Whatever file a verb is given, its message is for users, and not for its developers."""

import os
import signal
import subprocess
import sys

import pytest

from slowtime_services.reasons import reason_of, without_internals
from tests.fuzz.lying.models import MODEL, PROBLEM
from tests.slowtime_cli.broken_inputs import (
    BROKEN,
    ENDLESS,
    INTERNALS,
    SERVERS,
    arguments,
    is_read,
    preload,
    said_of,
    verbs,
)

INPUTS = [
    (words, command, param)
    for words, command in verbs()
    if " ".join(words) not in ENDLESS
    for param in command.params
    if is_read(param)
]
STATUSES = (0, 1, 2)


def test_each_verb_that_reads_a_file_is_tried():
    assert len({words for words, _, _ in INPUTS}) > 25


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(
    ("words", "command", "param"),
    INPUTS,
    ids=[f"{' '.join(words)} {param.opts[0]}" for words, _, param in INPUTS],
)
def test_no_broken_input_shows_internals(tmp_path, monkeypatch, words, command, param):
    monkeypatch.chdir(tmp_path)
    preload()
    for kind, broken in BROKEN.items():
        for ending in broken.endings:
            path = tmp_path / f"{kind}{ending}"
            broken.make(path)
            given = [*words, *arguments(command, param, path.name)]
            status, said = said_of(given, bound_by_modes=kind == "denied")
            runs_on = " ".join(words) in SERVERS and status == -signal.SIGTERM
            assert status in STATUSES or runs_on, (given, status, said)
            assert status != 1 or "Internal error" not in said, (given, said)
            assert said.strip() or status == 0 or runs_on, given
            assert not INTERNALS.search(said), (given, said)


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_verb_whose_output_is_not_read_ends_without_a_trace(tmp_path, monkeypatch):
    """The help of each verb, and what each says of a file, into pipes that are closed."""
    monkeypatch.chdir(tmp_path)
    preload()
    (tmp_path / "words.csv").write_text("It is a letter: dear friends,\nyours\n")
    asked = [[*words, "--help"] for words, _ in verbs()]
    asked += [
        [*words, *arguments(command, param, "words.csv")] for words, command, param in INPUTS
    ]
    for given in asked:
        for closed in (frozenset((1,)), frozenset((1, 2))):
            status, said = said_of(given, closed=closed)
            assert status in STATUSES, (given, closed, status, said)
            assert not INTERNALS.search(said), (given, closed, said)


@pytest.mark.long
@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["model", "effects"],
        ["plugins"],
        ["completion", "bash"],
        ["doctor", "--out", "-"],
        ["reliability", "p.yaml", "--out", "-"],
        [
            "simulate",
            "--model",
            "m.yaml",
            "--duration",
            "5",
            "--rate-hz",
            "100",
            "--out",
            "o.csv",
        ],
    ],
    ids=" ".join,
)
def test_a_pipe_that_ends_early_ends_a_command_in_order(tmp_path, words):
    """As in a shell, with the end of the interpreter: `slowtime ... | head -1`."""
    (tmp_path / "p.yaml").write_text(PROBLEM)
    (tmp_path / "m.yaml").write_text(MODEL)
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", *words],
        cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=write, stderr=subprocess.PIPE,
        text=True, timeout=200, check=False,
    )  # fmt: skip
    os.close(write)
    assert done.returncode in STATUSES, done
    assert not INTERNALS.search(done.stderr), done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("not a footer: <class 'mcap.records.Header'>", "not a footer: Header"),
        ("<frozen runpy>:128: it is odd", "it is odd"),
        ("cannot take <_io.BytesIO object at 0x7f3a5c0b1d50>", "cannot take BytesIO"),
        ("no key 'x'\nTraceback (most recent call last):\n  File \"a.py\"", "no key 'x'"),
        ("<function read at 0x7f3a5c0b1d50> failed", "read failed"),
        ("maximum recursion depth exceeded in comparison", "it is nested too deep"),
        (
            "Exceeds the limit (4300 digits) for integer string conversion: value has 5000 "
            "digits; use sys.set_int_max_str_digits() to increase the limit",
            "a number has more than 4300 digits",
        ),
        ("a < b and c > d at 0 Hz", "a < b and c > d at 0 Hz"),
    ],
)  # fmt: skip
def test_internals_are_left_out_of_a_sentence_and_nothing_else(text, plain):
    assert without_internals(text) == plain


def test_a_reason_of_the_system_names_the_file_and_no_number_of_an_error(tmp_path):
    with pytest.raises(FileNotFoundError) as missing:
        (tmp_path / "a.json").read_text()
    assert reason_of(missing.value).endswith("a.json: No such file or directory.")
    assert reason_of(ValueError("x" * 1000)).endswith("x ...")
