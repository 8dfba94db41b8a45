"""Whatever file a verb is given, its message is for users, and not for its developers."""

import os

import pytest

from slowtime_services.reasons import reason_of, without_internals
from tests.slowtime_cli.broken_inputs import (
    BROKEN,
    ENDINGS,
    ENDLESS,
    INTERNALS,
    arguments,
    is_read,
    preload,
    said_of,
    verbs,
)

INPUTS = [
    (words, command, param)
    for words, command in verbs()
    if words[0] not in ENDLESS
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
    for kind, make in BROKEN.items():
        for ending in ("",) if kind in ("missing", "folder") else ENDINGS:
            path = tmp_path / f"{kind}{ending}"
            make(path)
            given = [*words, *arguments(command, param, path.name)]
            status, said = said_of(given)
            assert status in STATUSES, (given, status, said)
            assert status != 1 or "Internal error" not in said, (given, said)
            assert said.strip() or status == 0, given
            assert not INTERNALS.search(said), (given, said)


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
