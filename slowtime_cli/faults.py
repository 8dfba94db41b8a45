"""What was wrong with somebody's input, in a sentence."""

from pydantic import ValidationError


def readable(error: ValidationError) -> str:
    """Say where which value was, and what it should have been."""
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(step) for step in item["loc"]) or "input"
        said = item["msg"].removeprefix("Value error, ").rstrip(".")
        parts.append(f"{where}={item['input']!r}: {said}")
    return "; ".join(parts)
