"""Simulated ageing structures: slow evolution in, blocks of samples out."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Discriminator, Tag, TypeAdapter

from .evolutions import Evolution, FatigueLoss, FillingAndEmptying, Linear, StepLoss, Unchanged
from .frame import Machine, SimulatedFrame
from .measurement import ORIGIN_NS, EvolvingStructure, SensorErrors, Temperature
from .model_structure import SimulatedModel
from .oscillator import SimulatedStructure


def _kind(given: Any) -> Any:
    """Return the kind of structure; settings from before there were frames lack it."""
    return given.get("kind", "oscillator") if isinstance(given, dict) else given.kind


AnyStructure = Annotated[
    Annotated[SimulatedStructure, Tag("oscillator")]
    | Annotated[SimulatedFrame, Tag("frame")]
    | Annotated[SimulatedModel, Tag("model")],
    Discriminator(_kind),
]
"""Whatever can be simulated, by its `kind`; an oscillator where none is given."""


def simulated_structure(fields: Mapping[str, Any]) -> EvolvingStructure:
    """Make the structure that `fields` describe.

    Examples
    --------
    >>> simulated_structure({"kind": "frame", "sensors": ("floor3",)}).channels
    ('a_floor3',)
    """
    adapter: TypeAdapter[SimulatedStructure | SimulatedFrame | SimulatedModel] = TypeAdapter(
        AnyStructure
    )
    return adapter.validate_python(dict(fields))


__all__ = [
    "ORIGIN_NS",
    "AnyStructure",
    "Evolution",
    "EvolvingStructure",
    "FatigueLoss",
    "FillingAndEmptying",
    "Linear",
    "Machine",
    "SensorErrors",
    "SimulatedFrame",
    "SimulatedModel",
    "SimulatedStructure",
    "StepLoss",
    "Temperature",
    "Unchanged",
    "simulated_structure",
]
