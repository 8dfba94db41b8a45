"""Structures that age while nobody looks: slow evolution in, blocks of samples out."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Discriminator, Tag, TypeAdapter

from .evolutions import Constant as Constant
from .evolutions import Evolution as Evolution
from .evolutions import Fatigue as Fatigue
from .evolutions import FillingAndEmptying as FillingAndEmptying
from .evolutions import Linear as Linear
from .evolutions import Step as Step
from .frame import Machine as Machine
from .frame import SimulatedFrame as SimulatedFrame
from .listening import ORIGIN_NS as ORIGIN_NS
from .listening import Sensor as Sensor
from .listening import Simulated as Simulated
from .listening import Temperature as Temperature
from .modelled import SimulatedModel as SimulatedModel
from .oscillator import SimulatedStructure as SimulatedStructure


def _kind(given: Any) -> Any:
    """Tell what is meant; settings from before there were frames do not say."""
    return given.get("kind", "oscillator") if isinstance(given, dict) else given.kind


AnyStructure = Annotated[
    Annotated[SimulatedStructure, Tag("oscillator")]
    | Annotated[SimulatedFrame, Tag("frame")]
    | Annotated[SimulatedModel, Tag("model")],
    Discriminator(_kind),
]
"""Whatever can be simulated, by its `kind`; an oscillator where none is given."""


def simulated_structure(fields: Mapping[str, Any]) -> Simulated:
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
