"""What a reader of meshes gathers: parts of a frame in SI units, notes, and what it refuses."""

import dataclasses
import math
from pathlib import Path
from typing import Any

from slowtime_services.matrices.errors import MatrixFileError

from .unit_systems import UnitSystem

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
MOST_HELD = 1_000_000
"""Times that nodes are held [1], a second's work: a line may name a set of all nodes."""
SHOWN = 12
"""Kinds of cards that one error names."""

REMEDIES = {
    ("CTRIA3", "CTRIAR", "CTRIA6", "S3", "S3R", "STRI3", "STRI65"): (
        "Shells of three nodes: mesh again with quadrilaterals (CQUAD4, S4)."
    ),
    ("*PART", "*END PART", "*INSTANCE", "*END INSTANCE", "*ASSEMBLY", "*END ASSEMBLY"): (
        "Parts and assemblies: write the input flat (Abaqus/CAE: Model, Edit Attributes, "
        "do not use parts and assemblies in input files)."
    ),
    ("CQUAD8", "CQUADR", "S8", "S8R", "S9R5"): (
        "Shells of other kinds: use CQUAD4 or S4 with a finer mesh."
    ),
    ("CTETRA", "CHEXA", "CPENTA", "C3D4", "C3D8", "C3D8R", "C3D10", "C3D20", "C3D20R"): (
        "Solids: export stiffness and mass (Nastran PARAM,EXTOUT,DMIGPCH; Abaqus *MATRIX "
        "OUTPUT; CalculiX *FREQUENCY, SOLVER=MATRIXSTORAGE)."
    ),
    ("*MPC", "*RIGID BODY", "*COUPLING", "*TIE", "*KINEMATIC", "*DISTRIBUTING"): (
        "Couplings: write them as *EQUATION."
    ),
}
"""What to do instead of entries that users meet often, by their names."""

SOLID_ROUND = 0.9
"""Shear area of a solid round section over its area [1]: Cowper, J. Appl. Mech. 33 (1966),
gives 6 (1 + nu) / (7 + 6 nu), 0.89 for nu = 0.3."""


@dataclasses.dataclass(kw_only=True)
class Mesh:
    """Parts of a frame while a file is read; entries are those of the section `frame`.

    Parameters
    ----------
    path
        The file.
    units
        In which it is written.
    """

    path: Path
    units: UnitSystem
    nodes: dict[str, tuple[float, float, float]] = dataclasses.field(default_factory=dict)
    materials: dict[str, dict[str, Any]] = dataclasses.field(default_factory=dict)
    sections: dict[str, dict[str, Any]] = dataclasses.field(default_factory=dict)
    elements: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    masses: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    shells: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    supports: dict[str, set[str]] = dataclasses.field(default_factory=dict)
    links: list[dict[str, str]] = dataclasses.field(default_factory=list)
    constraints: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    unknown: dict[str, list[int]] = dataclasses.field(default_factory=dict)
    held: int = 0

    def error(self, line: int, text: str) -> MatrixFileError:
        """Make an error that names the file and a line."""
        return MatrixFileError(f"Line {line} of {self.path.name}: {text}")

    def note(self, text: str) -> None:
        """Keep a remark for the user, once."""
        if text not in self.notes:
            self.notes.append(text)

    def refuse(self, kind: str, line: int) -> None:
        """Keep a card that is not understood and that may matter."""
        self.unknown.setdefault(kind, []).append(line)

    def place(self, node: str, line: int) -> tuple[float, float, float]:
        """Position of a node [m].

        Raises
        ------
        MatrixFileError
            Where it does not exist.
        """
        if node not in self.nodes:
            raise self.error(
                line,
                f"node {node!r} does not exist. Allowed are the {len(self.nodes)} nodes "
                "of the file.",
            )
        return self.nodes[node]

    def point(self, values: list[float]) -> tuple[float, float, float]:
        """Position or offset [m], of three numbers in units of the file."""
        x, y, z = (self.units.length_m * value for value in values)
        return x, y, z

    def hold(self, node: str, directions: tuple[int, ...]) -> None:
        """Hold a node in directions, 0 to 5."""
        self.held += 1
        if self.held > MOST_HELD:
            raise MatrixFileError(
                f"{self.path.name} holds nodes more than {MOST_HELD:,} times. Name each node "
                "or set of nodes once."
            )
        self.supports.setdefault(node, set()).update(DIRECTIONS[k] for k in directions)

    def add_node(self, name: str, base: str, offset: tuple[float, ...]) -> str:
        """Add a node at an offset [m] from another that it follows as a rigid body."""
        x = self.nodes[base]
        self.nodes[name] = (x[0] + offset[0], x[1] + offset[1], x[2] + offset[2])
        self.links.append({"leading": base, "following": name})
        return name

    def add_spring(
        self, name: str, ends: tuple[str, str], values: dict[int, float], group: str
    ) -> None:
        """Add springs [N/m, N m/rad] by direction, 0 to 5; `base` is the ground."""
        self.elements.append(
            {
                "id": name,
                "kind": "spring",
                "between": ends,
                "translation_n_per_m": [values.get(k, 0.0) for k in range(3)],
                "rotation_nm_per_rad": [values.get(k, 0.0) for k in range(3, 6)],
                "group": group,
            }
        )

    def check_understood(self) -> None:
        """Refuse a file with cards that may matter and are not understood.

        Raises
        ------
        MatrixFileError
            That lists them with their first lines.
        """
        if not self.unknown:
            return
        kinds = sorted(self.unknown.items(), key=lambda item: item[1][0])
        said = ", ".join(
            f"{kind} (line {lines[0]}" + (f" and {len(lines) - 1} more)" if lines[1:] else ")")
            for kind, lines in kinds[:SHOWN]
        )
        remedies = " ".join(
            dict.fromkeys(text for kind, _ in kinds for text in [_remedy(kind)] if text)
        )
        more = f", and {len(kinds) - SHOWN} further kinds" if len(kinds) > SHOWN else ""
        raise MatrixFileError(
            f"{self.path.name} has entries that are not understood: {said}{more}. Frames, "
            "trusses and flat shells are converted; docs/matrices.md lists what is read. "
            "Export the matrices of other models (`matrices`), or take out the entries if "
            f"they do not matter. {remedies}".rstrip()
        )


def _remedy(kind: str) -> str:
    """Say what to do about an entry that is not understood; empty where nothing special."""
    keyword, _, type_ = kind.partition(", TYPE=")
    for names, text in REMEDIES.items():
        if keyword in names or type_ in names:
            return text
    return ""


def box(width_m: float, height_m: float, wall_y_m: float, wall_z_m: float) -> dict[str, Any]:
    """Section of a rectangular hollow box, its width along y and its height along z.

    Parameters
    ----------
    width_m, height_m
        Outer sides [m].
    wall_y_m, wall_z_m
        Thickness of the two walls across y and of those across z [m].

    Returns
    -------
    Area, inertias, torsion constant of a closed thin wall, and shear areas of the webs.

    References
    ----------
    .. [1] W. C. Young, R. G. Budynas, "Roark's Formulas for Stress and Strain", 7th ed. (2002),
       table 10.1, case 16 (torsion constant).
    """
    inner_y, inner_z = width_m - 2 * wall_y_m, height_m - 2 * wall_z_m
    middle_y, middle_z = width_m - wall_y_m, height_m - wall_z_m
    around = middle_y / wall_z_m + middle_z / wall_y_m
    return {
        "area_m2": width_m * height_m - inner_y * inner_z,
        "inertia_y_m4": (width_m * height_m**3 - inner_y * inner_z**3) / 12,
        "inertia_z_m4": (height_m * width_m**3 - inner_z * inner_y**3) / 12,
        "torsion_m4": 2 * (middle_y * middle_z) ** 2 / around,
        "shear_y_m2": 2 * wall_z_m * width_m,
        "shear_z_m2": 2 * wall_y_m * height_m,
    }


def solid_round(radius_m: float) -> dict[str, Any]:
    """Section of a solid round bar.

    Parameters
    ----------
    radius_m
        Outer radius [m].

    Returns
    -------
    Area, inertias, torsion constant and shear areas.
    """
    area = math.pi * radius_m**2
    inertia = area * radius_m**2 / 4
    return {
        "area_m2": area,
        "inertia_y_m4": inertia,
        "inertia_z_m4": inertia,
        "torsion_m4": 2 * inertia,
        "shear_y_m2": SOLID_ROUND * area,
        "shear_z_m2": SOLID_ROUND * area,
    }
