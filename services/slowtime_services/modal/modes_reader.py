"""Modes of a universal file: frequency, damping and complex shape of each dataset 55.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: number 55, data at nodes".
"""

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Complex

from slowtime_services.files import RecordError

from .datasets import Dataset, datasets_of, integers, numbers
from .geometry import AXES, Geometry, NodeAxis, geometry_of, name_of

NORMAL_MODE, COMPLEX_FIRST, COMPLEX_SECOND = 2, 3, 7
"""Analysis types of modes [1]_."""
COMPLEX = 5
"""Data type of complex values [1]_; 2 is real."""
TRANSLATIONS = 3
_ID_LINES = 5
_A_LINE, _WHOLE_A_LINE = 6, 8
"""Numbers of a line, of 13 and of 10 characters [1]_."""
_SAID = re.compile(r"([a-z_]+)=(\S+)")
_NAMED = re.compile(r"(\S+)=(\d+)([+-][XYZ])")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ReadMode:
    """One mode of a file.

    Parameters
    ----------
    frequency_hz, damping_ratio
        Undamped natural frequency, and ratio to critical damping.
    shape
        Complex component at each place, as the file scales it.
    frequency_sd, damping_sd
        Standard deviations where the file states them, else NaN.
    names
        Names of channels at their places, where the file states them.
    """

    frequency_hz: float
    damping_ratio: float
    shape: Mapping[NodeAxis, complex]
    frequency_sd: float = math.nan
    damping_sd: float = math.nan
    names: Mapping[str, NodeAxis] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, slots=True)
class ReadModes:
    """Modes of a file in ascending frequency, and its geometry."""

    modes: tuple[ReadMode, ...]
    geometry: Geometry

    def at(self, channels: tuple[str, ...]) -> Complex[np.ndarray, "mode channel"] | None:
        """Shapes at channels, by the file's names or as ``node 7 +Z``; None if one lacks."""
        named = {name: place for mode in self.modes for name, place in mode.names.items()}
        shapes = np.zeros((len(self.modes), len(channels)), dtype=complex)
        for column, name in enumerate(channels):
            place = named.get(name) or _place_of(name)
            if place is None:
                return None
            for row, mode in enumerate(self.modes):
                if place in mode.shape:
                    shapes[row, column] = mode.shape[place]
                elif (other := NodeAxis(place.node, -place.axis)) in mode.shape:
                    shapes[row, column] = -mode.shape[other]
                else:
                    return None
        return shapes


def read_modes(path: Path) -> ReadModes:
    """Read the modes of a universal file.

    Raises
    ------
    RecordError
        Where it holds none, or one that contradicts itself.
    """
    datasets = datasets_of(path)
    modes = [mode for one in datasets if one.kind == "55" and (mode := _mode(one)) is not None]
    if not modes:
        kinds = ", ".join(sorted({one.kind for one in datasets})) or "none"
        raise RecordError(
            f"{path.name} holds no mode (dataset 55 of analysis type 2, 3 or 7); its datasets: "
            f"{kinds}. Export the modes of a modal analysis."
        )
    modes.sort(key=lambda mode: mode.frequency_hz)
    return ReadModes(tuple(modes), geometry_of(datasets))


def _mode(dataset: Dataset) -> ReadMode | None:
    _, analysis, _, _, kind, per_node = integers(dataset, _ID_LINES, [10] * 6)
    if analysis not in (NORMAL_MODE, COMPLEX_FIRST, COMPLEX_SECOND):
        return None
    whole, real = integers(dataset, _ID_LINES + 1, [10, 10])
    if not (1 <= whole <= 10 and 1 <= real <= 12 and 1 <= per_node <= 9):
        raise _contradicts(dataset, f"{whole} whole and {real} real parameters of {per_node}")
    at = _ID_LINES + 1 + -(-(2 + whole) // _WHOLE_A_LINE)
    frequency, damping = _pole(dataset, analysis, at, real)
    first = at + -(-real // _A_LINE)
    said = dict(_SAID.findall(dataset.lines[1])) if "slowtime" in dataset.lines[1] else {}
    names = {
        name: NodeAxis(int(node), AXES[axis])
        for line in dataset.lines[2:_ID_LINES]
        for name, node, axis in _NAMED.findall(line)
        if said
    }
    return ReadMode(
        frequency, damping, _shape(dataset, first, kind, per_node),
        _number(said.get("f_sd")), _number(said.get("z_sd")), names,
    )  # fmt: skip


def _pole(dataset: Dataset, analysis: int, at: int, real: int) -> tuple[float, float]:
    """Natural frequency and damping ratio; of an eigenvalue |s| / (2 pi) and -Re s / |s|."""
    values = numbers(dataset, at, (0, 13, min(real, _A_LINE)))
    if analysis == NORMAL_MODE:
        frequency, damping = values[0], values[2] if real > 2 else 0.0
        if real > 3 and damping == 0.0:
            damping = 0.5 * values[3]  # a loss factor is twice the ratio at resonance
    else:
        if real < 2:
            raise _contradicts(dataset, "an eigenvalue of one part")
        size = math.hypot(values[0], values[1])
        frequency, damping = size / (2 * math.pi), -values[0] / size if size else 0.0
    if not (0 < frequency < 1e12 and -1 <= damping <= 1):
        raise _contradicts(dataset, f"a mode of {frequency:g} Hz and damping {damping:g}")
    return frequency, damping


def _shape(dataset: Dataset, first: int, kind: int, per_node: int) -> dict[NodeAxis, complex]:
    count = per_node * (2 if kind == COMPLEX else 1)
    rows = -(-count // _A_LINE)
    body = dataset.lines[first:]
    if len(body) % (1 + rows):
        raise _contradicts(dataset, f"{len(body)} lines of nodes, {1 + rows} for each")
    shape: dict[NodeAxis, complex] = {}
    for at in range(first, len(dataset.lines), 1 + rows):
        node = integers(dataset, at, [10])[0]
        values: list[float] = []
        for row in range(rows):
            here = min(_A_LINE, count - row * _A_LINE)
            values += numbers(dataset, at + 1 + row, (0, 13, here))
        pairs = values if kind != COMPLEX else [
            complex(re_, im) for re_, im in zip(values[::2], values[1::2], strict=True)
        ]  # fmt: skip
        for axis, value in enumerate(pairs[:TRANSLATIONS], start=1):
            shape[NodeAxis(node, axis)] = complex(value)
    return shape


def _place_of(name: str) -> NodeAxis | None:
    match = re.fullmatch(r"node (\d{1,9}) ([+-][XYZ])", name)
    return NodeAxis(int(match[1]), AXES[match[2]]) if match else None


def _number(text: str | None) -> float:
    try:
        return float(text) if text else math.nan
    except ValueError:
        return math.nan


def _contradicts(dataset: Dataset, what: str) -> RecordError:
    return RecordError(
        f"The dataset 55 at line {dataset.first_line} of {dataset.file} states {what}: it is "
        "damaged, or of another kind. Export it again."
    )


__all__ = ["ReadMode", "ReadModes", "name_of", "read_modes"]
