"""The section `frame` of a model file → a frame of finite elements."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from slowtime.finite_elements.frame import (
    Bar,
    Beam,
    Frame,
    MultiPointConstraint,
    Parameter,
    PointMass,
    RigidLink,
    Shell,
    Spring,
    Support,
)
from slowtime.finite_elements.sections import Material, Section, rectangle, tube
from slowtime_schemas.files.finite_elements import (
    FrameElement,
    FrameModel,
    FrameSection,
    FrameShell,
)

from .errors import MatrixFileError

GROUND = "base"
"""Name of the ground in a model file."""


def frame_of(section: FrameModel) -> Frame:
    """Turn a section into the frame it describes.

    Parameters
    ----------
    section
        The section, whose numbers were checked.

    Raises
    ------
    MatrixFileError
        Where a name is used twice or does not exist, or an element cannot be what it says.
    """
    groups = _groups(section)
    elements = [_element(one, section, groups) for one in section.elements]
    masses = [
        PointMass(
            name=one.id,
            node=one.node,
            mass_kg=one.mass_kg,
            inertia_kg_m2=one.inertia_kg_m2,
            offset_m=one.offset_m,
            group=groups[one.id],
        )
        for one in section.masses
    ]
    try:
        return Frame(
            node_names=tuple(node.id for node in section.nodes),
            coordinates=np.array([node.at for node in section.nodes], dtype=float),
            bars=tuple(one for one in elements if isinstance(one, Bar)),
            beams=tuple(one for one in elements if isinstance(one, Beam)),
            springs=tuple(one for one in elements if isinstance(one, Spring)),
            masses=tuple(masses),
            shells=tuple(_shell(one, section, groups) for one in section.shells),
            supports=tuple(
                Support(node=one.node, directions=one.directions) for one in section.supports
            ),
            links=tuple(RigidLink(**one.model_dump()) for one in section.links),
            constraints=tuple(
                MultiPointConstraint(
                    terms=tuple((t.node, t.direction, t.factor) for t in one.terms)
                )
                for one in section.constraints
            ),
            parameters=tuple(
                Parameter(
                    name=one.name,
                    groups=(*one.groups, *((_own(one.name),) if one.elements else ())),
                    acts_on=one.acts_on,
                )
                for one in section.parameters
            ),
        )
    except ValueError as error:
        raise MatrixFileError(f"`frame`: {error}") from error


def _own(parameter: str) -> str:
    """Name of the group of the elements that a parameter lists itself."""
    return f"elements of {parameter}"


def _groups(section: FrameModel) -> dict[str, str]:
    """Group of every element and mass, by its own word or by that of a parameter."""
    found = {one.id: one.group or "" for one in section.elements}
    found |= {one.id: one.group or "" for one in section.masses}
    found |= {one.id: one.group or "" for one in section.shells}
    for parameter in section.parameters:
        for name in parameter.elements:
            if name not in found:
                raise MatrixFileError(
                    f"Parameter {parameter.name!r} names the element {name!r}, which does not "
                    f"exist. Allowed are the {len(found)} elements, masses and shells of "
                    "`frame`."
                )
            if found[name]:
                raise MatrixFileError(
                    f"Parameter {parameter.name!r} names the element {name!r}, which is in the "
                    f"group {found[name]!r}. An element is in one group; name that group under "
                    "`groups`, or take the element out of it."
                )
            found[name] = _own(parameter.name)
    return found


def _element(
    one: FrameElement, section: FrameModel, groups: Mapping[str, str]
) -> Bar | Beam | Spring:
    group = groups[one.id]
    if one.kind == "spring":
        first, second = one.between
        ends = (second, first) if second == GROUND else (first, second)
        return Spring(
            name=one.id,
            ends=(None if ends[0] == GROUND else ends[0], ends[1]),
            translation_n_per_m=one.translation_n_per_m,
            rotation_nm_per_rad=one.rotation_nm_per_rad,
            group=group,
        )
    sections = {given.id: given for given in section.sections}
    materials = {given.id: given for given in section.materials}
    for what, name, known in (
        ("section", one.section, sections),
        ("material", one.material, materials),
    ):
        if name not in known:
            raise MatrixFileError(
                f"Element {one.id!r} names the {what} {name!r}. Allowed are "
                f"{', '.join(known) or 'none'}, those under `{what}s`."
            )
    shape = _section(sections[str(one.section)])
    material = Material(**materials[str(one.material)].model_dump(exclude={"id"}))
    if one.kind == "bar":
        return Bar(name=one.id, ends=one.between, section=shape, material=material, group=group)
    if not min(shape.inertia_y_m4, shape.inertia_z_m4, shape.torsion_m4) > 0.0:
        raise MatrixFileError(
            f"Beam {one.id!r} has the section {one.section!r} without inertias. Give "
            "`inertia_y_m4`, `inertia_z_m4` and `torsion_m4`, or make it a bar."
        )
    if (
        one.theory == "timoshenko"
        and not np.isfinite([shape.shear_y_m2, shape.shear_z_m2]).all()
    ):
        raise MatrixFileError(
            f"Beam {one.id!r} is a Timoshenko beam, and its section {one.section!r} has no "
            "`shear_y_m2` and `shear_z_m2`. Give them, or say `theory: euler`."
        )
    return Beam(
        name=one.id,
        ends=one.between,
        section=shape,
        material=material,
        theory=one.theory,
        orientation=one.orientation,
        group=group,
        released=one.released,
    )


def _shell(one: FrameShell, section: FrameModel, groups: Mapping[str, str]) -> Shell:
    materials = {given.id: given for given in section.materials}
    if one.material not in materials:
        raise MatrixFileError(
            f"Shell {one.id!r} names the material {one.material!r}. Allowed are "
            f"{', '.join(materials) or 'none'}, those under `materials`."
        )
    return Shell(
        name=one.id,
        corners=one.corners,
        thickness_m=one.thickness_m,
        material=Material(**materials[one.material].model_dump(exclude={"id"})),
        group=groups[one.id],
    )


def _section(given: FrameSection) -> Section:
    try:
        if given.shape == "rectangle":
            return rectangle(float(given.width_m or 0.0), float(given.height_m or 0.0))
        if given.shape == "tube":
            return tube(float(given.diameter_m or 0.0), float(given.wall_m or 0.0))
    except ValueError as error:
        raise MatrixFileError(f"Section {given.id!r}: {error}") from error
    names = [field.name for field in dataclasses.fields(Section)]
    said = {name: value for name in names if (value := getattr(given, name)) is not None}
    return Section(**said)
