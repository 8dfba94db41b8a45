"""Every promise names tests that try to break it, and they are there."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/promises.md").read_text()
NAMED = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


def promises() -> list[str]:
    """Items of the document that promise something."""
    promised = TEXT.partition("## Not promised")[0]
    return re.split(r"^- ", promised, flags=re.M)[1:]


def names_in(path: str) -> set[str]:
    tree = ast.parse((ROOT / path).read_text())
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    return {node.name for node in ast.walk(tree) if isinstance(node, kinds)}


def test_every_promise_names_a_test():
    assert len(promises()) > 20
    assert [item[:60] for item in promises() if not NAMED.search(item)] == []


@pytest.mark.gate
def test_every_test_that_is_named_exists():
    found = {path: names_in(path) for path, _ in NAMED.findall(TEXT) if (ROOT / path).is_file()}
    assert [
        f"{p}::{name}" for p, name in NAMED.findall(TEXT) if name not in found.get(p, ())
    ] == []


def test_every_word_of_make_that_is_named_is_one():
    words = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.M)
    assert set(re.findall(r"`make ([a-z-]+)`", TEXT)) <= set(words)
