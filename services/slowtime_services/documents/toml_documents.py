"""Reader of TOML within bounds of size, depth and digits."""

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from .bounds import BOUNDS, MEBIBYTE, Bounds, DocumentError
from .numbers import finite_number

MOST_BYTES = MEBIBYTE
"""Size of a text [bytes]; the parser is written in Python, and takes a second for a MiB."""

WIDEST = 2**63
"""Integers are below, by TOML 1.0."""

_LONG_KEY = re.compile(r"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){32}")
"""A key or heading of more than 32 parts: the parser's time grows with their square."""


def read_toml(text: str, bounds: Bounds = BOUNDS) -> dict[str, Any]:
    r"""Read a TOML document.

    Raises
    ------
    DocumentError
        Where it is no TOML, or more than is allowed.

    Examples
    --------
    >>> read_toml("[serve]\nport = 8000")
    {'serve': {'port': 8000}}
    """
    if len(text) > min(MOST_BYTES, bounds.most_bytes):
        raise DocumentError(f"This has {len(text):,} characters. Allowed: {MOST_BYTES:,}.")
    if found := _LONG_KEY.search(text):
        raise DocumentError(
            "A key has more than 32 parts. Check full stops.",
            text.count("\n", 0, found.start()) + 1,
        )
    try:
        content = tomllib.loads(text, parse_float=finite_number)
    except tomllib.TOMLDecodeError as error:
        raise DocumentError(f"This is not TOML: {error}.") from None
    except RecursionError:
        raise DocumentError(
            "Its lists and tables are nested too deep. Check brackets."
        ) from None
    except (ValueError, OverflowError):  # of int and float, which quote the interpreter
        raise DocumentError("It has a number that is larger than numbers can be.") from None
    _refuse_beyond(content, bounds)
    return content


def _refuse_beyond(content: dict[str, Any], bounds: Bounds) -> None:
    level: list[Any] = [content]
    for _ in range(bounds.most_levels):
        level = list(_inside(level))
        if not level:
            return
    raise DocumentError(
        f"It is more than {bounds.most_levels} levels deep. Check brackets and keys."
    )


def _inside(values: list[Any]) -> Iterator[Any]:
    """Yield the lists and tables within some, and check the integers there."""
    for value in values:
        for inner in value.values() if isinstance(value, dict) else value:
            if isinstance(inner, dict | list):
                yield inner
            elif isinstance(inner, int) and not -WIDEST <= inner < WIDEST:
                raise DocumentError(
                    f"It has an integer of {inner.bit_length()} bits. Allowed: 64."
                )
