"""Version 2 of the model file: one line as in version 1, or a finite-element model.

A file of version 1 is one of version 2; `migrated` says so in its text.
"""

import base64
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    Discriminator,
    Field,
    RootModel,
    Tag,
    TypeAdapter,
    field_validator,
    model_validator,
)

from slowtime_schemas.quantities import Plain, PlainText

from .base64_text import checked_base64
from .finite_elements import FrameModel, Joint, Matrices, SpatialInput, SpatialSensor
from .geometry import Geometry
from .model import (
    BeamElement,
    Effect,
    Id,
    ModelFile,
    ModelTolerance,
    NotNegative,
    Number,
    Part,
    SpringElement,
)

SECTIONS = ("matrices", "frame")
"""Keys of which a finite-element model has one."""

MOST_COORDINATES = 200
"""Coordinates of one matrix: 160 kB of numbers each, a model of ten of them 2 MB."""

Packed = Annotated[str, Field(max_length=MOST_COORDINATES * (MOST_COORDINATES + 1) * 16 // 3)]


class MatrixElement(Part):
    """Dense matrices over some coordinates: a reduced substructure, or a part of it.

    A coordinate is a node, or a node and `.rotation`. Each matrix is the lower triangle, row by
    row, as little-endian numbers of 64 bits in base64; it is multiplied by its factor.
    """

    id: Id
    kind: Literal["matrix"]
    coordinates: tuple[Id, ...] = Field(min_length=2, max_length=MOST_COORDINATES)
    stiffness: Packed = ""
    mass: Packed = ""
    damping: Packed = ""
    stiffness_factor: Number = 1.0
    mass_factor: Number = 1.0
    damping_factor: Number = 1.0

    @property
    def between(self) -> tuple[str, ...]:
        """Nodes that it joins."""
        nodes = (name.removesuffix(".rotation") for name in self.coordinates)
        return tuple(dict.fromkeys(nodes))

    @field_validator("stiffness", "mass", "damping")
    @classmethod
    def _is_base64(cls, value: str) -> str:
        return checked_base64(value)

    @model_validator(mode="after")
    def _has_triangles(self) -> "MatrixElement":
        count = len(self.coordinates)
        expected = count * (count + 1) // 2
        for name in ("stiffness", "mass", "damping"):
            given = len(base64.b64decode(getattr(self, name)))
            if given not in (0, 8 * expected):
                raise ValueError(
                    f"`{name}` of element {self.id!r} holds {given / 8:g} numbers. Allowed is "
                    f"none, or the {expected} of a triangle over {count} coordinates."
                )
        if not (self.stiffness or self.mass or self.damping):
            raise ValueError(f"Element {self.id!r} has no matrix. Give one, or leave it out.")
        return self


def _kind(value: Any) -> Any:
    named = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return "spring" if named is None else named


AnyElement = Annotated[
    Annotated[SpringElement, Tag("spring")]
    | Annotated[BeamElement, Tag("beam")]
    | Annotated[MatrixElement, Tag("matrix")],
    Discriminator(_kind),
]


class LineModelFile(ModelFile):
    """Nodes and elements as in version 1, and elements given by matrices."""

    VERSION: ClassVar[int] = 2

    slowtime_model: Literal[2] = Field(  # type: ignore[assignment]
        description="Version of this format."
    )
    elements: tuple[AnyElement, ...] = ()  # type: ignore[assignment]
    geometry: Geometry | None = Field(
        default=None, description="Of the full model, for drawings of its mode shapes."
    )


def _version(value: Any) -> str:
    if isinstance(value, dict):
        return "2" if value.get("slowtime_model") == 2 else "1"
    return "2" if isinstance(value, LineModelFile) else "1"


AnyLineModel = Annotated[
    Annotated[ModelFile, Tag("1")] | Annotated[LineModelFile, Tag("2")],
    Discriminator(_version),
]
"""Nodes and elements of a model file of either version."""

_LINE_MODEL: TypeAdapter[ModelFile] = TypeAdapter(AnyLineModel)


def line_model(text: str, context: Any = None) -> ModelFile:
    """Read nodes and elements of a model file of either version.

    Parameters
    ----------
    text
        JSON.
    context
        Of the validation.

    Returns
    -------
    The model; a `LineModelFile` where it is of version 2.
    """
    return _LINE_MODEL.validate_json(text, context=context)


class FiniteElementFile(Part):
    """A structure given by finite-element matrices, or by a frame in space."""

    slowtime_model: Literal[2] = Field(description="Version of this format.")
    name: PlainText = ""
    matrices: Matrices | None = None
    frame: FrameModel | None = None
    damping_ratio: Annotated[Number, Field(ge=0, lt=1)] = Field(
        default=0.01,
        description="Of all modes, where `matrices` names no damping [1].",
    )
    joints: tuple[Joint, ...] = ()
    effects: tuple[Annotated[Effect, Plain], ...] = ()
    inputs: tuple[SpatialInput, ...] = ()
    sensors: tuple[SpatialSensor, ...] = ()
    tolerance: ModelTolerance | None = None
    band_hz: Annotated[NotNegative, Field(gt=0)] | None = Field(
        default=None, description="Upper end of the sensors' band, to which it is reduced."
    )

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> "FiniteElementFile":
        if (self.matrices is None) == (self.frame is None):
            raise ValueError(
                "A finite-element model has one of `matrices` and `frame`. Give one of the two."
            )
        return self


def _family(value: Any) -> str:
    keys = value if isinstance(value, dict) else getattr(value, "model_fields_set", ())
    return "finite elements" if any(key in keys for key in SECTIONS) else "line"


class ModelFile2(
    RootModel[
        Annotated[
            Annotated[LineModelFile, Tag("line")]
            | Annotated[FiniteElementFile, Tag("finite elements")],
            Discriminator(_family),
        ]
    ]
):
    """A model file of version 2: nodes and elements on a line, or finite elements."""

    MESSAGE: ClassVar[str] = "model_file"
    VERSION: ClassVar[int] = 2


def is_finite_elements(values: Mapping[str, Any]) -> bool:
    """Whether the content of a file is a finite-element model rather than one on a line."""
    return _family(dict(values)) == "finite elements"


def migrated(values: Mapping[str, Any]) -> dict[str, Any]:
    """Content of a model file of version 1 as one of version 2; version 2 as it is.

    Parameters
    ----------
    values
        Content of a file.

    Returns
    -------
    Content of version 2.

    Examples
    --------
    >>> migrated({"slowtime_model": 1, "nodes": []})["slowtime_model"]
    2
    """
    found = dict(values)
    if found.get("slowtime_model") == 1:
        found["slowtime_model"] = 2
    return found
