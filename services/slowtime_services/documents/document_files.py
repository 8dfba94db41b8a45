"""Files of TOML or JSON → plain values."""

import pathlib
from typing import Any

from .bounds import BOUNDS, Bounds, DocumentError, document_text
from .json_documents import read_json
from .toml_documents import read_toml


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
