"""Materials and properties of bulk data → materials and sections of a frame."""

import math
from typing import Any

from .mesh import Mesh, box, solid_round
from .nastran_deck import Deck, Fields

_STATIONS = ("YES", "YESA", "NO")
_MANY = 1e6
"""Shear area over area [1] that stands for no shear deformation in one of two planes: six
orders of magnitude stiffer than real sections, whose ratio is near 1."""

SHAPES = {"ROD": 1, "TUBE": 2, "TUBE2": 2, "BAR": 2, "BOX": 4}
"""Shapes of PBARL and PBEAML that are read, and how many sizes each has."""


def add_materials(mesh: Mesh, deck: Deck) -> None:
    """Add MAT1 materials to a mesh.

    Raises
    ------
    MatrixFileError
        Where modulus, shear modulus and Poisson's ratio contradict each other.
    """
    mass = mass_factor(deck)
    if mass != 1.0:
        mesh.note(f"Masses are multiplied by PARAM,WTMASS, {mass:g}.")
    for card in deck.of("MAT1"):
        young, shear, poisson = card.text(2), card.text(3), card.text(4)
        if not young:
            raise card.error("has no modulus of elasticity. Give E in its third field.")
        ratio = card.real(4)
        if shear and not poisson:
            ratio = card.real(2) / (2 * card.real(3)) - 1
        elif shear and abs(card.real(2) / (2 * card.real(3) * (1 + ratio)) - 1) > 0.01:
            # 1 %: three digits of G, as tables give it, agree with E and the ratio.
            raise card.error(
                f"E={young}, G={shear} and a ratio of {poisson} contradict each other. Leave "
                "one of them empty."
            )
        if not -1.0 < ratio < 0.5:
            raise card.error(
                f"has Poisson's ratio {ratio:.4g} by its E and G. Allowed is -1 to 0.5."
            )
        mesh.materials[f"MAT1 {card.whole(1)}"] = {
            "young_pa": card.real(2) * mesh.units.pressure_pa,
            "poisson": ratio,
            "density_kg_m3": card.real(5) * mass * mesh.units.density_kg_m3,
        }


def mass_factor(deck: Deck) -> float:
    """Factor of PARAM,WTMASS on every mass [1]."""
    given = [card for card in deck.of("PARAM") if card.text(1).upper() == "WTMASS"]
    return given[-1].real(2, 1.0) if given else 1.0


def add_properties(mesh: Mesh, deck: Deck) -> dict[str, tuple[str, str]]:
    """Add the sections of rods, bars and beams to a mesh.

    Returns
    -------
    Names of section and material by the number of the property.
    """
    readers = {
        "PROD": _rod,
        "PBAR": _bar,
        "PBEAM": _beam,
        "PBARL": _shape,
        "PBEAML": _shape,
    }
    found = {}
    for kind, read in readers.items():
        for card in deck.of(kind):
            number = card.whole(1)
            material = f"MAT1 {card.whole(2)}"
            if material not in mesh.materials:
                raise card.error(f"names {material}, which does not exist. Allowed is a MAT1.")
            section, extra = read(mesh, card)
            name = f"{kind} {number}"
            mesh.sections[name] = section
            found[number] = name, with_extra_mass(mesh, name, material, section, extra)
    return found


def add_shell_properties(mesh: Mesh, deck: Deck) -> dict[str, tuple[str, float]]:
    """Read PSHELL of one material, with nonstructural mass in a material of their own.

    Returns
    -------
    Material and thickness [m] by the number of the property.
    """
    found = {}
    for card in deck.of("PSHELL"):
        number, first = card.whole(1), card.whole(2)
        thickness = card.real(3) * mesh.units.length_m
        others = {card.text(4), card.text(6, first)}
        if others != {first} or card.text(11) or not thickness > 0.0:
            raise card.error(
                "is not of one material from membrane to bending. Give a thickness, and MID1 "
                "again as MID2 (and as MID3, or leave it empty)."
            )
        if card.real(5, 1.0) != 1.0 or abs(card.real(7, 0.833333) - 5 / 6) > 1e-3:
            raise card.error("is not solid. Allowed are 12I/T**3 = 1 and TS/T = 0.833333.")
        if f"MAT1 {first}" not in mesh.materials:
            raise card.error(f"names MAT1 {first}, which does not exist. Allowed is a MAT1.")
        if not card.text(6):
            mesh.note("Shells deform by shear, also where PSHELL leaves MID3 empty.")
        extra = card.real(8) * mesh.units.mass_kg / mesh.units.length_m**2
        name = f"PSHELL {number}"
        material = with_extra_mass(mesh, name, f"MAT1 {first}", {"area_m2": thickness}, extra)
        found[number] = material, thickness
    return found


def with_extra_mass(
    mesh: Mesh, name: str, material: str, section: dict[str, Any], extra: float
) -> str:
    """Material that has nonstructural mass [kg/m] in its density, by its name."""
    if not extra:
        return material
    own = dict(mesh.materials[material])
    area = section.get("area_m2") or _area(section)
    own["density_kg_m3"] += extra / area
    mesh.note(f"Nonstructural mass of {name} is in the density of its material.")
    mesh.materials[f"{material} of {name}"] = own
    return f"{material} of {name}"


def _area(section: dict[str, Any]) -> float:
    if section["shape"] == "rectangle":
        return float(section["width_m"] * section["height_m"])
    inner = section["diameter_m"] - 2 * section["wall_m"]
    return math.pi / 4 * float(section["diameter_m"] ** 2 - inner**2)


def _line_mass(mesh: Mesh, value: float) -> float:
    return value * mesh.units.mass_kg / mesh.units.length_m


def rod_section(mesh: Mesh, card: Fields, first: int) -> tuple[dict[str, Any], float]:
    """Section of a rod whose A, J, C and NSM begin at a field, and mass by length [kg/m]."""
    if card.real(first + 1):
        mesh.note("Torsion of rods (J) is left out; bars have an axial force only.")
    area = card.real(first) * mesh.units.length_m**2
    if not area > 0.0:
        raise card.error(f"has the area {card.text(first)!r}. Allowed is a positive number.")
    return {"area_m2": area}, _line_mass(mesh, card.real(first + 3))


def _rod(mesh: Mesh, card: Fields) -> tuple[dict[str, Any], float]:
    return rod_section(mesh, card, 3)


def _bar(mesh: Mesh, card: Fields) -> tuple[dict[str, Any], float]:
    factors = (card.text(17), card.text(18))
    section = _general(mesh, card, card.reals(3, 4), [card.real(17), card.real(18)])
    if card.real(19):
        raise card.error("has a product of inertia I12. Turn the axes to the principal ones.")
    if any(factors) and not all(factors):
        mesh.note(f"PBAR {card.text(1)} deforms by shear in one of its planes only.")
    return section, _line_mass(mesh, card.real(7))


def _beam(mesh: Mesh, card: Fields) -> tuple[dict[str, Any], float]:
    """PBEAM of one section; its shear factors are 1 where they are not given."""
    place = 17 if card.text(17).upper() in _STATIONS else 0
    after = 17
    while place and card.text(place).upper() in _STATIONS:
        other = [card.real(place + 2 + k, card.real(3 + k)) for k in range(6)]
        if other != card.reals(3, 6):
            raise card.error("is tapered. Give beams of one section, or export the matrices.")
        place += 16 if card.text(place).upper() == "YES" else 8
        after = place
    if card.real(6):
        raise card.error("has a product of inertia I12. Turn the axes to the principal ones.")
    if any(card.real(k) for k in range(after + 2, after + 16)):
        raise card.error(
            "has warping, taper in shear, or masses or neutral axes off its axis. Leave fields "
            "S1 and beyond empty, or export the matrices."
        )
    given = [card.real(3), card.real(4), card.real(5), card.real(7)]
    factors = [card.real(after, 1.0), card.real(after + 1, 1.0)]
    return _general(mesh, card, given, factors), _line_mass(mesh, card.real(8))


def _general(
    mesh: Mesh, card: Fields, given: list[float], factors: list[float]
) -> dict[str, Any]:
    """Section of A, I1, I2 and J; plane 1 is that of the local x and y axes."""
    area, plane_1, plane_2, torsion = given
    if not min(given) > 0.0:
        raise card.error(
            f"has A={area:g}, I1={plane_1:g}, I2={plane_2:g}, J={torsion:g}. A beam needs "
            "four positive numbers; give a small J where torsion does not matter, or a CROD."
        )
    size = mesh.units.length_m
    section = {
        "area_m2": area * size**2,
        "inertia_y_m4": plane_2 * size**4,
        "inertia_z_m4": plane_1 * size**4,
        "torsion_m4": torsion * size**4,
    }
    if any(factors):
        shear = [(factor or _MANY) * section["area_m2"] for factor in factors]
        section |= {"shear_y_m2": shear[0], "shear_z_m2": shear[1]}
    return section


def _shape(mesh: Mesh, card: Fields) -> tuple[dict[str, Any], float]:
    """PBARL or PBEAML of one section; sizes begin in the second line."""
    shape = card.text(4).upper()
    if shape not in SHAPES:
        raise card.error(
            f"has the shape {shape!r}. Allowed are {', '.join(SHAPES)}; give others by a PBAR."
        )
    count = SHAPES[shape]
    sizes = [card.real(9 + k) * mesh.units.length_m for k in range(count)]
    if not min(sizes) > 0.0 or any(card.text(k) for k in range(10 + count, len(card))):
        raise card.error(
            f"of shape {shape} needs {count} positive sizes, and nothing behind its "
            "nonstructural mass (one section from end to end)."
        )
    extra = _line_mass(mesh, card.real(9 + count))
    if shape == "BAR":  # the first size is along the local z axis
        return {"shape": "rectangle", "width_m": sizes[1], "height_m": sizes[0]}, extra
    if shape == "BOX":
        return box(sizes[1], sizes[0], sizes[2], sizes[3]), extra
    if shape == "ROD":
        return solid_round(sizes[0]), extra
    radius, inner = sizes if shape != "TUBE2" else (sizes[0], sizes[0] - sizes[1])
    if not 0.0 <= inner < radius:
        raise card.error(f"has radii {radius:g} and {inner:g} m. The first is the outer one.")
    wall = radius - inner
    return {"shape": "tube", "diameter_m": 2 * radius, "wall_m": wall}, extra
