"""Matrices of a lattice tower of beams and trusses by pyfe3d, and the files of its export.

The tower has four legs, girts around each storey and crossed braces on each face, and is
clamped at its feet. Legs and girts are Timoshenko beams divided into several elements, braces
are trusses of one element. Legs and braces of each of 15 sections of the height are a group,
which makes 30. The plan is a rectangle, so that bending modes are no exact pairs.

References
----------
.. [1] S. G. P. Castro, pyfe3d 0.11, https://github.com/saullocastro/pyfe3d
   (`BeamC` after Y. Luo, Adv. Theor. Appl. Mech. 1 (2008) 95-106; `Truss`).
"""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float, Int
from scipy import sparse

from slowtime.finite_elements.parametric_matrices import MatrixFamily
from slowtime_services.matrices import write_matrix

YOUNG_PA, POISSON, DENSITY_KG_M3 = 2.1e11, 0.3, 7850.0
"""Structural steel [Pa, 1, kg/m^3]."""

STOREY_M = 1.5
FOOT_M, TOP_M = (4.0, 3.2), (1.6, 1.28)
"""Height of a storey, and sides of the plan at the foot and at the top [m]."""

LEG_M, GIRT_M, BRACE_M = (0.22, 0.010), (0.09, 0.004), (0.07, 0.004)
"""Outer diameter and wall of the tubes at the foot [m]; walls of legs and braces fall to a
half at the top."""

SECTIONS = 15
KINDS = ("legs", "braces")
PRIOR_SD = 0.2
"""Standard deviation of ln(1 + change) of each group [1]."""

BAND_HZ = 5.5
"""Upper end of the sensors' band [Hz]: 1.5 times it holds the lowest 20 modes."""

NOISE_SD = 2e-5
"""Noise of the sensors [m/s^2], that of force-balance accelerometers at 20 samples a second."""

NO_CHANGES: Mapping[str, float] = {}

CHANNEL_LEVELS = 6
CORNERS = 4
DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
HEARD = ((0, "ux"), (0, "uy"), (2, "ux"), (2, "uy"))
"""Corner and direction of the four channels at each of six levels: two horizontal ones at
opposite corners, so that bending in both planes and torsion are seen."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class TowerLayout:
    """How tall the tower is, and how finely it is divided.

    Parameters
    ----------
    storeys
        Number of storeys.
    leg_elements, girt_elements
        Elements of a leg in each storey, and of a girt.
    """

    storeys: int = 120
    leg_elements: int = 4
    girt_elements: int = 4

    @property
    def height_m(self) -> float:
        """Height of the tower [m]."""
        return self.storeys * STOREY_M


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Tower:
    """Nodes and members before the matrices are made.

    Parameters
    ----------
    layout
        Of the tower.
    names
        Of the nodes.
    place_m
        Positions [m].
    beams, trusses
        First and second node, tube, and number of the group (-1 for none) of each element.
    """

    layout: TowerLayout
    names: list[str]
    place_m: Float[np.ndarray, "node axis"]
    beams: list[tuple[int, int, tuple[float, float], int]]
    trusses: list[tuple[int, int, tuple[float, float], int]]

    @property
    def free(self) -> Int[np.ndarray, " own"]:
        """Degrees of freedom that are not clamped, of six a node."""
        feet = [self.names.index(joint(0, corner)) for corner in range(CORNERS)]
        held = (np.array(feet)[:, None] * 6 + np.arange(6)).ravel()
        return np.setdiff1d(np.arange(6 * len(self.names)), held)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SparseMatrices:
    """Sparse matrices over the free degrees of freedom.

    Parameters
    ----------
    stiffness, mass
        Of the whole tower [N/m, kg].
    parts
        Stiffness of each group [N/m].
    names
        Of the groups.
    """

    stiffness: sparse.csr_array
    mass: sparse.csr_array
    parts: list[sparse.csr_array]
    names: tuple[str, ...]


def joint(level: int, corner: int) -> str:
    """Name the node of a leg at the top of a storey."""
    return f"{level}.{corner}"


def group_names() -> tuple[str, ...]:
    """Name the groups, from the foot up."""
    return tuple(f"{kind} {1 + section}" for section in range(SECTIONS) for kind in KINDS)


def draw_tower(layout: TowerLayout) -> Tower:
    """Lay out nodes and members.

    Parameters
    ----------
    layout
        How tall the tower is, and how finely it is divided.
    """
    tower = Tower(layout, [], np.zeros((0, 3)), [], [])
    places: list[np.ndarray] = []
    index: dict[str, int] = {}

    def node(name: str, place: np.ndarray) -> int:
        if name not in index:
            index[name] = len(places)
            tower.names.append(name)
            places.append(place)
        return index[name]

    def divided(
        first: str, last: str, elements: int, tube: tuple[float, float], group: int
    ) -> None:
        start, end = places[index[first]], places[index[last]]
        before = index[first]
        for k in range(1, elements):
            after = node(f"{first}-{last}.{k}", start + (end - start) * k / elements)
            tower.beams.append((before, after, tube, group))
            before = after
        tower.beams.append((before, index[last], tube, group))

    for corner in range(CORNERS):
        node(joint(0, corner), corner_place(layout, 0, corner))
    for storey in range(layout.storeys):
        section = storey * SECTIONS // layout.storeys
        legs, braces = 2 * section, 2 * section + 1
        slim = 1.0 - 0.5 * section / (SECTIONS - 1)
        for corner in range(CORNERS):
            above = joint(storey + 1, corner)
            node(above, corner_place(layout, storey + 1, corner))
            tube = (LEG_M[0], slim * LEG_M[1])
            divided(joint(storey, corner), above, layout.leg_elements, tube, legs)
        for corner in range(CORNERS):
            beside = (corner + 1) % CORNERS
            divided(joint(storey + 1, corner), joint(storey + 1, beside),
                    layout.girt_elements, GIRT_M, -1)  # fmt: skip
            for feet, head in ((corner, beside), (beside, corner)):
                ends = index[joint(storey, feet)], index[joint(storey + 1, head)]
                tower.trusses.append((*ends, (BRACE_M[0], slim * BRACE_M[1]), braces))
    return dataclasses.replace(tower, place_m=np.array(places))


def corner_place(layout: TowerLayout, level: int, corner: int) -> Float[np.ndarray, " axis"]:
    """Position of a corner of the plan at a level [m]."""
    share = level / layout.storeys
    half = [0.5 * (a + share * (b - a)) for a, b in zip(FOOT_M, TOP_M, strict=True)]
    x, y = ((-1, -1), (1, -1), (1, 1), (-1, 1))[corner]
    return np.array([x * half[0], y * half[1], level * STOREY_M])


def assemble_tower(tower: Tower) -> SparseMatrices:
    """Make the matrices by pyfe3d.

    Returns
    -------
    Stiffness, mass and the stiffness of each group.
    """
    size, free = 6 * len(tower.names), tower.free
    entries = [_element_entries(tower, beams=True), _element_entries(tower, beams=False)]
    stiffness = _joined([one[0] for one in entries])
    mass = _joined([one[1] for one in entries])
    group = np.concatenate([one[2] for one in entries])
    names = group_names()

    def inner(
        triplets: list[np.ndarray], chosen: np.ndarray | slice = slice(None)
    ) -> sparse.csr_array:
        row, column, value = (one[chosen] for one in triplets)
        whole = sparse.csr_array((value, (row, column)), shape=(size, size))
        return sparse.csr_array(whole[free][:, free])

    parts = [inner(stiffness, group == g) for g in range(len(names))]
    return SparseMatrices(inner(stiffness), inner(mass), parts, names)


def _element_entries(
    tower: Tower, *, beams: bool
) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """Triplets of stiffness and mass of all beams or trusses; group of each of stiffness."""
    from pyfe3d import BeamC, BeamCData, BeamCProbe, Truss, TrussData, TrussProbe

    members = tower.beams if beams else tower.trusses
    data, probe = (BeamCData(), BeamCProbe()) if beams else (TrussData(), TrussProbe())
    own, weigh = data.KC0_SPARSE_SIZE, data.M_SPARSE_SIZE
    stiffness, mass = _triplets(own * len(members)), _triplets(weigh * len(members))
    place = np.ascontiguousarray(tower.place_m.ravel())
    for k, (first, second, tube, _) in enumerate(members):
        element = BeamC(probe) if beams else Truss(probe)
        element.c1, element.c2 = 6 * first, 6 * second
        element.init_k_KC0, element.init_k_M = own * k, weigh * k
        along = tower.place_m[second] - tower.place_m[first]
        if beams:
            aside = np.eye(3)[np.argmin(np.abs(along))]
            element.update_rotation_matrix(*aside, place)
        else:
            element.update_rotation_matrix(place)
        element.update_probe_xe(place)
        properties = tube_properties(*tube)
        element.update_KC0(*stiffness, properties)
        element.update_M(*mass, properties)
    return stiffness, mass, np.repeat([member[3] for member in members], own)


def tube_properties(diameter_m: float, wall_m: float) -> Any:
    """Properties of a round tube of steel, as pyfe3d takes them.

    Parameters
    ----------
    diameter_m, wall_m
        Outer diameter and thickness of the wall [m].

    Returns
    -------
    `pyfe3d.beamprop.BeamProp`, whose shear modulus holds the shear coefficient 0.5 of thin
    tubes.
    """
    from pyfe3d.beamprop import BeamProp

    outer, inner = diameter_m / 2, diameter_m / 2 - wall_m
    area, inertia = math.pi * (outer**2 - inner**2), math.pi / 4 * (outer**4 - inner**4)
    shear = YOUNG_PA / (2.0 * (1.0 + POISSON))
    made = BeamProp()
    made.A, made.E, made.G = area, YOUNG_PA, 0.5 * shear
    made.GJ = shear * 2.0 * inertia
    made.Iyy = made.Izz = inertia
    made.J = 2.0 * inertia
    made.intrho = DENSITY_KG_M3 * area
    made.intrhoy2 = made.intrhoz2 = DENSITY_KG_M3 * inertia
    return made


def _triplets(count: int) -> list[np.ndarray]:
    """Arrays of rows, columns and values that pyfe3d fills."""
    return [np.zeros(count, dtype=int), np.zeros(count, dtype=int), np.zeros(count)]


def _joined(triplets: list[list[np.ndarray]]) -> list[np.ndarray]:
    return [np.concatenate(one) for one in zip(*triplets, strict=True)]


def channels(layout: TowerLayout) -> list[dict[str, str | float]]:
    """Sensors of the 24 channels, as in a model file."""
    levels = np.linspace(0, layout.storeys, CHANNEL_LEVELS + 1)[1:].round().astype(int)
    return [
        {"channel": f"a{level}-{corner}{way[1]}",
         "node": joint(int(level), corner), "direction": way, "noise_sd": NOISE_SD}
        for level in levels
        for corner, way in HEARD
    ]  # fmt: skip


def export_tower(
    folder: Path,
    layout: TowerLayout,
    *,
    changes: Mapping[str, float] = NO_CHANGES,
    ending: str = ".mtx",
) -> Path:
    """Write the matrices of a tower and the model file that names them.

    Parameters
    ----------
    folder
        Folder of the files; made where it does not exist.
    layout
        Of the tower.
    changes
        Relative changes of the stiffness of groups [1], for a structure other than the file.
    ending
        Of the matrices: `.mtx` (Matrix Market, text) or `.npz` (SciPy).
    """
    tower = draw_tower(layout)
    made = assemble_tower(tower)
    folder.mkdir(parents=True, exist_ok=True)
    theta = np.array([changes.get(name, 0.0) for name in made.names])
    stiffness = MatrixFamily(made.stiffness, made.parts).at(theta)
    write_matrix(folder / f"stiffness{ending}", stiffness)
    write_matrix(folder / f"mass{ending}", made.mass)
    parameters = []
    for name, part, change in zip(made.names, made.parts, theta.tolist(), strict=True):
        file = f"{name.replace(' ', '_')}{ending}"
        write_matrix(folder / file, sparse.csr_array((1.0 + change) * part))
        parameters.append({"name": name, "stiffness": file, "prior_sd": PRIOR_SD})
    rows = ["node,direction,x,y,z"]
    for dof in tower.free.tolist():
        x, y, z = tower.place_m[dof // 6].tolist()
        rows.append(f"{tower.names[dof // 6]},{DIRECTIONS[dof % 6]},{x:.9g},{y:.9g},{z:.9g}")
    (folder / "dofs.csv").write_text("\n".join(rows) + "\n")
    model = {
        "slowtime_model": 2,
        "name": "lattice tower",
        "matrices": {
            "stiffness": f"stiffness{ending}",
            "mass": f"mass{ending}",
            "dofs": "dofs.csv",
            "parameters": parameters,
        },
        "damping_ratio": 0.01,
        "sensors": channels(layout),
        "tolerance": {"stiffness": 0.05, "damping": 0.5, "mass": 0.0},
        "band_hz": BAND_HZ,
    }
    (folder / "tower.yaml").write_text(yaml.safe_dump(model, sort_keys=False))
    return folder / "tower.yaml"
