"""Messages about invalid input."""

import reprlib
import sys
from typing import TYPE_CHECKING, Any, TypeGuard

from slowtime_schemas.plain_text import refused_character

if TYPE_CHECKING:
    from pydantic import ValidationError


SHOWN = 8
"""Faults of one input that a message lists."""
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 3, 200, 200


def is_validation_error(error: Exception) -> "TypeGuard[ValidationError]":
    """Whether pydantic refused an input, without importing pydantic."""
    pydantic = sys.modules.get("pydantic")
    return pydantic is not None and isinstance(error, pydantic.ValidationError)


def validation_message(error: "ValidationError") -> str:
    """Name the invalid value, its place, and the values allowed."""
    parts = []
    faults = error.errors(include_url=False)
    for item in faults[:SHOWN]:
        where = ".".join(str(step) for step in item["loc"]) or "input"
        said = item["msg"].removeprefix("Value error, ").rstrip(".")
        parts.append(
            f"{where}={_SHORT.repr(item['input'])}: "
            f"{said}{invisible_character(item['input'], said)}"
        )
    if len(faults) > SHOWN:
        parts.append(f"and {len(faults) - SHOWN} more")
    return "; ".join(parts)


def invisible_character(value: Any, said: str = "") -> str:
    r"""Name an invisible character of a text, if `said` does not.

    Examples
    --------
    >>> invisible_character("tower\u202e")
    '. It has U+202E RIGHT-TO-LEFT OVERRIDE, a bidirectional control, at position 6'
    >>> invisible_character("Tower")
    ''
    """
    found = refused_character(value) if isinstance(value, str) else None
    return f". It has {found}" if found is not None and found not in said else ""
