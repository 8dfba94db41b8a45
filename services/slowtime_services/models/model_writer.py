"""Writer of model files, in the form in which a person would write them."""

import base64
import dataclasses
from pathlib import Path
from typing import Any

import yaml

from slowtime.dynamics.description import Beam, Description, Element, Matrix
from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.files.model_v2 import LineModelFile
from slowtime_services.documents.core_schema import CoreDumper

GROUPS = ("nodes", "supports", "elements", "effects", "inputs", "sensors", "initial")


def model_file_of(description: Description) -> ModelFile:
    """Convert a description to a model file: of version 2 where it has matrices, else of 1."""
    tolerance = description.tolerance
    newer = any(isinstance(element, Matrix) for element in description.elements)
    return (LineModelFile if newer else ModelFile).model_validate(
        {
            "slowtime_model": 2 if newer else 1,
            "name": description.name,
            "unit_of_coordinate": description.unit_of_coordinate,
            "nodes": [_node(dataclasses.asdict(node)) for node in description.nodes],
            "elements": [_element(element) for element in description.elements],
            "effects": [dict(effect) for effect in description.effects],
            "inputs": [dataclasses.asdict(entry) for entry in description.inputs],
            "sensors": [
                dataclasses.asdict(sensor) | {"node": sensor.node or None}
                for sensor in description.sensors
            ],
            "supports": [dataclasses.asdict(support) for support in description.supports],
            "initial": [dataclasses.asdict(start) for start in description.initial],
            "tolerance": None if tolerance is None else dataclasses.asdict(tolerance),
        }
    )


def model_text(model: ModelFile | Description) -> str:
    """Write as YAML, one line a node, element and channel; defaults are left out.

    Reading it back gives the same model to the last digit.
    """
    if isinstance(model, Description):
        model = model_file_of(model)
    values = model.model_dump(mode="json", exclude_defaults=True)
    text = [f"slowtime_model: {model.slowtime_model}\n"]
    for key in ("name", "unit_of_coordinate", *GROUPS, "tolerance", "geometry"):
        if key in values:
            text.append(_entry(key, values[key]))
    return "".join(text)


def write_model(path: str | Path, model: ModelFile | Description) -> None:
    """Write a model file; a path that exists is written over."""
    Path(path).write_text(model_text(model), encoding="utf-8")


def _entry(key: str, value: Any) -> str:
    if isinstance(value, list):
        return f"{key}:\n" + "".join(f"  - {_flow(item)}" for item in value)
    return f"{key}: {_flow(value)}"


def _flow(value: Any) -> str:
    text = yaml.dump(
        value,
        Dumper=CoreDumper,
        default_flow_style=True,
        sort_keys=False,
        width=10**6,
        allow_unicode=True,
    )
    return str(text).removesuffix("...\n")


def _node(settings: dict[str, Any]) -> dict[str, Any]:
    if settings["kind"] == "point":
        return {key: settings[key] for key in ("id", "mass_kg")}
    return settings


def _element(element: Element) -> dict[str, Any]:
    if isinstance(element, Matrix):
        settings = dataclasses.asdict(element)
        # Of models that a diagnosis reduces for itself; files state tolerances.
        del settings["exact"]
        terms = {
            name: base64.b64encode(settings.pop(f"{name}_terms")).decode("ascii")
            for name in ("stiffness", "mass", "damping")
        }
        return {"kind": "matrix"} | settings | terms
    kind = {"kind": "beam"} if isinstance(element, Beam) else {}
    return kind | dataclasses.asdict(element)
