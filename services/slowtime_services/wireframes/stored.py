"""Wireframes in reduced model files: section `geometry` from a full model, and back."""

import base64

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.elements import ROTATION
from slowtime_schemas.files.finite_elements import FrameNode
from slowtime_schemas.files.geometry import DrawnLine, DrawnSensor, Geometry
from slowtime_schemas.files.model import ModelFile
from slowtime_schemas.files.model_v2 import LineModelFile
from slowtime_services.matrices import MatrixFileError, MatrixModel, ReducedDescription

from .wireframe import SensorMark, Wireframe, wireframe_of

_NUMBER = "<f4"


def geometry_of(model: MatrixModel, reduced: ReducedDescription) -> Geometry | None:
    """Geometry of a full model over the coordinates of its reduced description.

    Parameters
    ----------
    reduced
        What `describe_reduced` made of it.

    Returns
    -------
    The geometry; None where the model does not say where its nodes are.
    """
    dofs = model.matrices.dofs
    try:
        wire = wireframe_of(model)
    except MatrixFileError:
        return None
    assert dofs is not None
    rows = wire.motion_rows(dofs)
    expansion = reduced.model.expansion
    own = rows if expansion is None else rows @ expansion
    motions = np.asarray(own @ reduced.model.basis, dtype=_NUMBER)
    return Geometry(
        nodes=tuple(
            FrameNode(id=name, at=(x, y, z))
            for name, (x, y, z) in zip(wire.names, wire.places.tolist(), strict=True)
        ),
        lines=tuple(
            DrawnLine(between=(wire.names[a], wire.names[b]), parameter=group or None)
            for (a, b), group in zip(wire.lines.tolist(), wire.groups, strict=True)
        ),
        sensors=tuple(
            DrawnSensor(channel=one.channel, node=wire.names[one.node], along=one.along)
            for one in wire.sensors
        ),
        coordinates=_coordinates(reduced),
        motions=base64.b64encode(motions.tobytes()).decode("ascii"),
    )


def with_geometry(file: ModelFile, geometry: Geometry | None) -> ModelFile:
    """Copy of a reduced model file that has a geometry; files of version 1 stay as they are."""
    if geometry is None or not isinstance(file, LineModelFile):
        return file
    return file.model_copy(update={"geometry": geometry})


def _coordinates(reduced: ReducedDescription) -> tuple[str, ...]:
    """Names of the coordinates, in the order of the reduced model, as matrices name them."""
    kept = reduced.model.interface
    nodes = [node.id for node in reduced.description.nodes]
    return tuple(
        name if number < kept else name + ROTATION for number, name in enumerate(nodes)
    )


def wireframe_of_geometry(geometry: Geometry) -> Wireframe:
    """Wireframe that a reduced model file holds."""
    number = {node.id: k for k, node in enumerate(geometry.nodes)}
    lines = [(number[a], number[b]) for a, b in (line.between for line in geometry.lines)]
    return Wireframe(
        names=tuple(number),
        places=np.array([node.at for node in geometry.nodes], dtype=float),
        lines=np.array(lines, dtype=int).reshape(-1, 2),
        groups=tuple(line.parameter or "" for line in geometry.lines),
        sensors=tuple(
            SensorMark(one.channel, number[one.node], one.along) for one in geometry.sensors
        ),
    )


def stored_motions(
    geometry: Geometry, coordinates: tuple[str, ...]
) -> Float[np.ndarray, "motion coordinate"]:
    """Motions of the drawn nodes over coordinates of an assembled model.

    Parameters
    ----------
    geometry
        Of the model file.
    coordinates
        Names of the degrees of freedom, in the order wanted.

    Returns
    -------
    Three rows for each node; zero for coordinates that the geometry does not know.
    """
    raw = np.frombuffer(base64.b64decode(geometry.motions), dtype=_NUMBER)
    stored = raw.reshape(3 * len(geometry.nodes), len(geometry.coordinates))
    column = {name: k for k, name in enumerate(geometry.coordinates)}
    found = np.zeros((len(stored), len(coordinates)))
    for k, name in enumerate(coordinates):
        if name in column:
            found[:, k] = stored[:, column[name]]
    return found
