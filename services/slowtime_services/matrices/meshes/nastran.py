"""Bulk data of Nastran → nodes, elements, masses and conditions of a frame."""

from .mesh import DIRECTIONS, Mesh
from .nastran_conditions import add_conditions
from .nastran_deck import Deck, Fields, read_deck
from .nastran_properties import (
    add_materials,
    add_properties,
    add_shell_properties,
    mass_factor,
    rod_section,
    with_extra_mass,
)

WITHOUT_EFFECT = frozenset(
    "PARAM EIGRL EIGR EIGB EIGC FORCE FORCE1 MOMENT MOMENT1 LOAD GRAV PLOAD1 TEMP TEMPD DLOAD "
    "TLOAD1 TLOAD2 RLOAD1 RLOAD2 DAREA DELAY DPHASE TABLED1 TABLED2 TABDMP1 TSTEP FREQ FREQ1 "
    "FREQ2 FREQ3 FREQ4 SET SET1 PLOTEL DESVAR DRESP1 DCONSTR SUPORT SUPORT1 ASET ASET1 "
    "BSET BSET1 QSET QSET1 SPOINT CORD1R CORD2R CORD2C CORD2S MAT4".split()
)
"""Cards that change neither stiffness nor mass of a frame. Coordinate systems are without
effect because points that use them are refused."""

READ = frozenset(
    "GRID CROD CONROD CBAR CBEAM CELAS1 CELAS2 CBUSH CQUAD4 CONM2 PROD PBAR PBARL PBEAM PBEAML "
    "PELAS PBUSH PSHELL MAT1 SPC SPC1 SPCADD MPC MPCADD RBE2 RBE3 RBAR".split()
)
"""Cards that are read."""


def read_bulk(mesh: Mesh) -> None:
    """Add what a file of bulk data holds to a mesh.

    Parameters
    ----------
    mesh
        Which names the file and its units.

    Raises
    ------
    MatrixFileError
        Where a card that is read cannot be used.
    """
    deck = read_deck(mesh.path)
    for kind, cards in deck.cards.items():
        if kind not in READ | WITHOUT_EFFECT:
            for card in cards:
                mesh.refuse(kind, card.line)
    mesh.check_understood()
    for card in deck.of("GRID"):
        _add_grid(mesh, card)
    add_materials(mesh, deck)
    properties = add_properties(mesh, deck)
    for card in deck.of("CROD", "CONROD"):
        _add_rod(mesh, card, properties)
    for card in deck.of("CBAR", "CBEAM"):
        _add_beam(mesh, card, properties)
    _add_springs(mesh, deck)
    shells = add_shell_properties(mesh, deck)
    for card in deck.of("CQUAD4"):
        _add_shell(mesh, card, shells)
    for card in deck.of("CONM2"):
        _add_mass(mesh, card, mass_factor(deck))
    add_conditions(mesh, deck)


def _add_grid(mesh: Mesh, card: Fields) -> None:
    for k, what in ((2, "positions"), (6, "displacements")):
        if card.text(k, "0") != "0":
            raise card.error(
                f"has {what} in the coordinate system {card.text(k)}. Allowed is the basic "
                "system; write the points in it."
            )
    name = card.whole(1)
    if name in mesh.nodes:
        raise card.error(f"point {name} is there twice. Give each its own number.")
    mesh.nodes[name] = mesh.point(card.reals(3, 3))
    held = card.directions(7)
    if held:
        mesh.hold(name, held)


def _property(
    card: Fields, properties: dict[str, tuple[str, str]], kinds: tuple[str, ...]
) -> tuple[str, str]:
    number = card.whole(2, card.text(1))
    found = properties.get(number)
    if found is None or not found[0].startswith(kinds):
        raise card.error(
            f"names the property {number}. Allowed are the properties {', '.join(kinds)} of "
            "the file."
        )
    return found


def _add_rod(mesh: Mesh, card: Fields, properties: dict[str, tuple[str, str]]) -> None:
    if card.kind == "CROD":
        section, material = _property(card, properties, ("PROD",))
        ends = card.whole(3), card.whole(4)
    else:
        section, ends = f"CONROD {card.whole(1)}", (card.whole(2), card.whole(3))
        material = f"MAT1 {card.whole(4)}"
        if material not in mesh.materials:
            raise card.error(f"names {material}, which does not exist. Allowed is a MAT1.")
        mesh.sections[section], extra = rod_section(mesh, card, 5)
        material = with_extra_mass(mesh, section, material, mesh.sections[section], extra)
    for end in ends:
        mesh.place(end, card.line)
    group = section if card.kind == "CROD" else "CONROD"
    mesh.elements.append(
        {
            "id": f"{card.kind} {card.whole(1)}",
            "kind": "bar",
            "between": ends,
            "section": section,
            "material": material,
            "group": group,
        }
    )


def _add_beam(mesh: Mesh, card: Fields, properties: dict[str, tuple[str, str]]) -> None:
    kinds = ("PBAR", "PBARL") if card.kind == "CBAR" else ("PBEAM", "PBEAML")
    section, material = _property(card, properties, kinds)
    number, points = card.whole(1), (card.whole(3), card.whole(4))
    places = [mesh.place(point, card.line) for point in points]
    if card.text(8, "GGG").upper() not in ("GGG", "BGG"):
        raise card.error(f"has the offsets flag {card.text(8)}. Allowed is GGG.")
    if any(card.text(k) for k in (17, 18)):
        raise card.error("has warping points (SA, SB). Leave these fields empty.")
    if card.text(6) or card.text(7) or not card.text(5).isdecimal():
        orientation = card.reals(5, 3)
    else:
        other = mesh.place(card.whole(5), card.line)
        orientation = [b - a for a, b in zip(places[0], other, strict=True)]
    ends = []
    for point, first, side in ((points[0], 11, "a"), (points[1], 14, "b")):
        offset = mesh.point(card.reals(first, 3))
        if any(offset):
            point = mesh.add_node(f"{point} of {card.kind} {number} {side}", point, offset)
        ends.append(point)
    shape = mesh.sections[section]
    thick = "shape" in shape or "shear_y_m2" in shape
    mesh.elements.append(
        {
            "id": f"{card.kind} {number}",
            "kind": "beam",
            "between": ends,
            "section": section,
            "material": material,
            "theory": "timoshenko" if thick else "euler",
            "orientation": orientation,
            "group": section,
            "released": [[DIRECTIONS[d] for d in card.directions(k)] for k in (9, 10)],
        }
    )


def _add_shell(mesh: Mesh, card: Fields, properties: dict[str, tuple[str, float]]) -> None:
    number = card.whole(2, card.text(1))
    if number not in properties:
        raise card.error(f"names the property {number}. Allowed is a PSHELL.")
    if card.real(8) or any(card.text(k) for k in range(9, 15)):
        raise card.error("has an offset or thicknesses of its own. Leave fields 9 to 15 empty.")
    corners = [card.whole(k) for k in range(3, 7)]
    for corner in corners:
        mesh.place(corner, card.line)
    material, thickness = properties[number]
    mesh.shells.append(
        {
            "id": f"CQUAD4 {card.whole(1)}",
            "corners": corners,
            "thickness_m": thickness,
            "material": material,
            "group": f"PSHELL {number}",
        }
    )


def _add_springs(mesh: Mesh, deck: Deck) -> None:
    translation, rotation = mesh.units.stiffness_n_per_m, mesh.units.moment_nm
    stiffness = {card.whole(1): card.real(2) for card in deck.of("PELAS")}
    for card in deck.of("CELAS1", "CELAS2"):
        group = f"CELAS2 {card.whole(1)}"
        if card.kind == "CELAS1":
            number = card.whole(2, card.text(1))
            group = f"PELAS {number}"
            if number not in stiffness:
                raise card.error(f"names the property {number}. Allowed is a PELAS.")
        value = card.real(2) if card.kind == "CELAS2" else stiffness[number]
        sides = [(card.text(k), card.directions(k + 1)) for k in (3, 5)]
        ends = [(card.whole(k), d) for k, (text, d) in zip((3, 5), sides, strict=True) if text]
        if not ends or any(len(d) != 1 for _, d in ends) or len({d for _, d in ends}) > 1:
            raise card.error("joins two components. Allowed is one component of its points.")
        direction = ends[0][1][0]
        names = [name for name, _ in ends]
        values = {direction: value * (translation if direction < 3 else rotation)}
        _spring(mesh, card, names, values, group)
    _add_bushings(mesh, deck, (translation,) * 3 + (rotation,) * 3)


def _add_bushings(mesh: Mesh, deck: Deck, scales: tuple[float, ...]) -> None:
    found = {}
    for card in deck.of("PBUSH"):
        if card.text(2).upper() != "K":
            raise card.error("does not begin with K and six stiffnesses. Give these first.")
        found[card.whole(1)] = dict(
            enumerate(v * s for v, s in zip(card.reals(3, 6), scales, strict=True))
        )
    for card in deck.of("CBUSH"):
        number = card.whole(2, card.text(1))
        if number not in found:
            raise card.error(f"names the property {number}. Allowed is a PBUSH.")
        if card.text(8, "0") != "0" or any(card.text(k) for k in range(5, 8)):
            raise card.error("has local axes. Allowed is CID 0, the basic system.")
        names = [card.whole(3), *([card.whole(4)] if card.text(4) else [])]
        _spring(mesh, card, names, found[number], f"PBUSH {number}")


def _spring(
    mesh: Mesh, card: Fields, names: list[str], values: dict[int, float], group: str
) -> None:
    """Add a spring to the ground, or between two points that lie along it."""
    first, last = mesh.place(names[0], card.line), mesh.place(names[-1], card.line)
    apart = [abs(b - a) for a, b in zip(first, last, strict=True)]
    busy = {k for k, value in values.items() if value}
    across = any(apart[j] > 0.0 for k in busy if k < 3 for j in range(3) if j != k)
    if across:
        raise card.error(
            "joins points that are apart across its direction. Allowed are points at one place "
            "or along the direction."
        )
    ends = ("base", names[0]) if len(names) == 1 else (names[0], names[1])
    mesh.add_spring(f"{card.kind} {card.whole(1)}", ends, values, group)


def _add_mass(mesh: Mesh, card: Fields, factor: float) -> None:
    system, name = card.text(3, "0"), card.whole(2)
    place = mesh.place(name, card.line)
    offset = mesh.point(card.reals(5, 3))
    if system == "-1":
        offset = tuple(a - b for a, b in zip(offset, place, strict=True))  # type: ignore[assignment]
    elif system != "0":
        raise card.error(f"is in the coordinate system {system}. Allowed is the basic one, 0.")
    i11, i21, i22, i31, i32, i33 = card.reals(9, 6)
    if any((i21, i31, i32)):
        raise card.error("has products of inertia. Allowed are I11, I22 and I33.")
    scale = factor * mesh.units.inertia_kg_m2
    mesh.masses.append(
        {
            "id": f"CONM2 {card.whole(1)}",
            "node": name,
            "mass_kg": card.real(4) * factor * mesh.units.mass_kg,
            "inertia_kg_m2": [scale * value for value in (i11, i22, i33)],
            "offset_m": offset,
            "group": "CONM2",
        }
    )
