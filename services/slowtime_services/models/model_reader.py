"""Reader of model files, whose errors name the line."""

import dataclasses
import difflib
import pathlib
import typing
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from slowtime.dynamics.description import Description, DescriptionError
from slowtime.dynamics.effects import Kind, read_effects
from slowtime_schemas.files import model as schema
from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.files.model_v2 import (
    SECTIONS,
    FiniteElementFile,
    LineModelFile,
    MatrixElement,
    is_finite_elements,
)
from slowtime_services.descriptions import description_of
from slowtime_services.documents.bounds import DocumentError, document_text
from slowtime_services.documents.validation import validated
from slowtime_services.documents.yaml_lines import (
    EmptyYamlError,
    Path,
    YamlError,
    read_with_lines,
)

VERSIONS = (1, 2)
"""Versions of model files that are read."""
SHOWN = 8
"""Faults that are told of at once."""
File = typing.TypeVar("File", bound=BaseModel)
NAMES = (
    "name", "id", "between", "effect", "element", "node", "input", "sensor", "channel",
    "coordinates", "group", "groups", "leading", "following", "section", "material",
    "file", "variable", "dofs", "positions",
)  # fmt: skip
"""Keys of names, which may look like numbers."""


class ModelFileError(ValueError):
    """A model file that cannot be used; the text names line and cure."""


def read_model(path: str | pathlib.Path, kinds: Mapping[str, Kind] | None = None) -> ModelFile:
    """Read a model file (YAML or JSON), and check it whole.

    Parameters
    ----------
    kinds
        Of effect, by name; the catalogue where not given.

    Raises
    ------
    ModelFileError
        (a ValueError) naming line and cure. OSError where it cannot be opened.
    """
    path = pathlib.Path(path)
    return parse_model(_text(path), path.name, kinds)


def read_finite_elements(path: str | pathlib.Path) -> FiniteElementFile | None:
    """Read the text of a finite-element model, and check it without opening other files.

    Parameters
    ----------
    path
        Model file (YAML or JSON).

    Returns
    -------
    The model; None where the file describes nodes and elements on a line.

    Raises
    ------
    ModelFileError
        (a ValueError) naming line and cure. OSError where it cannot be opened.
    """
    path = pathlib.Path(path)
    text = _text(path)
    if not any(word in text for word in SECTIONS):
        return None  # not read twice: a long document takes seconds
    values, lines = _content(text, path.name)
    if not is_finite_elements(values):
        return None
    return _validated(FiniteElementFile, values, lines, path.name, len(text))


def _text(path: pathlib.Path) -> str:
    try:
        return document_text(path)
    except DocumentError as error:
        raise ModelFileError(str(error)) from None


def read_description(
    path: str | pathlib.Path, kinds: Mapping[str, Kind] | None = None
) -> Description:
    """Read a model file as the description it holds."""
    return description_of(read_model(path, kinds))


def parse_model(
    text: str,
    name: str,
    kinds: Mapping[str, Kind] | None = None,
    *,
    own: frozenset[str] = frozenset(),
) -> ModelFile:
    """Check the text of a model file.

    Parameters
    ----------
    name
        What errors call it.
    own
        Kinds of effect that are known elsewhere: nothing is checked of them here.
    """
    values, lines = _content(text, name)
    if is_finite_elements(values):
        raise ModelFileError(
            f"{name} is a finite-element model. Allowed here are nodes and elements on a line; "
            "reduce it first: slowtime model reduce MODEL --band-hz F --out REDUCED.yaml."
        )
    model = _validated(_family(values), values, lines, name, len(text))
    try:
        description = description_of(model)
        ours = tuple(entry for entry in description.effects if entry["effect"] not in own)
        read_effects(dataclasses.replace(description, effects=ours), kinds)
    except DescriptionError as error:
        line = lines[_known(error.where, lines)]
        raise ModelFileError(f"{name}, line {line}: {error}") from None
    return model


def _content(text: str, name: str) -> tuple[dict[str, Any], Mapping[Path, int]]:
    """Values of a file, and the line of each."""
    try:
        values, lines = read_with_lines(text, NAMES)
    except YamlError as error:
        cure = (
            " Begin it with `slowtime_model: 1`, or 2."
            if isinstance(error, EmptyYamlError)
            else ""
        )
        raise ModelFileError(f"{name}, line {error.line}: {error}{cure}") from None
    if not isinstance(values, dict):
        raise ModelFileError(
            f"{name} is not a valid model file. Begin it with `slowtime_model: 1`, or 2."
        )
    version = values.get("slowtime_model", 1)
    if version not in VERSIONS or isinstance(version, bool):
        raise ModelFileError(
            f"{name}, line {lines['slowtime_model',]}: `slowtime_model`: Allowed are 1 and 2, "
            f"not {version!r:.60}."
        )
    if version == 1 and is_finite_elements(values):
        raise ModelFileError(
            f"{name}, line {lines['slowtime_model',]}: finite elements need version 2. Write "
            "`slowtime_model: 2`."
        )
    return values, lines


def _family(values: Mapping[str, Any]) -> type[ModelFile]:
    return LineModelFile if values.get("slowtime_model") == 2 else ModelFile


def _validated(
    kind: type[File],
    values: dict[str, Any],
    lines: Mapping[Path, int],
    name: str,
    characters: int,
) -> File:
    try:
        return validated(kind, values, characters)
    except ValidationError as error:
        faults = [_fault(item, values, lines, kind) for item in error.errors(include_url=False)]
        faults = sorted(dict.fromkeys(faults))
        shown = [f"{name}, line {line}: {sentence}" for line, sentence in faults[:SHOWN]]
        if len(faults) > SHOWN:
            shown.append(f"... and {len(faults) - SHOWN} more.")
        raise ModelFileError("\n".join(shown)) from None


def _fault(
    item: ErrorDetails,
    values: dict[str, Any],
    lines: Mapping[Path, int],
    kind: type[BaseModel],
) -> tuple[int, str]:
    """Line and sentence of one thing that the schema refuses."""
    where = _known(item["loc"], lines)
    line, last = lines[where], str(item["loc"][-1])
    if item["type"] == "extra_forbidden":
        allowed = _keys(where[:-1], values, kind)
        near = difflib.get_close_matches(last, allowed, 1)
        hint = f"Did you mean `{near[0]}`? " if near else ""
        return line, f"unknown key `{last}`. {hint}Allowed: {', '.join(allowed)}."
    if item["type"] == "missing":
        return line, f"`{last}` is missing{_of(where)}. Add it."
    if item["type"] == "union_tag_invalid":
        ctx = item.get("ctx", {})
        return (
            lines.get((*where, "kind"), line),
            f"`kind: {ctx.get('tag')}` is not known. Allowed: {ctx.get('expected_tags')}.",
        )
    said = item["msg"].removeprefix("Value error, ")
    given = f", not {item['input']!r:.60}" if not isinstance(item["input"], dict | list) else ""
    name = next((str(step) for step in reversed(where) if isinstance(step, str)), "file")
    return line, f"`{name}`: {said}{given}."


def _known(loc: tuple[str | int, ...], lines: Mapping[Path, int]) -> Path:
    """Go along `loc` as far as the file does; a union's tag, put between, is left out."""
    path: Path = ()
    for step in loc:
        if (*path, step) in lines:
            path = (*path, step)
    return path


def _of(where: Path) -> str:
    steps = [f"number {step + 1}" if isinstance(step, int) else str(step) for step in where]
    return f" in {' '.join(steps)}" if steps else ""


def _keys(parent: Path, values: dict[str, Any], kind: type[BaseModel]) -> list[str]:
    """Keys that are allowed where `parent` leads to."""
    model: type[BaseModel] = kind
    if kind is FiniteElementFile or parent[:1] == ("geometry",):
        return list(_part_of(kind, parent).model_fields)
    if parent:
        part: Any = values
        for step in parent:
            part = part[step]
        beam = part.get("kind") == "beam"
        table: dict[str, type[BaseModel]] = {
            "nodes": schema.BeamNode if beam else schema.PointNode,
            "elements": _element_of(str(part.get("kind"))),
            "inputs": schema.ModelInput,
            "sensors": schema.ModelSensor,
            "supports": schema.ModelSupport,
            "initial": schema.ModelStart,
            "tolerance": schema.ModelTolerance,
        }
        model = table.get(str(parent[0]), ModelFile)
    return list(model.model_fields)


def _element_of(kind: str) -> type[BaseModel]:
    if kind == "matrix":
        return MatrixElement
    return schema.BeamElement if kind == "beam" else schema.SpringElement


def _part_of(model: type[BaseModel], path: Path) -> type[BaseModel]:
    """Class of the part of a file that a path leads to, by the annotations of its fields."""
    for step in path:
        if isinstance(step, str) and step in model.model_fields:
            found = _model_in(model.model_fields[step].annotation)
            model = model if found is None else found
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (_model_in(part) for part in typing.get_args(annotation))
    return next((part for part in inner if part is not None), None)
