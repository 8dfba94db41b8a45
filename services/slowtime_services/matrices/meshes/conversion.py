"""Mesh file → model file with a frame, and notes on what was assumed."""

import dataclasses
from collections import Counter
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from slowtime_schemas.files.finite_elements import FrameModel
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.documents.core_schema import CoreDumper
from slowtime_services.matrices.errors import MatrixFileError
from slowtime_services.matrices.nastran_bulk import BULK
from slowtime_services.reasons import reason_of

from .abaqus import read_input
from .mesh import DIRECTIONS, Mesh
from .nastran import read_bulk
from .unit_systems import UNIT_SYSTEMS

INPUT = (".inp",)
BULK_MESHES = tuple(ending for ending in BULK if ending not in (".pch", ".dmig"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Converted:
    """A mesh as a frame.

    Parameters
    ----------
    file
        Model file of version 2.
    notes
        What was assumed, for the user.
    """

    file: FiniteElementFile
    notes: tuple[str, ...]


def convert_mesh(path: Path, *, unit: str = "m", parameters: bool = False) -> Converted:
    """Convert a mesh of beams, bars, springs, masses and flat shells to a frame.

    Parameters
    ----------
    path
        Bulk data of Nastran (.bdf, .dat, .nas) or input of Abaqus or CalculiX (.inp).
    unit
        Key of `UNIT_SYSTEMS`: the unit of length of the consistent system that the file uses.
    parameters
        Whether to add a parameter of the stiffness for each group; groups are made of the
        properties (Nastran) and sets of sections (Abaqus) in either case.

    Returns
    -------
    The frame and notes.

    Raises
    ------
    MatrixFileError
        Where something in the file may matter and is not understood.
    """
    suffix = path.suffix.lower()
    if suffix not in INPUT + BULK_MESHES:
        raise MatrixFileError(
            f"{path.name} ends in {suffix or 'nothing'}. Meshes are bulk data of Nastran "
            f"({', '.join(BULK_MESHES)}) or input of Abaqus or CalculiX (.inp); records are "
            "converted by `slowtime import`."
        )
    mesh = Mesh(path=path, units=UNIT_SYSTEMS[unit])
    try:
        (read_input if suffix in INPUT else read_bulk)(mesh)
    except MatrixFileError:
        raise
    except (ValueError, KeyError, IndexError) as error:  # of damaged lines
        raise MatrixFileError(
            f"{path.name} cannot be read: {reason_of(error)} Write it again."
        ) from error
    if not mesh.elements and not mesh.shells:
        raise MatrixFileError(
            f"{path.name} has no beam, bar, spring or shell. Export the matrices of models "
            "of other elements, and name them under `matrices`."
        )
    body = {
        "slowtime_model": 2,
        "name": path.stem[:64],
        "frame": _frame(mesh, parameters=parameters),
    }
    try:
        file = FiniteElementFile.model_validate(body)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise MatrixFileError(f"{path.name}: {where}: {first['msg']}") from error
    return Converted(file=file, notes=tuple(mesh.notes))


def frame_text(file: FiniteElementFile) -> str:
    """Write a model file with a frame as YAML, one line for each of its entries.

    Parameters
    ----------
    file
        The model file.

    Returns
    -------
    Text; reading it back gives the same model to the last digit.
    """
    assert file.frame is not None
    lines = [f"slowtime_model: 2\nname: {_flow(file.name)}\nframe:\n"]
    for key, entries in file.frame.model_dump(mode="json", exclude_defaults=True).items():
        lines.append(f"  {key}:\n")
        lines += [f"    - {_flow(entry)}\n" for entry in entries]
    return "".join(lines)


def _flow(value: Any) -> str:
    text = yaml.dump(
        value, Dumper=CoreDumper, default_flow_style=True, sort_keys=False, width=10**6
    )
    return str(text).removesuffix("...\n").rstrip("\n")


def _frame(mesh: Mesh, *, parameters: bool) -> dict[str, Any]:
    used = Counter(one["section"] for one in mesh.elements if "section" in one)
    every = [*mesh.elements, *mesh.shells]
    made = Counter(one["material"] for one in every if "material" in one)
    groups = dict.fromkeys(one["group"] for one in every)
    frame = {
        "nodes": [{"id": name, "at": at} for name, at in mesh.nodes.items()],
        "materials": [{"id": k, **one} for k, one in mesh.materials.items() if k in made],
        "sections": [{"id": k, **one} for k, one in mesh.sections.items() if k in used],
        "elements": mesh.elements,
        "masses": mesh.masses,
        "shells": mesh.shells,
        "supports": [
            {"node": node, "directions": [d for d in DIRECTIONS if d in held]}
            for node, held in mesh.supports.items()
        ],
        "links": mesh.links,
        "constraints": mesh.constraints,
        "parameters": [{"name": g, "groups": [g]} for g in groups] if parameters else [],
    }
    unused = set(frame) - set(FrameModel.model_fields)
    assert not unused, unused
    return {key: value for key, value in frame.items() if value}
