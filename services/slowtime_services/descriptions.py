"""Conversion of model files to descriptions, without importing YAML or Numba."""

import base64

from slowtime.dynamics import description as described
from slowtime.dynamics.description import Description
from slowtime_schemas.files import model as schema
from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.files.model_v2 import AnyElement, MatrixElement


def description_of(model: ModelFile) -> Description:
    """Turn a model file into the description it is.

    Raises
    ------
    DescriptionError
        Where it contradicts itself.
    """
    return Description(
        name=model.name,
        nodes=tuple(described.Node(**node.model_dump()) for node in model.nodes),
        elements=tuple(_element(element) for element in model.elements),
        effects=tuple(effect.model_dump() for effect in model.effects),
        inputs=tuple(described.Input(**entry.model_dump()) for entry in model.inputs),
        sensors=tuple(_sensor(sensor) for sensor in model.sensors),
        tolerance=(
            None
            if model.tolerance is None
            else described.Tolerance(**model.tolerance.model_dump())
        ),
        unit_of_coordinate=model.unit_of_coordinate,
        supports=tuple(described.Support(**one.model_dump()) for one in model.supports),
        initial=tuple(described.Start(**one.model_dump()) for one in model.initial),
    )


def _sensor(sensor: schema.ModelSensor) -> described.Sensor:
    return described.Sensor(**(sensor.model_dump() | {"node": sensor.node or ""}))


def _element(element: AnyElement) -> described.Element:
    settings = element.model_dump(exclude={"kind"})
    if isinstance(element, schema.BeamElement):
        return described.Beam(**settings)
    if isinstance(element, MatrixElement):
        for name in ("stiffness", "mass", "damping"):
            settings[f"{name}_terms"] = base64.b64decode(settings.pop(name))
        return described.Matrix(**settings)
    return described.Spring(**settings)
