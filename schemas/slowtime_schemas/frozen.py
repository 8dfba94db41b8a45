"""The JSON Schemas as frozen, and the form of them that plotting tools understand."""

import functools
import json
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def folder() -> Path:
    """Return the folder of the frozen schemas: in the installed package, or in the checkout."""
    installed, checkout = HERE / "json", HERE.parent / "json"
    return installed if installed.is_dir() else checkout


@functools.cache
def schema_text(message: str, version: int) -> str:
    """Read the frozen JSON Schema of one version of a message.

    Raises
    ------
    LookupError
        Where no such version was ever frozen.
    """
    path = folder() / message / f"v{version}.json"
    if not path.is_file():
        known = sorted(f"{p.parent.name} {p.stem}" for p in folder().glob("*/v*.json"))
        raise LookupError(
            f"No schema of {message!r} v{version}. Frozen: {', '.join(known) or 'none'}. Run "
            "`python -m slowtime_schemas.freeze`."
        )
    return path.read_text()


def plotting_schema(schema: dict[str, Any]) -> dict[str, Any]:
    """Draw the same shape without references, alternatives and null.

    Lichtblick and the older Foxglove refuse a channel whose schema has `$ref` or `anyOf`, an
    object without `properties`, or a property without a single `type`. What may be null is
    described as what it is when it is there.

    Examples
    --------
    >>> plotting_schema({"anyOf": [{"type": "number", "title": "X"}, {"type": "null"}]})
    {'type': 'number'}
    """
    return _without_references(schema, schema.get("$defs", {}))


def _without_references(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in node:
        return _without_references(definitions[node["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in node:
        present = [option for option in node["anyOf"] if option.get("type") != "null"]
        return _without_references(present[0], definitions)
    kind = node["type"]
    plain: dict[str, Any] = {"type": kind}
    if kind == "object":
        parts = node.get("properties", {})
        plain["properties"] = {
            name: _without_references(part, definitions) for name, part in parts.items()
        }
    if kind == "array":
        plain["items"] = _without_references(node["items"], definitions)
    return plain


@functools.cache
def plotting_schema_text(message: str, version: int) -> str:
    """`plotting_schema` of a frozen version, as it goes into a recording."""
    return json.dumps(plotting_schema(json.loads(schema_text(message, version))))
