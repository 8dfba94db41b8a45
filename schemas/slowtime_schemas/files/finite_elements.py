"""Sections of a model file of version 2 that describe a finite-element model.

`matrices` names files that a finite-element program wrote; `frame` describes a frame or a truss
in space. Sensors, inputs and joints are at a node in a direction.
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from slowtime_schemas.quantities import Plain

from .model import Id, NotNegative, Number, Part, Positive, Unit

Direction = Literal["ux", "uy", "uz", "rx", "ry", "rz"]
Axis = Literal["ux", "uy", "uz"]
FilePath = Annotated[str, Field(min_length=1, max_length=4096), Plain]
Vector = tuple[Number, Number, Number]
ALL: tuple[Direction, ...] = ("ux", "uy", "uz", "rx", "ry", "rz")


class MatrixSource(Part):
    """A matrix in a file beside the model file."""

    file: FilePath
    variable: str | None = Field(
        default=None, description="Name in the file, where it holds several matrices."
    )


def _source(value: Any) -> Any:
    return {"file": value} if isinstance(value, str) else value


Source = Annotated[MatrixSource, BeforeValidator(_source)]


class PartSource(MatrixSource):
    """What a parameter scales: by itself, or by the whole matrix with the group changed."""

    change: Number | None = Field(
        default=None,
        description="The file holds the whole matrix with the group changed by this much, such "
        "as -0.1, and not what the group contributes [1].",
    )

    @model_validator(mode="after")
    def _changes(self) -> "PartSource":
        if self.change == 0.0:
            raise ValueError(
                f"{self.file} is said to have a `change` of 0. Give the relative change with "
                "which it was exported, such as -0.1."
            )
        return self


GroupSource = Annotated[PartSource, BeforeValidator(_source)]
PriorSd = Annotated[
    Number,
    Field(gt=0, le=2, description="Standard deviation of the logarithm of the factor [1]."),
]


class MatrixParameter(Part):
    """A relative change of parts of the matrices: K + theta K_i, M + theta M_i."""

    name: Id
    stiffness: GroupSource | None = None
    mass: GroupSource | None = None
    prior_sd: PriorSd = 0.3

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
    directions: tuple[Direction, ...] = ALL


class Matrices(Part):
    """Stiffness, mass and their parts, at zero parameters [N, m, kg]."""

    stiffness: Source
    mass: Source
    damping: Source | None = None
    dofs: FilePath | None = Field(
        default=None,
        description="Node and direction of each row; CSV, .dof, DMIG or OpenSees JSON.",
    )
    positions: FilePath | None = Field(
        default=None, description="Position of each node, where `dofs` does not say."
    )
    parameters: tuple[MatrixParameter, ...] = ()
    held: tuple[Held, ...] = ()


class FrameMaterial(Part):
    """A linear elastic material."""

    id: Id
    young_pa: Positive
    poisson: Annotated[Number, Field(gt=-1, lt=0.5)] = 0.3
    density_kg_m3: NotNegative = 0.0


class FrameSection(Part):
    """A cross-section: by its numbers, or a rectangle or a tube by its sizes."""

    id: Id
    shape: Literal["general", "rectangle", "tube"] = "general"
    area_m2: Positive | None = None
    inertia_y_m4: NotNegative = 0.0
    inertia_z_m4: NotNegative = 0.0
    torsion_m4: NotNegative = 0.0
    shear_y_m2: Positive | None = None
    shear_z_m2: Positive | None = None
    width_m: Positive | None = Field(default=None, description="Of a rectangle, along y.")
    height_m: Positive | None = Field(default=None, description="Of a rectangle, along z.")
    diameter_m: Positive | None = Field(default=None, description="Of a tube, outside.")
    wall_m: Positive | None = Field(default=None, description="Of a tube.")

    @model_validator(mode="after")
    def _has_its_sizes(self) -> "FrameSection":
        needed = {
            "general": ("area_m2",),
            "rectangle": ("width_m", "height_m"),
            "tube": ("diameter_m", "wall_m"),
        }[self.shape]
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            raise ValueError(
                f"Section {self.id!r} of shape {self.shape} lacks {', '.join(missing)}. Add "
                "it, or name another `shape`: general, rectangle, tube."
            )
        return self


class FrameNode(Part):
    """A node and where it is [m]."""

    id: Id
    at: Vector


class FrameElement(Part):
    """A bar, a beam, or springs between two nodes; `base` is the ground, for springs."""

    id: Id
    kind: Literal["beam", "bar", "spring"] = "beam"
    between: tuple[Id, Id]
    section: Id | None = None
    material: Id | None = None
    theory: Literal["euler", "timoshenko"] = "timoshenko"
    orientation: Vector = Field(
        default=(0.0, 0.0, 0.0), description="A vector in the plane of the local x and y axes."
    )
    translation_n_per_m: Vector = Field(
        default=(0.0, 0.0, 0.0), description="Of springs, along x, y and z [N/m]."
    )
    rotation_nm_per_rad: Vector = Field(
        default=(0.0, 0.0, 0.0), description="Of springs, about x, y and z [N m/rad]."
    )
    group: Id | None = None
    released: tuple[tuple[Direction, ...], tuple[Direction, ...]] = Field(
        default=((), ()),
        description="Of beams, directions along and about the local axes in which the first "
        "and the second end pass no force to their nodes.",
    )

    @model_validator(mode="after")
    def _has_what_it_needs(self) -> "FrameElement":
        plain = self.section is None and self.material is None
        whole = self.section is not None and self.material is not None
        if (self.kind == "spring" and not plain) or (self.kind != "spring" and not whole):
            raise ValueError(
                f"Element {self.id!r} of kind {self.kind} needs "
                + (
                    "stiffnesses, and neither `section` nor `material`."
                    if self.kind == "spring"
                    else "`section` and `material`."
                )
            )
        if self.kind != "beam" and any(self.released):
            raise ValueError(
                f"Element {self.id!r} of kind {self.kind} has `released`. Allowed are beams; "
                "leave it out."
            )
        return self


class FrameShell(Part):
    """A flat shell of four corners: a plate that bends, shears and stretches."""

    id: Id
    corners: tuple[Id, Id, Id, Id] = Field(description="Nodes in order around it.")
    thickness_m: Positive
    material: Id
    group: Id | None = None


class FrameMass(Part):
    """A rigid body at a node."""

    id: Id
    node: Id
    mass_kg: NotNegative
    inertia_kg_m2: Vector = (0.0, 0.0, 0.0)
    offset_m: Vector = (0.0, 0.0, 0.0)
    group: Id | None = None


class FrameLink(Part):
    """A node that moves with another as on one rigid body."""

    leading: Id
    following: Id


class ConstraintTerm(Part):
    """Coefficient of one displacement in a relation."""

    node: Id
    direction: Direction
    factor: Number


class FrameConstraint(Part):
    """A relation, sum of factor times displacement = 0; the first term is eliminated."""

    terms: tuple[ConstraintTerm, ...] = Field(min_length=1)


class FrameParameter(Part):
    """A relative change of the stiffness, mass or both of groups of elements."""

    name: Id
    groups: tuple[Id, ...] = ()
    elements: tuple[Id, ...] = Field(
        default=(), description="Elements without a group that it scales besides."
    )
    acts_on: Literal["stiffness", "mass", "both"] = "stiffness"
    prior_sd: PriorSd = 0.3

    @model_validator(mode="after")
    def _acts(self) -> "FrameParameter":
        if not self.groups and not self.elements:
            raise ValueError(
                f"Parameter {self.name!r} names neither `groups` nor `elements`. Name what it "
                "scales."
            )
        return self


class FrameModel(Part):
    """A frame, a truss or shells in space."""

    nodes: tuple[FrameNode, ...] = Field(min_length=1)
    materials: tuple[FrameMaterial, ...] = ()
    sections: tuple[FrameSection, ...] = ()
    elements: tuple[FrameElement, ...] = ()
    masses: tuple[FrameMass, ...] = ()
    shells: tuple[FrameShell, ...] = ()
    supports: tuple[Held, ...] = ()
    links: tuple[FrameLink, ...] = ()
    constraints: tuple[FrameConstraint, ...] = ()
    parameters: tuple[FrameParameter, ...] = ()


class RowSource(MatrixSource):
    """A row of a matrix in a file, over the degrees of freedom."""

    row: Annotated[int, Field(ge=0)] = Field(default=0, description="Counted from 0.")


class SpatialSensor(Part):
    """What one channel measures of a finite-element model."""

    channel: Id
    node: Id | None = None
    direction: Direction | None = None
    line: Vector | None = Field(
        default=None, description="Line of sight: components along x, y and z."
    )
    between: tuple[Id, Id] | None = Field(
        default=None, description="Two nodes: mean strain along the line that joins them."
    )
    row: RowSource | None = Field(
        default=None, description="Strain, or another linear function of the displacements."
    )
    quantity: Literal["acceleration", "velocity", "displacement", "strain"] = "acceleration"
    unit: Unit | None = Field(default=None, description="The SI unit where not given.")
    noise_sd: NotNegative | None = None

    @model_validator(mode="after")
    def _points_somewhere(self) -> "SpatialSensor":
        at_node = self.node is not None and (self.direction is None) != (self.line is None)
        elsewhere = self.direction is None and self.line is None and self.node is None
        ways = [at_node, self.between is not None and elsewhere, self.row is not None]
        strain = self.quantity == "strain"
        if sum(ways) != 1 or (self.row is not None and not elsewhere):
            raise ValueError(
                f"Sensor {self.channel!r} needs `node` with one of `direction` and `line`; or "
                "`between`, two nodes; or `row`, a row of a matrix. Give one of the three."
            )
        if (self.between is not None and not strain) or (at_node and strain):
            raise ValueError(
                f"Sensor {self.channel!r} measures {self.quantity}. A strain is measured "
                "`between` two nodes or by a `row`, a motion at a `node` or by a `row`."
            )
        return self


class SpatialInput(Part):
    """A measured force on a node in a direction, or the acceleration of all supports."""

    channel: Id
    kind: Literal["force", "base_acceleration"]
    node: Id | None = None
    direction: Direction
    unit: Unit
    hold: Literal["band_limited", "first", "zero"] | None = None

    @model_validator(mode="after")
    def _acts_somewhere(self) -> "SpatialInput":
        if (self.kind == "force") == (self.node is None):
            raise ValueError(
                f"Input {self.channel!r} of kind {self.kind} was given "
                f"{'without' if self.node is None else 'with'} a node. A force acts on a node, "
                "and the acceleration of the base on all supports."
            )
        if self.kind == "base_acceleration" and self.direction.startswith("r"):
            raise ValueError(
                f"Input {self.channel!r} turns the base. Allowed directions: ux, uy, uz."
            )
        return self


class Joint(Part):
    """A place where `diagnose` looks for nonlinear effects: a spring in one direction.

    It has no stiffness of its own where the finite elements hold it already.
    """

    id: Id
    between: tuple[Id, Id] = Field(description="Two nodes, or `base` and a node.")
    direction: Direction
    stiffness_n_per_m: Number = 0.0
    damping_n_s_per_m: Number = 0.0
