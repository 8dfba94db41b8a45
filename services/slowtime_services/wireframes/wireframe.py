"""Nodes and lines to draw: of a frame, of matrices, or of a geometry file."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DofMap
from slowtime_schemas.files.finite_elements import FrameModel, SpatialSensor
from slowtime_services.matrices import MatrixFileError, MatrixModel
from slowtime_services.modal import Geometry as GeometryFile
from slowtime_services.modal import NodeAxis, places_of

from .thinning import contracted, spread_nodes

MOST_NODES = 300
"""Nodes that are drawn at most [1]: on a phone, more of them are a grey area, and the motions
of 300 nodes over 60 coordinates are 0.3 MB of the 4 MiB that a registration may have."""

_AXES = {"ux": (1.0, 0.0, 0.0), "uy": (0.0, 1.0, 0.0), "uz": (0.0, 0.0, 1.0)}


@dataclasses.dataclass(frozen=True, slots=True)
class SensorMark:
    """Where a channel is, and along which line it measures.

    Parameters
    ----------
    channel
        Its name.
    node
        Number of the drawn node.
    along
        Components along x, y and z.
    """

    channel: str
    node: int
    along: tuple[float, float, float]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Wireframe:
    """Nodes, and lines between them.

    Parameters
    ----------
    names
        Of the nodes.
    places
        Their positions [m].
    lines
        Pairs of numbers of nodes.
    groups
        Parameter that scales the part at each line; empty for none.
    sensors
        Channels at nodes.
    """

    names: tuple[str, ...]
    places: Float[np.ndarray, "node 3"]
    lines: Int[np.ndarray, "line 2"]
    groups: tuple[str, ...]
    sensors: tuple[SensorMark, ...] = ()

    def motion_rows(self, dofs: DofMap) -> sparse.csr_array:
        """Rows that see the displacement of each node along x, y and z.

        Returns
        -------
        Three rows for each node, node by node, over the degrees of freedom [1]; zero where a
        node has no such degree of freedom.
        """
        number = {name: k for k, name in enumerate(self.names)}
        drawn = np.array([number.get(name, -1) for name in dofs.node_names])
        own = drawn[dofs.node]
        kept = (own >= 0) & (dofs.direction < 3)
        rows = 3 * own[kept] + dofs.direction[kept]
        columns = np.flatnonzero(kept)
        return sparse.csr_array(
            (np.ones(len(columns)), (rows, columns)), shape=(3 * len(self.names), dofs.size)
        )


def wireframe_of(model: MatrixModel, most: int = MOST_NODES) -> Wireframe:
    """Outline a finite-element model.

    A frame has a line for each element and rigid link. Of matrices, lines join nodes that the
    stiffness couples. Of more than `most` nodes, those of sensors and others that are far from
    each other are drawn.

    Parameters
    ----------
    most
        Nodes that are drawn at most.

    Raises
    ------
    MatrixFileError
        Where the model does not say where its nodes are.
    """
    dofs = model.matrices.dofs
    if dofs is None or not np.ptp(dofs.coordinates, axis=0).any():
        raise MatrixFileError(
            "The model does not say where its nodes are, so that it cannot be drawn. Give "
            "`dofs` with x, y, z, or `positions`."
        )
    if model.file.frame is not None:
        lines, groups = _lines_of_frame(model.file.frame, dofs.node_names)
    else:
        lines, groups = _lines_of_matrices(model)
    number = {name: k for k, name in enumerate(dofs.node_names)}
    seen = [number[one.node] for one in model.file.sensors if one.node in number]
    chosen = spread_nodes(dofs.coordinates, np.array(sorted(set(seen)), dtype=int), most)
    if len(chosen) < len(dofs.node_names):
        lines, groups = contracted(lines, groups, dofs.coordinates, chosen)
    names = tuple(dofs.node_names[k] for k in chosen.tolist())
    return Wireframe(
        names=names,
        places=dofs.coordinates[chosen],
        lines=lines,
        groups=groups,
        sensors=_marks(model.file.sensors, names),
    )


def measured_wireframe(channels: Sequence[str], geometry: GeometryFile) -> Wireframe:
    """Wireframe of a geometry file: nodes, trace lines, and channels at their places.

    Parameters
    ----------
    channels
        Of the record.
    geometry
        Datasets 15, 2411 and 82 of a universal file, or a CSV file with a row for each channel.

    Returns
    -------
    The wireframe; without trace lines, nodes of sensors are joined each with its nearest one.
    """
    labels = sorted(geometry.nodes)
    number = {label: k for k, label in enumerate(labels)}
    places = np.array([geometry.nodes[label] for label in labels], dtype=float).reshape(-1, 3)
    lines = [
        (number[first], number[second])
        for trace in geometry.lines
        for first, second in itertools.pairwise(trace)
        if first in number and second in number and first != second
    ]
    if not lines:
        lines = _nearest_joined(places)
    found = places_of(tuple(channels), geometry if geometry.places else None)
    return Wireframe(
        names=tuple(str(label) for label in labels),
        places=places,
        lines=np.array(lines, dtype=int).reshape(-1, 2),
        groups=("",) * len(lines),
        sensors=tuple(
            SensorMark(channel, number[place.node], _along(place))
            for channel, place in zip(channels, found, strict=True)
            if place.node in number
        ),
    )


def _along(place: NodeAxis) -> tuple[float, float, float]:
    line = [0.0, 0.0, 0.0]
    line[abs(place.axis) - 1] = 1.0 if place.axis > 0 else -1.0
    return line[0], line[1], line[2]


def _nearest_joined(places: Float[np.ndarray, "node 3"]) -> list[tuple[int, int]]:
    """Minimum spanning tree of the nodes: the shortest lines that hold them together."""
    if len(places) < 2:
        return []
    away = np.linalg.norm(places[:, None] - places[None], axis=2)
    tree = sparse.csgraph.minimum_spanning_tree(away + 1e-12)
    return list(zip(*(part.tolist() for part in tree.nonzero()), strict=True))


def _marks(sensors: Sequence[SpatialSensor], names: tuple[str, ...]) -> tuple[SensorMark, ...]:
    number = {name: k for k, name in enumerate(names)}
    marks = []
    for one in sensors:
        along = one.line if one.direction is None else _AXES.get(one.direction)
        if one.node in number and along is not None:
            marks.append(SensorMark(one.channel, number[one.node], along))
    return tuple(marks)


def _lines_of_frame(
    frame: FrameModel, names: tuple[str, ...]
) -> tuple[Int[np.ndarray, "line 2"], tuple[str, ...]]:
    number = {name: k for k, name in enumerate(names)}
    owner = {group: one.name for one in frame.parameters for group in one.groups}
    owner |= {element: one.name for one in frame.parameters for element in one.elements}
    lines, groups = [], []
    for element in frame.elements:
        first, second = element.between
        if first in number and second in number and first != second:
            lines.append((number[first], number[second]))
            groups.append(owner.get(element.group or element.id, ""))
    sides = dict[tuple[int, int], str]()
    for shell in frame.shells:
        if all(corner in number for corner in shell.corners):
            ring = [number[corner] for corner in shell.corners]
            for one, other in zip(ring, [*ring[1:], ring[0]], strict=True):
                side = (min(one, other), max(one, other))
                sides.setdefault(side, owner.get(shell.group or shell.id, ""))
    lines += sides
    groups += sides.values()
    for link in frame.links:
        lines.append((number[link.leading], number[link.following]))
        groups.append("")
    return np.array(lines, dtype=int).reshape(-1, 2), tuple(groups)


def _lines_of_matrices(
    model: MatrixModel,
) -> tuple[Int[np.ndarray, "line 2"], tuple[str, ...]]:
    """Pairs of nodes that the stiffness couples, each with the part that couples them most."""
    matrices = model.matrices if model.unheld is None else model.unheld
    assert matrices.dofs is not None
    nodes, of = len(matrices.dofs.node_names), matrices.dofs.node
    whole = _node_coupling(matrices.stiffness, of, nodes)
    pairs = np.stack(whole.nonzero(), axis=1)
    best = np.zeros(len(pairs))
    groups = np.full(len(pairs), -1)
    for number, part in enumerate(matrices.stiffness_parts):
        if part is None:
            continue
        coupled = np.asarray(_node_coupling(part, of, nodes)[pairs[:, 0], pairs[:, 1]]).ravel()
        groups[coupled > best] = number
        best = np.maximum(best, coupled)
    named = tuple(matrices.names[k] if k >= 0 else "" for k in groups.tolist())
    return pairs.astype(int), named


def _node_coupling(
    matrix: sparse.csr_array, of: Int[np.ndarray, " own"], nodes: int
) -> sparse.csr_array:
    """Sum of the sizes of all entries between two nodes, above the diagonal."""
    entries = sparse.coo_array(matrix)
    first, second = (of[ends] for ends in entries.coords)
    upper = (first < second) & (entries.data != 0.0)
    values = (np.abs(entries.data[upper]), (first[upper], second[upper]))
    found = sparse.csr_array(sparse.coo_array(values, shape=(nodes, nodes)))
    found.sum_duplicates()
    return found
