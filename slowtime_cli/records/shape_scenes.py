"""The part of a report of `identify` that shows mode shapes in space."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime.identification.automatic.modal_result import ModalResult
from slowtime.identification.mode_shapes.criteria import real_shape
from slowtime_schemas.files.geometry import Geometry as StoredGeometry
from slowtime_schemas.files.model_v2 import LineModelFile
from slowtime_services.matrices import describe_reduced, read_matrix_model
from slowtime_services.modal import UNIVERSAL, Geometry, ReadModes, read_modes
from slowtime_services.models import (
    description_of,
    model_file_of,
    read_finite_elements,
    read_model,
)
from slowtime_services.reports import Scene, Section, Sketch
from slowtime_services.wireframes import (
    MeasuredShapes,
    ModelShapes,
    Wireframe,
    geometry_of,
    measured_wireframe,
    scene_of,
    stored_motions,
    wireframe_of_geometry,
    with_geometry,
)

from .mode_tables import ModelMode, nearest_mode

MOST_MODES = 12
"""Modes of the model that are shown beside those that were measured."""


def spatial_section(
    result: ModalResult,
    channels: Sequence[str],
    models: Sequence[ModelMode],
    *,
    model: Path | None,
    geometry: Geometry | None,
) -> list[Section]:
    """Return the section of mode shapes in space.

    Parameters
    ----------
    result
        Modes that were identified.
    channels
        Of their components.
    models
        Modes of the model, in ascending frequency.
    model
        Model file, or universal file with modes and nodes.
    geometry
        Where the channels are, where the model does not say.

    Returns
    -------
    One section; none where nothing says where the channels are.
    """
    if not result.structural:
        return []
    wire, shapes = None, None
    if model is not None:
        wire, shapes = _of_model(model, channels, geometry)
    if wire is None and geometry is not None and geometry.nodes:
        wire = measured_wireframe(channels, geometry)
    if wire is None or not wire.sensors:
        return []
    scene = scene_of(wire, shapes, _measured(result, channels, models))
    words = (
        "Measured shapes are scaled to those of the model; across the directions of the "
        "sensors, where nothing was measured, points move as in the model."
        if shapes is not None
        else "Nodes without a sensor, and directions that were not measured, stay at rest."
    )
    return [Section("Shapes in space", (), [Scene(scene, words)])]


def _measured(
    result: ModalResult, channels: Sequence[str], models: Sequence[ModelMode]
) -> MeasuredShapes:
    modes = result.structural
    meant = [nearest_mode(mode, models) if models else None for mode in modes]
    return MeasuredShapes(
        channels=tuple(channels),
        frequency_hz=np.array([mode.frequency_hz.value for mode in modes]),
        frequency_sd_hz=np.array([mode.frequency_hz.sd for mode in modes]),
        shapes=np.array([mode.shape for mode in modes], dtype=complex).reshape(
            len(modes), len(channels)
        ),
        model_mode=tuple(None if one is None else one[0] for one in meant),
    )


def _of_model(
    path: Path, channels: Sequence[str], geometry: Geometry | None
) -> tuple[Wireframe | None, ModelShapes | None]:
    """Wireframe and modes of a model, where it says where its nodes are."""
    if path.suffix.lower() in UNIVERSAL:
        return _of_universal(read_modes(path), channels, geometry)
    file = read_finite_elements(path)
    if file is None:
        read = read_model(path)
    else:
        full = read_matrix_model(path)
        reduced = describe_reduced(full)
        found = model_file_of(reduced.description)
        read = with_geometry(found, geometry_of(full, reduced))
    if not isinstance(read, LineModelFile) or read.geometry is None:
        return None, None
    return wireframe_of_geometry(read.geometry), _stored_shapes(read, read.geometry)


def _stored_shapes(file: LineModelFile, geometry: StoredGeometry) -> ModelShapes:
    structure = assemble(description_of(file))
    modes = undamped_modes(structure)
    count = min(MOST_MODES, len(modes.frequency_hz))
    motions = stored_motions(geometry, structure.names) @ modes.shapes[:, :count]
    return ModelShapes(
        np.asarray(modes.frequency_hz[:count]),
        motions.T.reshape(count, len(geometry.nodes), 3),
    )


def _of_universal(
    read: ReadModes, channels: Sequence[str], geometry: Geometry | None
) -> tuple[Wireframe | None, ModelShapes | None]:
    """Wireframe and modes of a universal file that has nodes beside its modes."""
    nodes = read.geometry if read.geometry.nodes else geometry
    named = {name: place for mode in read.modes for name, place in mode.names.items()}
    if geometry is not None and geometry.places:
        named |= geometry.places
    if nodes is None or not nodes.nodes or read.at(tuple(channels)) is None:
        return None, None
    places = named if all(name in named for name in channels) else {}
    wire = measured_wireframe(channels, Geometry(nodes.nodes, nodes.lines, places))
    number = {name: k for k, name in enumerate(wire.names)}
    moved = np.zeros((len(read.modes), len(wire.names), 3))
    for row, mode in enumerate(read.modes):
        real = real_shape(np.array(list(mode.shape.values())))
        for place, value in zip(mode.shape, real.tolist(), strict=True):
            if str(place.node) in number:
                sign = 1.0 if place.axis > 0 else -1.0
                moved[row, number[str(place.node)], abs(place.axis) - 1] = sign * value
    return wire, ModelShapes(np.array([mode.frequency_hz for mode in read.modes]), moved)


def sketch_of_places(known: Geometry | None, channels: Sequence[str]) -> Sketch | None:
    """Sketch a structure by the positions of its sensors, seen from the side that is widest."""
    if known is None or not known.nodes:
        return None
    every = np.array(list(known.nodes.values()), dtype=float)
    wide = np.argsort(-np.ptp(every, axis=0))[:2]
    across, up = sorted(int(axis) for axis in wide)
    points = [(str(n), float(at[across]), float(at[up])) for n, at in known.nodes.items()]
    lines = [
        (f"{first}–{last}", str(first), str(last))
        for line in known.lines
        for first, last in itertools.pairwise(line)
        if first and last and first in known.nodes and last in known.nodes
    ]
    marked = {str(known.places[name].node) for name in channels if name in known.places}
    return Sketch(points, lines, tuple(sorted(marked)))
