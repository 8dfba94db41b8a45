"""A wireframe with mode shapes of a model and of a measurement → JSON for the viewer."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Num

from slowtime.identification.mode_shapes.criteria import mac, real_shape

from .wireframe import SensorMark, Wireframe

DIGITS = 4
"""Decimals of displacements of which the largest is 1: less than a pixel."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModelShapes:
    """Modes of a model at the drawn nodes.

    Parameters
    ----------
    frequency_hz
        Natural frequencies [Hz].
    displacements
        Displacement of each node along x, y and z, of any scale.
    """

    frequency_hz: Float[np.ndarray, " mode"]
    displacements: Float[np.ndarray, "mode node 3"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class MeasuredShapes:
    """Measured modes.

    Parameters
    ----------
    channels
        Names of the components.
    frequency_hz, frequency_sd_hz
        Natural frequencies and their standard deviations [Hz].
    shapes
        Complex components of displacements, of any scale; NaN for modes without a shape.
    model_mode
        Of each, which mode of the model it is, counted from 0; None for none.
    """

    channels: tuple[str, ...]
    frequency_hz: Float[np.ndarray, " mode"]
    frequency_sd_hz: Float[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "mode channel"]
    model_mode: tuple[int | None, ...]


def scene_of(
    wire: Wireframe,
    model: ModelShapes | None = None,
    measured: MeasuredShapes | None = None,
    *,
    changed: Sequence[str] = (),
) -> dict[str, Any]:
    """Put modes of a model and measured ones together, mode by mode.

    A measured component moves its node along the line of its sensor; across it, where nothing
    was measured, the node moves as in the model, or not at all without one. A measured shape
    is scaled by the modal scale factor of the components that both have.

    Parameters
    ----------
    wire
        The wireframe.
    model
        Modes of a model.
    measured
        Measured modes.
    changed
        Groups of the wireframe that are said to have changed.

    Returns
    -------
    Nodes, lines, sensors and modes in ascending frequency, as JSON has them.
    """
    modes = []
    taken: dict[int, list[int | None]] = {}
    alone: list[int] = []
    if measured is not None:
        for row, number in enumerate(measured.model_mode):
            known = (
                model is not None and number is not None and number < len(model.frequency_hz)
            )
            if known and number is not None:
                taken.setdefault(number, []).append(row)
            else:
                alone.append(row)
    for number in range(0 if model is None else len(model.frequency_hz)):
        assert model is not None
        rows = taken.get(number) or [None]
        modes += [_mode(wire, (number, model), (row, measured)) for row in rows]
    modes += [_mode(wire, None, (row, measured)) for row in alone]
    modes.sort(key=lambda mode: mode["measured_hz"] or mode["model_hz"])
    names = sorted(set(wire.groups) - {""})
    return {
        "nodes": wire.places.round(6).tolist(),
        "names": list(wire.names),
        "lines": wire.lines.tolist(),
        "groups": names,
        "group_of_line": [names.index(group) if group else None for group in wire.groups],
        "changed": [name for name in changed if name in names],
        "sensors": [
            {"channel": one.channel, "node": one.node, "along": list(one.along)}
            for one in wire.sensors
        ],
        "modes": modes,
    }


def _mode(
    wire: Wireframe,
    of_model: tuple[int, ModelShapes] | None,
    of_measured: tuple[int | None, MeasuredShapes | None],
) -> dict[str, Any]:
    """One entry: frequencies, MAC, and displacements of which the largest is 1."""
    row, measured = of_measured
    number, moved = None, None
    entry: dict[str, Any] = {
        "model_mode": None, "model_hz": None, "measured_hz": None, "measured_sd_hz": None,
        "mac": None, "wire": None, "points": None,
    }  # fmt: skip
    if of_model is not None:
        number, model = of_model
        moved = _unit(model.displacements[number])
        entry |= {
            "model_mode": number,
            "model_hz": float(model.frequency_hz[number]),
            "wire": _parts(moved),
        }
    if measured is None or row is None:
        return entry
    entry |= {
        "measured_hz": float(measured.frequency_hz[row]),
        "measured_sd_hz": float(measured.frequency_sd_hz[row]),
    }
    marks = [one for one in wire.sensors if one.channel in measured.channels]
    columns = [measured.channels.index(one.channel) for one in marks]
    shape = measured.shapes[row, columns]
    if not marks or not np.isfinite(shape).all() or not np.abs(shape).any():
        return entry
    if moved is None:
        shape = _turned(shape)
        nodes, points = _points(marks, shape, np.zeros((len(wire.names), 3)))
        whole = np.zeros((len(wire.names), 3), dtype=complex)
        whole[nodes] = points
        return entry | {"wire": _parts(_unit(whole)), "points": None}
    seen = np.array([moved[one.node] @ np.array(one.along) for one in marks])
    entry["mac"] = mac(shape, seen.astype(complex)) if len(marks) > 1 and seen.any() else None
    nodes, points = _points(marks, _scaled(shape, seen), moved)
    return entry | {"points": {"nodes": nodes, **_parts(points)}}


def _unit(displacements: Num[np.ndarray, "node 3"]) -> Num[np.ndarray, "node 3"]:
    """Scale so that the node that moves farthest moves by 1."""
    size = np.linalg.norm(displacements, axis=1).max(initial=0.0)
    return displacements / size if size > 0.0 else displacements


def _turned(shape: Complex[np.ndarray, " channel"]) -> Complex[np.ndarray, " channel"]:
    """Turn a shape so that its real part is as large as it can be."""
    real = real_shape(shape)
    factor = np.vdot(shape, real)
    return shape * (factor / abs(factor)) if abs(factor) > 0.0 else shape


def _scaled(
    shape: Complex[np.ndarray, " channel"], seen: Float[np.ndarray, " channel"]
) -> Complex[np.ndarray, " channel"]:
    """Scale a measured shape to the model's by least squares (modal scale factor).

    Of shapes that are orthogonal, to the same norm instead: the factor would be zero.
    """
    factor = np.vdot(shape, seen) / np.vdot(shape, shape).real
    norm = np.linalg.norm(seen) / np.linalg.norm(shape)
    if norm > 0.0 and abs(factor) < 0.5 * norm:
        factor = norm * (factor / abs(factor) if abs(factor) > 0.0 else 1.0)
    return np.asarray(shape * (factor if norm > 0.0 else 1.0 / np.abs(shape).max()))


def _points(
    marks: Sequence[SensorMark],
    values: Complex[np.ndarray, " channel"],
    moved: Float[np.ndarray, "node 3"],
) -> tuple[list[int], Complex[np.ndarray, "point 3"]]:
    """Displacement of every node with sensors: measured along their lines, else as moved."""
    nodes = sorted({one.node for one in marks})
    points = np.zeros((len(nodes), 3), dtype=complex)
    for k, node in enumerate(nodes):
        own = [i for i, one in enumerate(marks) if one.node == node]
        lines = np.array([marks[i].along for i in own])
        misses = values[own] - lines @ moved[node]
        points[k] = moved[node] + np.linalg.pinv(lines) @ misses
    return nodes, points


def _parts(displacements: Num[np.ndarray, "node 3"]) -> dict[str, Any]:
    """Real and imaginary parts; None where there is no imaginary one."""
    imaginary = displacements.imag.round(DIGITS)
    return {
        "re": displacements.real.round(DIGITS).tolist(),
        "im": imaginary.tolist() if imaginary.any() else None,
    }
