"""Messages about invalid input."""

import sys
from typing import TYPE_CHECKING, Any, TypeGuard

from slowtime_schemas.plain_text import refused_character

if TYPE_CHECKING:
    from pydantic import ValidationError


def is_validation_error(error: Exception) -> "TypeGuard[ValidationError]":
    """Tell whether pydantic refused somebody's input, without importing pydantic to ask."""
    pydantic = sys.modules.get("pydantic")
    return pydantic is not None and isinstance(error, pydantic.ValidationError)


def validation_message(error: "ValidationError") -> str:
    """Say where which value was, and what it should have been."""
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(step) for step in item["loc"]) or "input"
        said = item["msg"].removeprefix("Value error, ").rstrip(".")
        parts.append(
            f"{where}={item['input']!r}: {said}{invisible_character(item['input'], said)}"
        )
    return "; ".join(parts)


def invisible_character(value: Any, said: str = "") -> str:
    r"""Name the character of a text that is not seen, where `said` does not.

    Examples
    --------
    >>> invisible_character("tower\u202e")
    '. It has U+202E RIGHT-TO-LEFT OVERRIDE, a bidirectional control, at position 6'
    >>> invisible_character("Tower")
    ''
    """
    found = refused_character(value) if isinstance(value, str) else None
    return f". It has {found}" if found is not None and found not in said else ""
