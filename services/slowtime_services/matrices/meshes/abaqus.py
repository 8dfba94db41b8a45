"""Input of Abaqus or CalculiX → nodes, elements, masses and conditions of a frame."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from slowtime_services.matrices.bounds import refuse_long_set, written_out

from .abaqus_deck import KeywordBlock, read_blocks
from .abaqus_sections import add_material, beam_section, general_section
from .mesh import DIRECTIONS, Mesh

BEAMS = {
    "B31": "timoshenko",
    "B31H": "timoshenko",
    "B32": "timoshenko",
    "B32R": "timoshenko",
    "B31R": "timoshenko",
    "B33": "euler",
}
"""Types of beams → theory. A B32 becomes two beams that meet at its middle node."""

TRUSSES = ("T3D2", "T3D2H")
SHELLS = ("S4", "S4R")
OTHERS = ("MASS", "ROTARYI", "SPRING1", "SPRING2")

ENDS = ("S1", "S2")
RELEASED = {
    "M1": ("ry",),
    "M2": ("rz",),
    "T": ("rx",),
    "M1-M2": ("ry", "rz"),
    "M1-T": ("ry", "rx"),
    "M2-T": ("rz", "rx"),
    "ALLM": ("rx", "ry", "rz"),
}
"""Moments of *RELEASE → directions about the local axes; n1 and n2 of Abaqus are y and z."""

NAMED_SUPPORTS = {
    "ENCASTRE": range(6),
    "PINNED": range(3),
    "XSYMM": (0, 4, 5),
    "YSYMM": (1, 3, 5),
    "ZSYMM": (2, 3, 4),
}

WITHOUT_EFFECT = frozenset(
    "HEADING/PREPRINT/STEP/END STEP/PHYSICAL CONSTANTS/AMPLITUDE/DAMPING/EXPANSION/RESTART/"
    "TIME POINTS/PLASTIC/INITIAL CONDITIONS/SURFACE".split("/")
)
"""Keywords before the steps that change neither linear stiffness nor mass."""

LAST_DIRECTION = 6
"""Further ones are temperatures and pressures, or none at all."""
FARTHEST_DIRECTION = 31
"""Degrees of freedom of a node at most [1]: temperatures through the thickness end at 30."""
CHANGES_IN_STEP = frozenset(["MODEL CHANGE", "CHANGE MATERIAL", "SUBSTRUCTURE GENERATE"])
"""Keywords of steps that matter; loads, procedures and requests for output do not."""


@dataclasses.dataclass(kw_only=True)
class _Reader:
    mesh: Mesh
    node_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    element_sets: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    kinds: dict[str, tuple[str, list[str], int]] = dataclasses.field(default_factory=dict)
    material: str = ""
    later: list[KeywordBlock] = dataclasses.field(default_factory=list)
    released: dict[str, tuple[list[str], list[str]]] = dataclasses.field(default_factory=dict)


def read_input(mesh: Mesh) -> None:
    """Add what an input file holds to a mesh.

    Parameters
    ----------
    mesh
        Which names the file and its units.

    Raises
    ------
    MatrixFileError
        Where a keyword that is read cannot be used.
    """
    reader = _Reader(mesh=mesh)
    for block in read_blocks(mesh.path):
        _first(reader, block)
    mesh.check_understood()
    for block in reader.later:
        _second(reader, block)
    for one in mesh.elements:
        one["released"] = reader.released.get(one["id"], ((), ()))
    sectioned = {one["id"] for one in (*mesh.elements, *mesh.masses, *mesh.shells)}
    for name, (kind, _, line) in reader.kinds.items():
        if f"{kind} {name}" not in sectioned and f"{kind} {name} a" not in sectioned:
            raise mesh.error(
                line, f"element {name} of type {kind} has no section. Give one for its set."
            )


def _first(reader: _Reader, block: KeywordBlock) -> None:
    """Nodes, elements, sets and materials; the rest is kept until all of these are there."""
    mesh, keyword = reader.mesh, block.keyword
    if keyword == "NODE":
        _add_nodes(reader, block)
    elif keyword == "ELEMENT":
        _add_elements(reader, block)
    elif keyword in ("NSET", "ELSET"):
        sets = reader.node_sets if keyword == "NSET" else reader.element_sets
        _add_set(block, sets, block.parameter(keyword))
    elif keyword == "MATERIAL":
        reader.material = block.parameter("NAME")
    elif keyword in ("ELASTIC", "DENSITY"):
        add_material(mesh, reader.material, block)
    elif keyword in _LATER:
        reader.later.append(block)
    elif block.in_step:
        if keyword in CHANGES_IN_STEP:
            mesh.refuse(f"*{keyword}", block.line)
    elif keyword not in WITHOUT_EFFECT:
        mesh.refuse(f"*{keyword}", block.line)


def _second(reader: _Reader, block: KeywordBlock) -> None:
    _LATER[block.keyword](reader, block)


def _add_nodes(reader: _Reader, block: KeywordBlock) -> None:
    if any(key in block.parameters for key in ("INPUT", "SYSTEM")):
        raise block.error("reads another file or system. Give nodes here, in rectangular axes.")
    names = []
    for row, (_, parts) in enumerate(block.data):
        name, *place = block.numbers(row, 1)
        del name
        names.append(parts[0])
        reader.mesh.nodes[parts[0]] = reader.mesh.point([*place, 0.0, 0.0, 0.0][:3])
    if "NSET" in block.parameters:
        reader.node_sets.setdefault(block.parameter("NSET"), []).extend(names)


def _add_elements(reader: _Reader, block: KeywordBlock) -> None:
    kind = block.parameter("TYPE")
    if kind not in (*BEAMS, *TRUSSES, *SHELLS, *OTHERS):
        reader.mesh.refuse(f"*ELEMENT, TYPE={kind}", block.line)
        return
    names = []
    for line, (name, *nodes) in block.data:
        nodes = [node for node in nodes if node]
        for node in nodes:
            reader.mesh.place(node, line)
        reader.kinds[name] = (kind, nodes, line)
        names.append(name)
    if "ELSET" in block.parameters:
        reader.element_sets.setdefault(block.parameter("ELSET"), []).extend(names)


def _add_set(block: KeywordBlock, sets: dict[str, list[str]], name: str) -> None:
    sets[name] = refuse_long_set(_written_out(block, sets, sets.get(name, [])), name)


def _written_out(
    block: KeywordBlock, sets: Mapping[str, list[str]], members: list[str]
) -> Iterator[str]:
    """Yield the members of a set that there are, and those that a block adds."""
    yield from members
    for row, (_, parts) in enumerate(block.data):
        if "GENERATE" in block.parameters:
            first, last, *step = (int(value) for value in block.numbers(row, 2))
            yield from written_out(range(first, last + 1, step[0] if step else 1))
            continue
        for part in parts:
            if part:
                yield from [part] if part.isdecimal() else sets.get(part.upper(), [])


def _members(block: KeywordBlock, sets: dict[str, list[str]], name: str) -> list[str]:
    if name.isdecimal():
        return [name]
    if name.upper() not in sets:
        raise block.error(
            f"names the set {name!r}. Allowed are {', '.join(sorted(sets)) or 'none'}."
        )
    return sets[name.upper()]


def _sectioned(reader: _Reader, block: KeywordBlock) -> None:
    """*BEAM SECTION, *BEAM GENERAL SECTION or *SOLID SECTION of a set of elements."""
    mesh, group = reader.mesh, block.parameter("ELSET")
    normal = [0.0, 0.0, 0.0]
    if block.keyword == "BEAM GENERAL SECTION":
        section, normal, material = general_section(mesh, block)
        name = f"of {group}"
        mesh.materials[name] = material
    else:
        name = block.parameter("MATERIAL")
        if "young_pa" not in mesh.materials.get(name, {}):
            raise block.error(f"names the material {name}. Allowed is one with *ELASTIC.")
        if block.keyword == "BEAM SECTION":
            section, normal = beam_section(mesh, block)
        else:
            section = {"area_m2": block.numbers(0, 1)[0] * mesh.units.length_m**2}
    mesh.sections[group] = section
    for number in _members(block, reader.element_sets, group):
        if number not in reader.kinds:
            raise block.error(f"element {number} of {group} does not exist.")
        kind, nodes, line = reader.kinds[number]
        bar = kind in TRUSSES
        if bar == (block.keyword != "SOLID SECTION") or kind in (*OTHERS, *SHELLS):
            raise mesh.error(line, f"element {number} of type {kind} has *{block.keyword}.")
        thick = BEAMS.get(kind) == "timoshenko" and (
            "shape" in section or "shear_y_m2" in section
        )
        parts = [("", nodes)] if len(nodes) == 2 else [(" a", nodes[:2]), (" b", nodes[1:])]
        if len(parts) > 1:
            mesh.note("Each B32 is two straight beams that meet at its middle node.")
        for side, ends in parts:
            mesh.elements.append(
                {
                    "id": f"{kind} {number}{side}",
                    "kind": "bar" if bar else "beam",
                    "between": ends,
                    "section": group,
                    "material": name,
                    "theory": "timoshenko" if thick else "euler",
                    "orientation": [0.0, 0.0, 0.0] if bar else normal,
                    "group": group,
                }
            )


def _release(reader: _Reader, block: KeywordBlock) -> None:
    """*RELEASE: element or set, end S1 or S2, and the moments that it does not pass."""
    for line, parts in block.data:
        if len(parts) < 3 or parts[1].upper() not in ENDS or parts[2].upper() not in RELEASED:
            raise reader.mesh.error(
                line,
                "*RELEASE has an element or a set, an end and moments. Allowed are the ends "
                f"{', '.join(ENDS)} and the moments {', '.join(RELEASED)}.",
            )
        end, ways = ENDS.index(parts[1].upper()), RELEASED[parts[2].upper()]
        for number in _members(block, reader.element_sets, parts[0]):
            kind, nodes, _ = reader.kinds.get(number, ("", [], 0))
            if kind not in BEAMS:
                raise reader.mesh.error(line, f"element {number} is no beam of the file.")
            side = "" if len(nodes) == 2 else " ab"[end + 1]
            name = f"{kind} {number}{' ' + side if side else ''}"
            found = reader.released.setdefault(name, ([], []))[end]
            found += [way for way in ways if way not in found]


def _add_shells(reader: _Reader, block: KeywordBlock) -> None:
    mesh, group, name = reader.mesh, block.parameter("ELSET"), block.parameter("MATERIAL")
    if "young_pa" not in mesh.materials.get(name, {}):
        raise block.error(f"names the material {name}. Allowed is one with *ELASTIC.")
    if float(block.parameters.get("OFFSET", "0") or 0.0):
        raise block.error("has an offset. Allowed is the midsurface at the nodes.")
    for number in _members(block, reader.element_sets, group):
        kind, nodes, line = reader.kinds[number]
        if kind not in SHELLS:
            raise mesh.error(line, f"element {number} of type {kind} has *{block.keyword}.")
        mesh.shells.append(
            {
                "id": f"{kind} {number}",
                "corners": nodes,
                "thickness_m": block.numbers(0, 1)[0] * mesh.units.length_m,
                "material": name,
                "group": group,
            }
        )


def _add_masses(reader: _Reader, block: KeywordBlock) -> None:
    mesh = reader.mesh
    values = block.numbers(0, 1)
    if block.keyword == "ROTARY INERTIA" and any(values[3:6]):
        raise block.error("has products of inertia. Allowed are I11, I22 and I33.")
    for number in _members(block, reader.element_sets, block.parameter("ELSET")):
        kind, (node, *_), _ = reader.kinds[number]
        entry: dict[str, Any] = {"id": f"{kind} {number}", "node": node, "mass_kg": 0.0}
        if block.keyword == "MASS":
            entry["mass_kg"] = values[0] * mesh.units.mass_kg
        else:
            scale = mesh.units.inertia_kg_m2
            entry["inertia_kg_m2"] = [scale * value for value in [*values, 0.0, 0.0][:3]]
        mesh.masses.append(entry)


def _add_springs(reader: _Reader, block: KeywordBlock) -> None:
    mesh = reader.mesh
    directions, (value, *_) = [int(v) - 1 for v in block.numbers(0, 1)], block.numbers(1, 1)
    if len(set(directions)) > 1 or not 0 <= directions[0] < 6:
        raise block.error("joins two directions. Allowed is one, 1 to 6, at both nodes.")
    way, units, group = directions[0], mesh.units, block.parameter("ELSET")
    value *= units.stiffness_n_per_m if way < 3 else units.moment_nm
    for number in _members(block, reader.element_sets, group):
        kind, nodes, line = reader.kinds[number]
        first, last = mesh.nodes[nodes[0]], mesh.nodes[nodes[-1]]
        if way < 3 and any(first[k] != last[k] for k in range(3) if k != way):
            raise mesh.error(line, f"spring {number} joins nodes apart across its direction.")
        ends = ("base", nodes[0]) if kind == "SPRING1" else (nodes[0], nodes[1])
        mesh.add_spring(f"{kind} {number}", ends, {way: value}, group)


def _hold(reader: _Reader, block: KeywordBlock) -> None:
    for line, parts in block.data:
        nodes = _members(block, reader.node_sets, parts[0])
        word = parts[1].upper() if len(parts) > 1 else ""
        if word in NAMED_SUPPORTS:
            directions = tuple(NAMED_SUPPORTS[word])
        elif word.isdecimal() and all(part.isdecimal() or not part for part in parts[1:3]):
            last = parts[2] if len(parts) > 2 and parts[2] else word
            if len(last) > 3 or int(last) > FARTHEST_DIRECTION:
                raise block.error(
                    f"line {line} ends at direction {last[:20]}. Allowed are 1 to "
                    f"{FARTHEST_DIRECTION}, of which those up to {LAST_DIRECTION} are motions."
                )
            directions = tuple(range(int(word) - 1, min(int(last), LAST_DIRECTION)))
        else:
            raise block.error(
                f"line {line} holds {word!r}. Allowed are directions 1 to 6, "
                f"{', '.join(NAMED_SUPPORTS)}."
            )
        if len(parts) > 3 and parts[3] and float(parts[3]):
            raise block.error(f"line {line} prescribes a displacement. Allowed is zero.")
        for node in nodes:
            reader.mesh.place(node, line)
            reader.mesh.hold(node, directions)


def _relate(reader: _Reader, block: KeywordBlock) -> None:
    """*EQUATION: the number of terms, then node, direction and factor of each."""
    rows = iter(block.data)
    for _, (count, *_) in rows:
        given: list[str] = []
        while len(given) < 3 * int(count):
            _, parts = next(rows, (0, []))
            if not parts:
                raise block.error(f"has fewer than {count} terms of node, direction, factor.")
            given += [part for part in parts if part]
        terms = []
        for k in range(0, 3 * int(count), 3):
            node, way, factor = given[k], int(given[k + 1]) - 1, float(given[k + 2])
            reader.mesh.place(node, block.line)
            size = reader.mesh.units.length_m if way > 2 else 1.0
            terms.append({"node": node, "direction": DIRECTIONS[way], "factor": size * factor})
        reader.mesh.constraints.append({"terms": terms})


_LATER = {
    "BEAM SECTION": _sectioned,
    "BEAM GENERAL SECTION": _sectioned,
    "SOLID SECTION": _sectioned,
    "SHELL SECTION": _add_shells,
    "MASS": _add_masses,
    "ROTARY INERTIA": _add_masses,
    "SPRING": _add_springs,
    "BOUNDARY": _hold,
    "EQUATION": _relate,
    "RELEASE": _release,
}
