"""Reader of JSON within bounds of size, depth, values and digits, without keys that repeat."""

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from .bounds import BOUNDS, Bounds, DocumentError, refuse_many_values
from .numbers import finite_number, whole_number

_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)
_LEVELS = np.zeros(256, np.int8)
_LEVELS[list(b"[{")], _LEVELS[list(b"]}")] = 1, -1
_PIECE = 65_536
"""Bytes of a document in which texts are left out at a time: each costs some 100 bytes."""
_SHOWN = 40
"""Characters of a value that an error quotes [1]."""


def read_json(text: str | bytes, bounds: Bounds = BOUNDS) -> Any:
    """Read a JSON document.

    Parameters
    ----------
    text
        The document; bytes are UTF-8, UTF-16 or UTF-32.

    Raises
    ------
    DocumentError
        Where it is no JSON, or more than is allowed.

    Examples
    --------
    >>> read_json('{"a": [1, 2.5]}')
    {'a': [1, 2.5]}
    """
    if isinstance(text, bytes):
        try:
            text = text.decode(json.detect_encoding(text))
        except UnicodeDecodeError as error:
            raise DocumentError(f"This is not text (byte {error.start}).") from None
    if len(text) > bounds.most_bytes:
        raise DocumentError(
            f"This has {len(text):,} characters. Allowed: {bounds.most_bytes:,}."
        )
    refuse_many_values(text, bounds)
    levels = _levels(text)
    if levels > bounds.most_levels:
        raise DocumentError(
            f"This is {levels:,} levels deep. Allowed: {bounds.most_levels}. Check brackets."
        )
    try:
        return json.loads(
            text,
            parse_int=_quoting(whole_number),
            parse_float=_quoting(finite_number),
            object_pairs_hook=_without_repetition,
        )
    except json.JSONDecodeError as error:
        raise DocumentError(
            f"This is not JSON: {error.msg}, line {error.lineno}, column {error.colno}.",
            error.lineno,
        ) from None


def _levels(text: str) -> int:
    """Count the levels of lists and tables, outside of texts."""
    data, at, level, most = text.encode("utf-8", "replace"), 0, 0, 0
    while at < len(data):
        piece = data[at : at + _PIECE]
        bare = _TEXT.sub(b"", piece)
        at += len(piece)
        opened = bare.find(b'"')
        if opened >= 0:  # a text that goes on behind the piece
            whole = _TEXT.match(data, at - (len(bare) - opened))
            at, bare = whole.end() if whole else len(data), bare[:opened]
        levels = level + np.cumsum(_LEVELS[np.frombuffer(bare, np.uint8)], dtype=np.int64)
        level, most = int(levels[-1]) if len(levels) else level, int(levels.max(initial=most))
    return most


def _quoting(read: Callable[[str], Any]) -> Callable[[str], Any]:
    def number(text: str) -> Any:
        try:
            return read(text)
        except OverflowError as error:
            raise DocumentError(f"`{text[:_SHOWN]}` is not a valid number: {error}.") from None

    return number


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise DocumentError(f"`{twice[:_SHOWN]}` stands twice in one table. Remove one.")
    return table
