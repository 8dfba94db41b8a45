"""Values of a document → a model of pydantic, at a bounded cost of its faults."""

import functools
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel
from pydantic_core import SchemaValidator

Content = TypeVar("Content", bound=BaseModel)

WHOLE_CHARACTERS = 1 << 16
"""Size up to which all faults of a document are found [1]. Each value of a document may be one,
and each fault takes some 25 µs and 2 kB: of 4 MiB, eleven seconds and a gigabyte."""

_MANY = ("list", "tuple", "set", "frozenset")


def validated(
    kind: type[Content],
    values: Any,
    characters: int,
    context: Mapping[str, Any] | None = None,
) -> Content:
    """Validate the values of a document.

    Parameters
    ----------
    characters
        Size of the document; of one above `WHOLE_CHARACTERS`, only the first faulty item of
        each list is told.

    Raises
    ------
    ValidationError
        Of pydantic, with the faults.
    """
    if characters <= WHOLE_CHARACTERS:
        return kind.model_validate(values, context=dict(context or {}))
    found: Content = _failing_fast(kind).validate_python(values, context=dict(context or {}))
    return found


@functools.cache
def _failing_fast(kind: type[BaseModel]) -> SchemaValidator:
    """Make a validator that leaves each list at its first faulty item."""
    kind.model_rebuild()
    # Without this argument the parts' own validators would be used, which go on.
    return SchemaValidator(_with_fail_fast(kind.__pydantic_core_schema__), _use_prebuilt=False)


def _with_fail_fast(schema: Any) -> Any:
    if isinstance(schema, dict):
        copy = {key: _with_fail_fast(value) for key, value in schema.items()}
        return {**copy, "fail_fast": True} if schema.get("type") in _MANY else copy
    if isinstance(schema, list | tuple):
        return type(schema)(map(_with_fail_fast, schema))
    return schema
