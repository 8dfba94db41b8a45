"""YAML or JSON files that are checked by a schema, with the line of each key."""

import pathlib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from slowtime_services.documents.bounds import (
    MEBIBYTE,
    Bounds,
    DocumentError,
    document_text,
)
from slowtime_services.documents.validation import validated
from slowtime_services.documents.yaml_lines import (
    EmptyYamlError,
    Path,
    YamlError,
    read_with_lines,
)

SIZE = Bounds(most_bytes=MEBIBYTE)
"""Up to which a file is read; a larger one is a record by mistake."""
SHOWN = 8
"""[faults] Of one file that an error lists."""

NAMES = ("marginal", "between", "of", "name")
"""Keys whose values are names, even where YAML would read them as numbers or truth values."""

Content = TypeVar("Content", bound=BaseModel)
Failure = Callable[[str], ValueError]


def read_text(path: pathlib.Path, failure: Failure) -> str:
    """Return the text of a file of at most 1 MiB.

    Raises
    ------
    ValueError
        As `failure` makes it. OSError where the file cannot be opened.
    """
    try:
        return document_text(path, SIZE)
    except DocumentError as error:
        raise failure(str(error)) from None


def parse_checked(
    text: str, name: str, schema: type[Content], kind: str, failure: Failure
) -> tuple[Content, Mapping[Path, int]]:
    """Parse a text and check it by its schema.

    Parameters
    ----------
    name
        What errors call the file.
    kind
        ``reliability`` for a file that begins with `slowtime_reliability: 1`.
    failure
        Makes the error of a sentence.

    Returns
    -------
    The content, and the line of each key.
    """
    try:
        values, lines = read_with_lines(text, NAMES)
    except YamlError as error:
        cure = (
            f" Begin it with `slowtime_{kind}: 1`." if isinstance(error, EmptyYamlError) else ""
        )
        raise failure(f"{name}, line {error.line}: {error}{cure}") from None
    if not isinstance(values, dict):
        raise failure(f"{name} is no {kind} file. Begin it with `slowtime_{kind}: 1`.")
    try:
        return validated(schema, values, len(text)), lines
    except ValidationError as error:
        told = sorted({_fault(item, lines) for item in error.errors(include_url=False)})
        said = [f"{name}, line {line}: {sentence}" for line, sentence in told[:SHOWN]]
        raise failure("\n".join(said)) from None


def line_of(where: Path, lines: Mapping[Path, int]) -> int:
    """Return the line of a place, or of the nearest one around it that the file has."""
    while where and where not in lines:
        where = where[:-1]
    return lines.get(where, 1)


def _fault(item: Any, lines: Mapping[Path, int]) -> tuple[int, str]:
    """Return the line of a fault that the schema has found, and a sentence on it."""
    where = tuple(item["loc"])
    last = where[-1] if where else "file"
    if item["type"] == "extra_forbidden":
        return line_of(where, lines), f"unknown key `{last}`."
    if item["type"] == "missing":
        return line_of(where, lines), f"`{last}` is missing. Add it."
    said = item["msg"].removeprefix("Value error, ")
    return line_of(where, lines), f"`{last}`: {said}."
