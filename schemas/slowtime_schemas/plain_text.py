"""Refuses characters in names that are not seen but change how other text is shown.

A control character ends a line of a log or moves a terminal's cursor; a bidirectional control
lets ``x\u202egpj.exe`` appear as ``xexe.jpg`` (CVE-2021-42574). Imports no framework, so that
the command line checks a name before anything heavy is loaded.
"""

import unicodedata
from typing import Any

REFUSED_CATEGORIES = {
    "Cc": "a control character",
    "Cf": "an invisible formatting character",
    "Cs": "half of a surrogate pair",
    "Zl": "a line separator",
    "Zp": "a paragraph separator",
}
"""General categories of Unicode that no name needs, with what errors call them."""
JOINERS = frozenset("\u200c\u200d")
"""Invisible, but spelling: Persian and several Indic scripts are written with them."""
BIDIRECTIONAL = frozenset(
    "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)
"""Property Bidi_Control of the Unicode Standard (Annex 9)."""


def refused_character(text: str) -> str | None:
    r"""Describe the first character of `text` that no name may have; None where there is none.

    Examples
    --------
    >>> refused_character("Brücke 7 · الجسر")
    >>> refused_character("tower\u202e")
    'U+202E RIGHT-TO-LEFT OVERRIDE, a bidirectional control, at position 6'
    """
    for position, character in enumerate(text, start=1):
        kind = REFUSED_CATEGORIES.get(unicodedata.category(character))
        if kind is None or character in JOINERS:
            continue
        if character in BIDIRECTIONAL:
            kind = "a bidirectional control"
        called = unicodedata.name(character, "")
        code = f"U+{ord(character):04X}" + (f" {called}" if called else "")
        return f"{code}, {kind}, at position {position}"
    return None


def plain_text(text: str) -> str:
    r"""Return `text`, which is fit to be a name.

    Raises
    ------
    ValueError
        Where it has a control, bidirectional or other invisible character.

    Examples
    --------
    >>> plain_text("tower\x1b[2J")
    Traceback (most recent call last):
    ValueError: 'tower\x1b[2J' has U+001B, a control character, at position 6. Remove it: ...
    """
    found = refused_character(text)
    if found is not None:
        raise ValueError(
            f"{text[:80]!a} has {found}. Remove it: names have no control, bidirectional or "
            "invisible characters."
        )
    return text


def plain_throughout(value: Any) -> Any:
    """Return `value`, of whose keys and texts, however deep, each is fit to be a name.

    Raises
    ------
    ValueError
        As of `plain_text`.
    """
    if isinstance(value, str):
        return plain_text(value)
    if isinstance(value, dict):
        for key, part in value.items():
            plain_throughout(key)
            plain_throughout(part)
    elif isinstance(value, list | tuple):
        for part in value:
            plain_throughout(part)
    return value
