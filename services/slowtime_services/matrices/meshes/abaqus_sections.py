"""Sections and materials of input of Abaqus or CalculiX → those of a frame."""

from typing import Any

from .abaqus_deck import KeywordBlock
from .mesh import Mesh, box, solid_round

DEFAULT_NORMAL = (0.0, 0.0, -1.0)
"""First local axis of a beam section where none is given, by both manuals."""


def add_material(mesh: Mesh, name: str, block: KeywordBlock) -> None:
    """Add what *ELASTIC or *DENSITY says to the material that was begun last."""
    if not name:
        raise block.error("comes before any *MATERIAL. Give it below one.")
    material = mesh.materials.setdefault(name, {})
    if block.keyword == "DENSITY":
        (density, *_) = block.numbers(0, 1)
        material["density_kg_m3"] = density * mesh.units.density_kg_m3
        return
    if block.parameters.get("TYPE", "ISO").upper() not in ("ISO", "ISOTROPIC"):
        raise block.error("is not isotropic. Allowed is TYPE=ISO.")
    young, poisson, *_ = block.numbers(0, 2)
    if len(block.data) > 1:
        mesh.note(f"*ELASTIC of {name}: its first temperature is used.")
    material |= {"young_pa": young * mesh.units.pressure_pa, "poisson": poisson}


def beam_section(mesh: Mesh, block: KeywordBlock) -> tuple[dict[str, Any], list[float]]:
    """Section of *BEAM SECTION, and its first local axis.

    Returns
    -------
    An entry of `sections`, and the axis, along local y.

    Raises
    ------
    MatrixFileError
        Where its shape is none of RECT, CIRC, PIPE and BOX.
    """
    shape = block.parameter("SECTION")
    normal = block.numbers(1)[:3] or list(DEFAULT_NORMAL)
    sizes = [value * mesh.units.length_m for value in block.numbers(0, 1)]
    if shape == "RECT" and len(sizes) > 1:
        return {"shape": "rectangle", "width_m": sizes[0], "height_m": sizes[1]}, normal
    if shape == "CIRC":
        return _round(block, sizes), normal
    if shape == "PIPE" and len(sizes) > 1:
        return {"shape": "tube", "diameter_m": 2 * sizes[0], "wall_m": sizes[1]}, normal
    if shape == "BOX" and len(sizes) > 5:
        a, b, t1, t2, t3, t4 = sizes[:6]
        if t1 != t3 or t2 != t4:
            raise block.error("has walls of unequal thickness. Give *BEAM GENERAL SECTION.")
        # t1 and t3 are the walls across the first axis, t2 and t4 those across the second.
        return box(a, b, t1, t2), normal
    raise block.error(
        f"has SECTION={shape} with {len(sizes)} sizes. Allowed are RECT (2), CIRC (1 or 2), "
        "PIPE (2) and BOX (6); give others by *BEAM GENERAL SECTION."
    )


def _round(block: KeywordBlock, sizes: list[float]) -> dict[str, Any]:
    """Give the solid round section of a radius (Abaqus) or two equal diameters (CalculiX)."""
    if len(sizes) > 1 and sizes[0] != sizes[1]:
        raise block.error("is an ellipse. Allowed are a radius, or two equal diameters.")
    return solid_round(sizes[0] / len(sizes[:2]))


def general_section(
    mesh: Mesh, block: KeywordBlock
) -> tuple[dict[str, Any], list[float], dict[str, Any]]:
    """Section, first local axis and material of *BEAM GENERAL SECTION, SECTION=GENERAL."""
    if block.parameters.get("SECTION", "GENERAL").upper() != "GENERAL":
        raise block.error("is not SECTION=GENERAL. Give A, I11, I12, I22, J of the section.")
    area, first, mixed, second, torsion = block.numbers(0, 5)[:5]
    if mixed:
        raise block.error("has a product of inertia I12. Turn the axes to the principal ones.")
    normal = block.numbers(1)[:3] or list(DEFAULT_NORMAL)
    young, shear, *_ = block.numbers(2, 2)
    size = mesh.units.length_m
    density = float(block.parameters.get("DENSITY", "0")) * mesh.units.density_kg_m3
    section = {
        "area_m2": area * size**2,
        "inertia_y_m4": first * size**4,
        "inertia_z_m4": second * size**4,
        "torsion_m4": torsion * size**4,
    }
    material = {
        "young_pa": young * mesh.units.pressure_pa,
        "poisson": young / (2 * shear) - 1,
        "density_kg_m3": density,
    }
    return section, normal, material
