"""Read JavaScript source → its string literals, with where they stand."""

import re
from typing import NamedTuple

_TOKEN = re.compile(
    r"""(?P<comment>//[^\n]*|/\*.*?\*/)
      | (?P<string>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')
      | (?P<regex>(?<=[(,=:\[!&|?{;>\s])/(?![/*\s])
          (?:\\.|\[(?:\\.|[^\]\\\n])*\]|[^/\\\n\[])+/[gimsuy]*)
      | (?P<template>`)""",
    re.DOTALL | re.VERBOSE,
)


class Literal(NamedTuple):
    """A string literal; of a template the text, with `{}` where a value stands."""

    text: str
    start: int
    end: int
    nested: int
    """How many templates it stands in."""


def literals(source: str) -> list[Literal]:
    """All string literals of `source`, those within templates too, in no order."""
    found: list[Literal] = []
    _scan(source, 0, len(source), 0, found)
    return found


def _scan(source: str, start: int, stop: int, nested: int, found: list[Literal]) -> None:
    at = start
    while (match := _TOKEN.search(source, at, stop)) is not None:
        at = match.end()
        if match["string"]:
            found.append(Literal(_plain(match["string"][1:-1]), match.start(), at, nested))
        elif match["template"]:
            at = _template(source, match.start(), nested, found)


def _template(source: str, start: int, nested: int, found: list[Literal]) -> int:
    """Read a template that begins at `start`; where it ends."""
    text, at = [], start + 1
    while source[at] != "`":
        if source.startswith("${", at):
            end = _closing(source, at + 2)
            _scan(source, at + 2, end, nested + 1, found)
            text.append("{}")
            at = end + 1
        else:
            width = 2 if source[at] == "\\" else 1
            text.append(source[at : at + width])
            at += width
    found.append(Literal(_plain("".join(text)), start, at + 1, nested))
    return at + 1


def _closing(source: str, at: int) -> int:
    """Where the brace closes that was opened before `at`."""
    depth = 1
    while True:
        match = re.compile(r"[{}]|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'|`").search(source, at)
        assert match is not None
        at = match.end()
        if match[0] == "`":
            at = _template(source, match.start(), 0, [])
        elif match[0] in "{}":
            depth += 1 if match[0] == "{" else -1
            if depth == 0:
                return match.start()


def _plain(text: str) -> str:
    return re.sub(r"\\u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), text)


def arguments(
    source: str, opening: int, found_literals: list[Literal]
) -> list[tuple[int, int]]:
    """Where the arguments of a call stand whose parenthesis opens at `opening`."""
    ends = {one.start: one.end for one in found_literals}
    found, depth, at = [], 0, opening
    begin = opening + 1
    while at < len(source):
        if at in ends:
            at = ends[at]
            continue
        if source[at] in "([{":
            depth += 1
        elif source[at] in ")]}":
            depth -= 1
            if depth == 0:
                found.append((begin, at))
                return found
        elif source[at] == "," and depth == 1:
            found.append((begin, at))
            begin = at + 1
        at += 1
    raise ValueError(f"the call at {opening} is not closed")
