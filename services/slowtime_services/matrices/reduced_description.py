"""A finite-element model → a small description for the twin, `simulate` and `diagnose`.

Motions of sensors, forces and joints are coordinates of their own, so that channels and effects
find them as they find the nodes of a model on a line. Each parameter group is an element.
"""

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import (
    BASE,
    Description,
    Element,
    Input,
    Matrix,
    Node,
    Sensor,
    Spring,
    Tolerance,
)
from slowtime.dynamics.elements import ROTATION, packed
from slowtime.finite_elements.reduction import (
    BasisSettings,
    ReducedModel,
    reduce_to_physical,
    settings_for_band,
    verify,
)
from slowtime_schemas.files.finite_elements import SpatialSensor

from .errors import MatrixFileError
from .matrix_model import MatrixModel

REST = "other parts"
"""Element of all that no parameter scales."""

DAMPING = "damping"
"""Element of the damping."""

UNITS = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}
"""Unit of a sensor whose file says none."""

CLAIMED = Tolerance(stiffness=0.1, damping=0.5, mass=0.0)
"""Relative standard deviations where the file has no `tolerance`: finite-element models miss
measured frequencies by some 5 %, which is 10 % of stiffness; damping is assumed, and masses are
counted."""

MODES = 12
"""Lowest modes that are kept where neither the file nor the user names a band."""

NOTHING = 1e-9
"""Largest entry over that of the whole matrix [1] up to which what no parameter scales is
rounding."""

Rows = dict[str, Float[np.ndarray, " dof"]]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ReducedDescription:
    """A small description, and the reduced model that it was written from.

    Parameters
    ----------
    description
        Nodes, joints and matrices of it.
    model
        The reduced model, its `error` included where it was verified.
    left_out
        Channels of strains, which are no motion of a coordinate.
    """

    description: Description
    model: ReducedModel
    left_out: tuple[str, ...] = ()


def describe_reduced(
    model: MatrixModel,
    settings: BasisSettings | None = None,
    *,
    band_hz: float | None = None,
    trials: int = 0,
) -> ReducedDescription:
    """Reduce a finite-element model to the band of its sensors.

    Parameters
    ----------
    settings
        Of the reduction; the number of modes comes from the band where there is one.
    band_hz
        Upper end of the band; that of the file by default [Hz].
    trials
        Random parameters at which it is verified by full solutions.

    Raises
    ------
    MatrixFileError
        Where a channel has no place in a reduced model, or the file contradicts itself.
    """
    rows, loads, names = _motions(model)
    size = model.matrices.size
    if settings is None:
        settings = BasisSettings(modes=min(MODES, size), coordinates=min(60, max(size, 1)))
    band = band_hz if band_hz is not None else model.file.band_hz
    try:
        if band is not None:
            settings = settings_for_band(model.matrices, band, settings)
        reduced = reduce_to_physical(
            model.matrices,
            np.array(list(rows.values())).reshape(len(rows), model.sensors.shape[1]),
            np.array(loads).reshape(len(loads), model.sensors.shape[1]),
            settings,
        )
        if trials:
            reduced = verify(
                model.matrices,
                reduced,
                modes=min(settings.modes, reduced.size),
                span=settings.span,
                trials=trials,
                seed=settings.seed + 1,
            )
    except ValueError as error:
        raise MatrixFileError(str(error)) from error
    return ReducedDescription(
        description=_description(model, reduced, tuple(rows), names),
        model=reduced,
        left_out=tuple(name for name in model.channels if name not in names),
    )


def _motions(
    model: MatrixModel,
) -> tuple[Rows, list[Float[np.ndarray, " dof"]], dict[str, str]]:
    """Rows of the motions to keep by coordinate, rows of loads, coordinate of each sensor."""
    dofs, file = model.matrices.dofs, model.file
    rows, loads, names = Rows(), list[Float[np.ndarray, " dof"]](), dict[str, str]()
    if dofs is None:
        raise MatrixFileError("`sensors` need `dofs`. Give the file that says what rows are.")
    for sensor, row in zip(file.sensors, model.sensors, strict=True):
        if sensor.quantity == "strain":
            continue
        names[sensor.channel] = _coordinate(sensor)
        rows[names[sensor.channel]] = row
    ends = [(one.node, one.direction) for one in file.inputs if one.node is not None]
    ends += [(node, joint.direction) for joint in file.joints for node in joint.between]
    for node, direction in ends:
        if node == BASE:
            continue
        try:
            row = dofs.row(node, {direction: 1.0})
        except ValueError as error:
            raise MatrixFileError(f"`inputs` and `joints`: {error}") from error
        rows[f"{node} {direction}"] = row
        loads.append(row)
    if not rows:
        raise MatrixFileError("No sensors, inputs and joints are named. Add `sensors`.")
    return rows, loads, names


def _coordinate(sensor: SpatialSensor) -> str:
    return f"{sensor.node} {sensor.direction}" if sensor.direction else sensor.channel


def _description(
    model: MatrixModel, reduced: ReducedModel, kept: tuple[str, ...], names: Mapping[str, str]
) -> Description:
    file = model.file
    count = reduced.size - len(kept)
    inner = tuple(f"q{k + 1}" for k in range(count))
    nodes = [Node(id=name, kind="beam", held=("rotation",)) for name in kept]
    # A generalized coordinate is written as the turning of a node that is held in place.
    nodes += [Node(id=name, kind="beam", held=("translation",)) for name in inner]
    coordinates = (*kept, *(name + ROTATION for name in inner))
    carried = model.base_direction
    return Description(
        name=model.name,
        nodes=tuple(nodes),
        elements=(*_matrices(model, reduced, coordinates), *_joints(model)),
        effects=tuple(effect.model_dump() for effect in file.effects),
        inputs=tuple(
            Input(
                channel=one.channel,
                kind=one.kind,
                unit=one.unit,
                node=None if one.node is None else f"{one.node} {one.direction}",
                hold=one.hold,
            )
            for one in file.inputs
        ),
        sensors=tuple(
            Sensor(
                channel=one.channel,
                quantity=one.quantity,  # type: ignore[arg-type]  # strains were refused
                node=names[one.channel],
                unit=one.unit or UNITS[one.quantity],
                noise_sd=one.noise_sd,
                frame=_frame(one, row, model, carried),
            )
            for one, row in zip(file.sensors, model.sensors, strict=True)
            if one.channel in names
        ),
        tolerance=CLAIMED
        if file.tolerance is None
        else Tolerance(**file.tolerance.model_dump()),
    )


def _frame(
    sensor: SpatialSensor, row: np.ndarray, model: MatrixModel, carried: str | None
) -> Literal["absolute", "relative_to_base"]:
    """Whether the motion of the base adds to what a sensor measures."""
    if carried is None:
        return "absolute"
    share = float(row @ model.translation(carried))
    if abs(share) < NOTHING:
        return "relative_to_base"
    if abs(share - 1.0) < NOTHING:
        return "absolute"
    raise MatrixFileError(
        f"Sensor {sensor.channel!r} sees {share:.3g} of the motion of the base along "
        f"{carried}. Allowed are sensors along it or across it; turn the channels first."
    )


def _matrices(
    model: MatrixModel, reduced: ReducedModel, coordinates: tuple[str, ...]
) -> list[Element]:
    stiffness = reduced.stiffness - reduced.stiffness_parts.sum(axis=0)
    mass = reduced.mass - reduced.mass_parts.sum(axis=0)
    parts = list(zip(reduced.names, reduced.stiffness_parts, reduced.mass_parts, strict=True))
    rest = (
        _cleared(stiffness, np.abs(reduced.stiffness).max()),
        _cleared(mass, np.abs(reduced.mass).max()),
    )
    found: list[Element] = []
    taken = {DAMPING, *(joint.id for joint in model.file.joints)}
    for name, k, m in [(REST, *rest), *parts]:
        if name in taken:
            raise MatrixFileError(
                f"A parameter is called {name!r}, as a joint or another part is. Rename it."
            )
        taken.add(name)
        own, weight = coordinates, m
        if name == REST and model.base_direction is not None:
            own = (*coordinates, BASE)
            k, weight = np.pad(k, ((0, 1), (0, 1))), _with_base(model, reduced, m)
        if k.any() or weight.any():
            found.append(
                Matrix(
                    id=name,
                    coordinates=own,
                    stiffness_terms=packed(k),
                    mass_terms=packed(weight),
                )
            )
    damping = _damping(model, reduced)
    if damping.any():
        found.append(Matrix(id=DAMPING, coordinates=coordinates, damping_terms=packed(damping)))
    return found


def _cleared(matrix: np.ndarray, largest: float) -> np.ndarray:
    """Nothing, where a matrix is rounding beside the whole one."""
    return matrix if np.abs(matrix).max() > NOTHING * largest else np.zeros_like(matrix)


def _with_base(
    model: MatrixModel, reduced: ReducedModel, mass: np.ndarray
) -> Float[np.ndarray, "all all"]:
    """Mass over the coordinates and the base, so that a motion of the base loads all of them.

    The description carries the physical coordinates along with the base, and the others not;
    the column of the base is the rest of the load, at zero parameters.
    """
    assert model.base_load is not None
    carried = np.zeros(reduced.size)
    carried[: reduced.interface] = 1.0
    load = reduced.basis.T @ model.base_load
    whole = np.pad(mass, ((0, 1), (0, 1)))
    whole[:-1, -1] = whole[-1, :-1] = load - reduced.mass @ carried
    return whole


def _damping(
    model: MatrixModel, reduced: ReducedModel
) -> Float[np.ndarray, "coordinate coordinate"]:
    """Damping of the file, or one ratio for all modes that the model has."""
    if reduced.damping is not None:
        return reduced.damping
    modes = reduced.modes(np.zeros(len(reduced.names)), reduced.size)
    omega = np.sqrt(np.maximum(modes.eigenvalue, 0.0))
    weighed = reduced.mass @ modes.shapes
    damping = (weighed * (2.0 * model.file.damping_ratio * omega)) @ weighed.T
    return np.asarray(0.5 * (damping + damping.T))


def _joints(model: MatrixModel) -> list[Element]:
    found: list[Element] = []
    for joint in model.file.joints:
        first, second = (
            BASE if node == BASE else f"{node} {joint.direction}" for node in joint.between
        )
        found.append(
            Spring(
                id=joint.id,
                between=(first, second),
                stiffness_n_per_m=joint.stiffness_n_per_m,
                damping_n_s_per_m=joint.damping_n_s_per_m,
            )
        )
    return found
