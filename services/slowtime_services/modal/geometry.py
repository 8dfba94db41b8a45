"""Where channels are: a node and a direction each, and where the nodes are."""

import csv
import dataclasses
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from slowtime_services.documents.bounds import DocumentError, document_text
from slowtime_services.files import RecordError

from .datasets import Dataset, datasets_of, integers, numbers

AXES = {"+X": 1, "-X": -1, "+Y": 2, "-Y": -2, "+Z": 3, "-Z": -3}
_NAMES = {value: name for name, value in AXES.items()}
_NODE = re.compile(r"node (\d{1,9}) ([+-][XYZ])")
_AXIS_AT_END = re.compile(r"(?P<stem>.*?)[\s_.\-]*(?P<sign>[+-])?(?P<axis>[xyzXYZ])")
UNIVERSAL = (".uff", ".unv")
MOST_CHANNELS = 20_000
"""Rows of a table of channels at most [1]; records have up to some thousand channels."""
NEEDED = ("channel", "x", "y", "z")


class NodeAxis(NamedTuple):
    """A node and a direction: 1, 2, 3 along x, y, z, negative against them."""

    node: int
    axis: int


@dataclasses.dataclass(frozen=True, slots=True)
class Geometry:
    """Nodes, lines between them, and which channel is where.

    Parameters
    ----------
    nodes
        Coordinates of each node, in the unit of the file.
    lines
        Nodes that are joined; 0 lifts the pen.
    places
        Node and direction of channels by name.
    """

    nodes: Mapping[int, tuple[float, float, float]] = dataclasses.field(default_factory=dict)
    lines: tuple[tuple[int, ...], ...] = ()
    places: Mapping[str, NodeAxis] = dataclasses.field(default_factory=dict)


def name_of(place: NodeAxis) -> str:
    """Name a channel by its place, as readers of universal files do.

    Examples
    --------
    >>> name_of(NodeAxis(7, -3))
    'node 7 -Z'
    """
    return f"node {place.node} {_NAMES[place.axis]}"


def places_of(
    channels: Sequence[str], geometry: Geometry | None = None
) -> tuple[NodeAxis, ...]:
    """Assign a node and a direction to each channel.

    They are those of the geometry; else those of the name, as in ``node 7 +Z``; else channels
    that differ in a last x, y or z share a node, and every other has one of its own, along x.

    Raises
    ------
    RecordError
        Where two channels would be at one place, or the geometry lacks one.

    Examples
    --------
    >>> [(one.node, one.axis) for one in places_of(("a_x", "a_y", "roof"))]
    [(1, 1), (1, 2), (2, 1)]
    """
    found = [_NODE.fullmatch(name) for name in channels]
    if geometry is not None and geometry.places:
        missing = [name for name in channels if name not in geometry.places]
        if missing:
            raise RecordError(
                f"The geometry has no channel {', '.join(missing)}. It has: "
                f"{', '.join(geometry.places)}. Add a row for each channel."
            )
        places = [geometry.places[name] for name in channels]
    elif all(found):
        places = [NodeAxis(int(match[1]), AXES[match[2]]) for match in found if match]
    else:
        places = _by_stem(channels)
    twice = {place for place in places if places.count(place) > 1}
    if twice:
        names = [n for n, place in zip(channels, places, strict=True) if place in twice]
        raise RecordError(
            f"{', '.join(names)} would be at one node in one direction. Give --geometry with "
            "a node and a direction for each channel."
        )
    return tuple(places)


def _by_stem(channels: Sequence[str]) -> list[NodeAxis]:
    nodes: dict[str, int] = {}
    places = []
    for name in channels:
        match = _AXIS_AT_END.fullmatch(name)
        stem = match["stem"] if match else name
        sign = -1 if match and match["sign"] == "-" else 1
        axis = "xyz".index(match["axis"].lower()) + 1 if match else 1
        places.append(NodeAxis(nodes.setdefault(stem, len(nodes) + 1), sign * axis))
    return places


def read_geometry(path: Path) -> Geometry:
    """Read nodes of a universal file (15, 2411, lines of 82) or of a CSV file.

    The CSV file has a row a channel: ``channel,x,y,z`` and, where they are known, ``direction``
    (+X, -Y ...) and ``node`` (a number).

    Raises
    ------
    RecordError
        Where it is neither, or holds no node.
    """
    if path.suffix.lower() in UNIVERSAL:
        found = geometry_of(datasets_of(path))
        if not found.nodes:
            raise RecordError(
                f"{path.name} holds no nodes (datasets 15 or 2411). Give a file with some, or "
                "CSV with the columns channel, x, y, z."
            )
        return found
    return _of_table(path)


def geometry_of(datasets: Sequence[Dataset]) -> Geometry:
    """Gather nodes and lines of datasets 15, 2411 and 82."""
    nodes: dict[int, tuple[float, float, float]] = {}
    lines = []
    for one in datasets:
        if one.kind == "15":
            for at in range(len(one.lines)):
                label = integers(one, at, [10])[0]
                x, y, z = numbers(one, at, (40, 13, 3))
                nodes[label] = (x, y, z)
        elif one.kind == "2411":
            for at in range(0, len(one.lines) - 1, 2):
                x, y, z = numbers(one, at + 1, (0, 25, 3))
                nodes[integers(one, at, [10])[0]] = (x, y, z)
        elif one.kind == "82":
            count = integers(one, 0, [10, 10])[1]
            words = " ".join(one.lines[2:]).split()
            if count > len(words):
                raise RecordError(
                    f"A dataset 82 of {one.file} states {count:,} nodes and lists "
                    f"{len(words):,}: it is cut short, or was changed. Export it again."
                )
            traced = tuple(int(float(word)) for word in words[:count] if _is_number(word))
            lines.append(traced)
    return Geometry(nodes, tuple(lines))


def _is_number(word: str) -> bool:
    return re.fullmatch(r"-?\d{1,9}(\.0*)?", word) is not None


def _length(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def _label(text: str) -> int | None:
    if text.strip() and re.fullmatch(r"\s*\d{1,9}\s*", text) is None:
        raise ValueError(f"{text[:40]!r} is not the number of a node")
    return int(text) if text.strip() else None


def _of_table(path: Path) -> Geometry:
    try:
        lines = document_text(path).splitlines()
        rows = list(itertools.islice(csv.DictReader(lines), MOST_CHANNELS + 1))
    except DocumentError as error:
        raise RecordError(str(error)) from None
    except csv.Error as error:
        raise RecordError(f"{path.name} is not CSV text: {error}. Save it as CSV.") from None
    if len(rows) > MOST_CHANNELS:
        raise RecordError(
            f"{path.name} has more than {MOST_CHANNELS:,} rows. Give one for each channel."
        )
    nodes: dict[int, tuple[float, float, float]] = {}
    labels: dict[tuple[float, float, float], int] = {}
    places: dict[str, NodeAxis] = {}
    for number, row in enumerate(rows, start=2):
        known = {(key or "").strip().casefold(): (value or "") for key, value in row.items()
                 if isinstance(value, str)}  # fmt: skip
        try:
            point = (_length(known["x"]), _length(known["y"]), _length(known["z"]))
            channel = known["channel"].strip()
            label = _label(known.get("node", "")) or labels.get(point) or len(nodes) + 1
            direction = (known.get("direction") or "+X").strip().upper()
            axis = AXES[direction if direction[:1] in "+-" else f"+{direction}"]
        except (KeyError, ValueError) as error:
            raise RecordError(
                f"Line {number} of {path.name} is not a row of a geometry ({error!s:.100}). "
                "Give the "
                f"columns {', '.join(NEEDED)}, and direction (+X, -X, +Y ...) and node where "
                "they are known."
            ) from None
        nodes[label], places[channel] = point, NodeAxis(label, axis)
        labels.setdefault(point, label)
    if not places:
        raise RecordError(f"{path.name} has no rows. Give one for each channel.")
    return Geometry(nodes, (), places)
