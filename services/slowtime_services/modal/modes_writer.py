"""Modes as a universal file that programs of modal analysis read: datasets 55, 2411, 82.

Frequencies and shapes have the six digits of dataset 55. Standard deviations, for which it has
no place, stand in its second line of identification, names of channels in the third to fifth.

References
----------
.. [1] Structural Dynamics Research Laboratory, University of Cincinnati, "Universal File
   Datasets: numbers 55, 2411 and 82".
"""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from slowtime_schemas.files.modes import FoundMode, ModesFile
from slowtime_services.files import RecordError
from slowtime_services.files.units import Motion, unit_of

from .geometry import Geometry, NodeAxis, name_of, places_of

SPECIFIC: dict[Motion, int] = {"displacement": 8, "velocity": 11, "acceleration": 12}
"""Codes of what a value is [1]_; 0 is unknown."""
_WIDE, _LINES_OF_NAMES = 80, 3
_PLAIN = re.compile(r"[!-<>-~]{1,60}")
"""Names of channels that can stand before ``=7+X``."""
_NODES_A_LINE = 8
_STRUCTURAL, _COMPLEX_FIRST, _GLOBAL_TRANSLATION, _COMPLEX = 1, 3, 2, 5


def write_modes(
    path: Path, found: ModesFile, geometry: Geometry | None = None, unit: str = ""
) -> int:
    """Write the structural modes of a whole record; how many there are.

    Each is a complex eigenvalue ``-zeta w + i w sqrt(1 - zeta^2)`` with its complex shape.

    Parameters
    ----------
    unit
        Of all channels, where they have one.

    Raises
    ------
    RecordError
        Where a mode has no shape, or a channel no place.
    """
    modes = [mode for mode in found.modes or () if mode.kind == "structural"]
    if any(mode.shape is None and len(found.channels) > 1 for mode in modes):
        raise RecordError(
            "A universal file holds shapes, and these modes have none. Identify with --method "
            "modes from channels of one unit, or write .json or .csv."
        )
    geometry = geometry or Geometry()
    places = places_of(found.channels, geometry)
    lines = [*_nodes(geometry), *_lines(geometry)]
    for number, mode in enumerate(modes, start=1):
        lines += _mode(number, mode, found, places, unit)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="ascii", errors="replace")
    return len(modes)


def _dataset(kind: int, lines: Sequence[str]) -> Iterator[str]:
    yield from (f"{-1:6d}", f"{kind:6d}", *lines, f"{-1:6d}")


def _nodes(geometry: Geometry) -> Iterator[str]:
    if geometry.nodes:
        rows: list[str] = []
        for label, point in geometry.nodes.items():
            rows += (
                f"{label:10d}{1:10d}{1:10d}{11:10d}",
                "".join(f"{v:25.16E}" for v in point),
            )
        yield from _dataset(2411, rows)


def _lines(geometry: Geometry) -> Iterator[str]:
    for number, nodes in enumerate(geometry.lines, start=1):
        rows = [f"{number:10d}{len(nodes):10d}{11:10d}", f"line {number}"]
        rows += [
            "".join(f"{node:10d}" for node in nodes[at : at + _NODES_A_LINE])
            for at in range(0, len(nodes), _NODES_A_LINE)
        ]
        yield from _dataset(82, rows)


def _mode(
    number: int, mode: FoundMode, found: ModesFile, places: Sequence[NodeAxis], unit: str
) -> Iterator[str]:
    omega = 2 * math.pi * mode.frequency_hz.value
    zeta = mode.damping_ratio.value
    known = unit_of(unit)
    shape = mode.shape
    values = [1.0 + 0.0j] if shape is None else list(map(complex, shape.re, shape.im))
    pole = -zeta * omega, omega * math.sqrt(max(1.0 - zeta**2, 0.0))
    rows = [
        *_identification(number, mode, found, places),
        _row(_STRUCTURAL, _COMPLEX_FIRST, _GLOBAL_TRANSLATION,
             SPECIFIC[known.quantity] if known else 0, _COMPLEX, 3),
        _row(2, 6, 1, number),
        "".join(f"{value:13.5E}" for value in (*pole, 0.0, 0.0, 0.0, 0.0)),
    ]  # fmt: skip
    for node in sorted({place.node for place in places}):
        parts = [0.0] * 6
        for place, value in zip(places, values, strict=True):
            if place.node == node:
                signed = value if place.axis > 0 else -value
                at = 2 * (abs(place.axis) - 1)
                parts[at : at + 2] = signed.real, signed.imag
        rows += (_row(node), "".join(f"{part:13.5E}" for part in parts))
    yield from _dataset(55, rows)


def _row(*values: int) -> str:
    return "".join(f"{value:10d}" for value in values)


def _identification(
    number: int, mode: FoundMode, found: ModesFile, places: Sequence[NodeAxis]
) -> list[str]:
    names = [
        f"{name}={name_of(place).removeprefix('node ').replace(' ', '')}"
        for name, place in zip(found.channels, places, strict=True)
    ]
    plain = all(_PLAIN.fullmatch(name) for name in found.channels)
    wrapped = _wrapped(names) if plain else []
    if len(wrapped) > _LINES_OF_NAMES:
        wrapped = []
    said = (
        f"slowtime f_sd={mode.frequency_hz.sd:.5e} z_sd={mode.damping_ratio.sd:.5e} "
        f"method={mode.method}"
    )
    head = f"mode {number} of {found.record}: {mode.frequency_hz.value:.6g} Hz"
    lines = [head, said, *wrapped]
    return [line[:_WIDE] for line in (*lines, *["NONE"] * (5 - len(lines)))]


def _wrapped(words: Sequence[str]) -> list[str]:
    lines: list[str] = []
    for word in words:
        if lines and len(lines[-1]) + 1 + len(word) <= _WIDE:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines
