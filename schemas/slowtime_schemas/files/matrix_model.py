"""Version 2 of the model file: structures given by matrices of a finite-element program.

A file of version 1 is one of version 2 without `matrices`; `migrated` says so in its text.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from slowtime_schemas.quantities import PlainText

from .model import (
    Effect,
    Element,
    Id,
    ModelInput,
    ModelSensor,
    ModelTolerance,
    Node,
    Number,
    Part,
)

Direction = Literal["ux", "uy", "uz", "rx", "ry", "rz"]
FilePath = Annotated[str, Field(min_length=1, max_length=4096)]


class MatrixSource(Part):
    """A matrix in a file beside the model file."""

    file: FilePath
    variable: str | None = Field(
        default=None, description="Name in the file, where it holds several matrices."
    )


def _source(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


Source = Annotated[MatrixSource, BeforeValidator(_source)]


class MatrixParameter(Part):
    """A relative change of parts of the matrices: K + theta K_i, M + theta M_i."""

    name: Id
    stiffness: Source | None = None
    mass: Source | None = None
    prior_sd: Annotated[Number, Field(gt=0, le=2)] = Field(
        default=0.3, description="Standard deviation of the logarithm of the factor [1]."
    )

    @model_validator(mode="after")
    def _acts(self) -> "MatrixParameter":
        if self.stiffness is None and self.mass is None:
            raise ValueError(
                f"Parameter {self.name!r} has neither `stiffness` nor `mass`. Give the file "
                "of what it scales."
            )
        return self


class Held(Part):
    """Directions in which a node is held."""

    node: Id
    directions: tuple[Direction, ...] = ("ux", "uy", "uz", "rx", "ry", "rz")


class Matrices(Part):
    """Stiffness, mass and their parts, at zero parameters [N, m, kg]."""

    stiffness: Source
    mass: Source
    damping: Source | None = None
    dofs: FilePath | None = Field(
        default=None, description="Node and direction of each row; CSV, .dof or DMIG."
    )
    positions: FilePath | None = Field(
        default=None, description="Position of each node, where `dofs` does not say."
    )
    parameters: tuple[MatrixParameter, ...] = ()
    held: tuple[Held, ...] = ()


class MatrixSensor(Part):
    """What one channel measures of a structure given by matrices."""

    channel: Id
    node: Id
    direction: Direction | None = None
    line: tuple[Number, Number, Number] | None = Field(
        default=None, description="Line of sight: components along x, y and z."
    )
    quantity: Literal["acceleration", "velocity", "displacement"] = "acceleration"

    @model_validator(mode="after")
    def _points_somewhere(self) -> "MatrixSensor":
        if (self.direction is None) == (self.line is None):
            raise ValueError(
                f"Sensor {self.channel!r} has both or none of `direction` and `line`. Give one."
            )
        return self


class ModelFile2(Part):
    """A structure of nodes and elements on a line, or of matrices."""

    MESSAGE: ClassVar[str] = "model_file"
    VERSION: ClassVar[int] = 2

    slowtime_model: Literal[2] = Field(description="Version of this format.")
    name: PlainText = ""
    unit_of_coordinate: Literal["m", "rad"] = "m"
    matrices: Matrices | None = None
    nodes: tuple[Node, ...] = ()
    elements: tuple[Element, ...] = ()
    effects: tuple[Effect, ...] = ()
    inputs: tuple[ModelInput, ...] = ()
    sensors: tuple[MatrixSensor | ModelSensor, ...] = ()
    tolerance: ModelTolerance | None = None

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> "ModelFile2":
        if (self.matrices is None) == (not self.nodes):
            raise ValueError(
                "A model has either `matrices`, or `nodes` and `elements`. Give one of the two."
            )
        return self


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
