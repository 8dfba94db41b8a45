"""The model file: a structure described once, for simulator, diagnosis and twin alike.

What a schema can say is said here; that nodes exist and units fit is checked where a file is
read, so that the error can name the line.
"""

import re
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    StringConstraints,
    Tag,
)

from slowtime_schemas.quantities import Frozen, Plain, PlainText

NUMBER = re.compile(r"[-+]?(\.\d+|\d+(\.\d*)?)([eE][-+]?\d+)?", re.ASCII)
"""A finite number of the core schema of YAML 1.2, and of JSON."""


def _is_number(value: Any) -> Any:
    # A truth value would pass for 1 or 0, and 1_000 or 1:30, which are text since YAML 1.2, for
    # what they were in YAML 1.1.
    if isinstance(value, bool):
        raise ValueError(f"{value} is a truth value, not a number")
    if isinstance(value, str) and not NUMBER.fullmatch(value):
        raise ValueError("this is text, not a number. Write it as in 1000 or 4.0e7")
    return value


Number = Annotated[FiniteFloat, BeforeValidator(_is_number)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Id = Annotated[str, StringConstraints(pattern=r"^\S(.{0,62}\S)?$"), Plain]
Unit = Annotated[str, StringConstraints(min_length=1, max_length=32), Plain]


class Part(Frozen):
    """Any part of a model file; names may be written as bare numbers."""

    model_config = ConfigDict(coerce_numbers_to_str=True)


class PointNode(Part):
    """A mass that moves along one line."""

    id: Id
    kind: Literal["point"] = "point"
    mass_kg: Positive


class BeamNode(Part):
    """Where beams meet: it moves and turns."""

    id: Id
    kind: Literal["beam"]
    mass_kg: NotNegative = 0.0
    rotary_inertia_kg_m2: NotNegative = 0.0
    held: tuple[Literal["translation", "rotation"], ...] = Field(
        default=(), description="What follows the base: translation at a pin."
    )


class SpringElement(Part):
    """A spring and a damper side by side; `base` is the ground or the shaking base."""

    id: Id
    kind: Literal["spring"] = "spring"
    between: tuple[Id, Id]
    stiffness_n_per_m: Number = 0.0
    damping_n_s_per_m: Number = 0.0


class BeamElement(Part):
    """A uniform Euler–Bernoulli beam; `base` clamps that end."""

    id: Id
    kind: Literal["beam"]
    between: tuple[Id, Id]
    length_m: Positive
    bending_stiffness_n_m2: Positive
    mass_kg_per_m: NotNegative
    damping_s: NotNegative = Field(
        default=0.0, description="Kelvin–Voigt: damping over stiffness matrix [s]."
    )


def _kind(usual: str) -> Discriminator:
    def kind(value: Any) -> Any:
        named = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
        return usual if named is None else named

    return Discriminator(kind)


Node = Annotated[
    Annotated[PointNode, Tag("point")] | Annotated[BeamNode, Tag("beam")], _kind("point")
]
Element = Annotated[
    Annotated[SpringElement, Tag("spring")] | Annotated[BeamElement, Tag("beam")],
    _kind("spring"),
]


class Effect(Part):
    """What the linear elements lack, by name, place and parameters of its own."""

    model_config = ConfigDict(extra="allow")

    effect: Id


class ModelInput(Part):
    """A measured force on a node, or the measured motion of the base or of a support."""

    channel: Id
    kind: Literal[
        "force",
        "base_acceleration",
        "base_velocity",
        "base_displacement",
        "imposed_acceleration",
        "imposed_velocity",
        "imposed_displacement",
    ]
    node: Id | None = Field(
        default=None,
        description="Node that a force acts on; support or driven node of an imposed motion.",
    )
    unit: Unit
    hold: Literal["band_limited", "first", "zero"] | None = Field(
        default=None,
        description="What it does between samples: the band-limited signal through them, "
        "straight lines (first-order hold), steps (zero-order hold). Found out where not said.",
    )


class ModelSensor(Part):
    """What one channel measures."""

    channel: Id
    quantity: Literal["acceleration", "velocity", "displacement", "force"]
    node: Id | None = Field(
        default=None,
        description="Node whose motion is measured; of a force, the base, support or driven "
        "node on which it acts from outside.",
    )
    element: Id | None = Field(
        default=None, description="Spring element whose force is measured."
    )
    frame: Literal["absolute", "relative_to_base"] = "absolute"
    unit: Unit
    noise_sd: NotNegative | None = Field(
        default=None, description="Of white noise, in the unit of the channel."
    )


class ModelSupport(Part):
    """A point that elements end at; it moves as an input states, or else with the base."""

    id: Id
    still: bool = Field(
        default=False, description="It stands still in space, whatever the base does."
    )


class ModelStart(Part):
    """Initial state of a node in a simulation, relative to the base."""

    node: Id
    displacement_m: Number = 0.0
    velocity_m_per_s: Number = 0.0


class ModelTolerance(Part):
    """Relative standard deviation of what the file claims."""

    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    mass: NotNegative = 0.0


class ModelFile(Part):
    """A structure of nodes and elements, what shakes it and what listens."""

    MESSAGE: ClassVar[str] = "model_file"
    VERSION: ClassVar[int] = 1

    slowtime_model: Literal[1] = Field(description="Version of this format.")
    name: PlainText = ""
    unit_of_coordinate: Literal["m", "rad"] = Field(
        default="m",
        description="rad makes every length an angle, force a torque, mass an inertia.",
    )
    nodes: tuple[Node, ...]
    supports: Annotated[
        tuple[ModelSupport, ...],
        Field(description="Points other than the base that elements end at and inputs move."),
    ] = ()
    elements: tuple[Element, ...] = ()
    effects: tuple[Annotated[Effect, Plain], ...] = ()
    inputs: Annotated[
        tuple[ModelInput, ...], Field(description="None listed: ambient, unmeasured.")
    ] = ()
    sensors: tuple[ModelSensor, ...] = ()
    initial: Annotated[
        tuple[ModelStart, ...],
        Field(description="Initial states in a simulation; nodes not named are at rest."),
    ] = ()
    tolerance: ModelTolerance | None = None
