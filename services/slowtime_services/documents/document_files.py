"""Files of TOML or JSON → plain values."""

import pathlib
from typing import Any

from pydantic import ValidationError

from .bounds import BOUNDS, Bounds, DocumentError, document_text
from .json_documents import read_json
from .toml_documents import read_toml
from .validation import Content, validated


def read_settings_file(path: pathlib.Path, bounds: Bounds = BOUNDS) -> Any:
    """Read a .toml or .json file.

    Raises
    ------
    DocumentError
        Where it is neither, or more than is allowed. OSError where it cannot be opened.
    """
    if path.suffix == ".toml":
        return read_toml(document_text(path, bounds), bounds)
    if path.suffix == ".json":
        return read_json(document_text(path, bounds), bounds)
    raise DocumentError(f"{path.name} ends in {path.suffix!r}. Allowed: .toml and .json.")


def read_json_file(path: pathlib.Path, bounds: Bounds = BOUNDS) -> Any:
    """Read a .json file, as `read_json` does."""
    return read_json(document_text(path, bounds), bounds)


def read_checked_json(
    path: pathlib.Path, kind: type[Content], bounds: Bounds = BOUNDS
) -> Content:
    """Read a .json file of a kind.

    Raises
    ------
    DocumentError
        Where it is no JSON, more than is allowed, or of another kind; says the first fault.
        OSError where it cannot be opened.
    """
    text = document_text(path, bounds)
    try:
        return validated(kind, read_json(text, bounds), len(text))
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, fault["loc"]))
        said = fault["msg"].removeprefix("Value error, ")
        raise DocumentError(f"{where}: {said}" if where else said) from None
