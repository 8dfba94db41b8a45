r"""States behind those of a structure: what inputs move, and integrals of measured forces.

Displacement :math:`x_s` of a support against the base is a state, driven by its acceleration.
Elements and effects that end there see it as they see a node; nothing acts back on it:

.. math:: M \ddot q + C \dot q + K q = f - K_s x_s - C_s \dot x_s - M_s \ddot x_s , \qquad
    \ddot x_s = a_s - a_b .

A measured force :math:`r` is the rate of one more state, :math:`\dot J = r`, so that forces are
read, and differentiated to parameters, as accelerations are.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Friction, Kind, Motion, Place, force_along
from slowtime.dynamics.elements import ROTATION

from .parameter_names import Name
from .step_levels import product

NUDGE = 1e-6
"""Relative step of central differences of friction along a prescribed motion."""

Stack = Float[np.ndarray, "slope _ _"]


def law_shares(
    description: Description,
    effects: Sequence[Effect],
    channels: Sequence[tuple[int, int]],
    count: int,
) -> Float[np.ndarray, "gauge channel"]:
    """Share of the force of each law in the reading of each force sensor.

    Zero where a law acts elsewhere; laws at a node act on it from outside.
    """
    measured = [sensor for sensor in description.sensors if sensor.quantity == "force"]
    between = {part.id: part.between for part in description.elements}
    found = np.zeros((len(measured), count))
    for row, sensor in zip(found, measured, strict=True):
        for number, channel in channels:
            place = effects[number].place
            if sensor.element is not None:
                row[channel] = float(place.kind == "element" and place.id == sensor.element)
            elif place.kind == "node":
                row[channel] = -float(place.id == sensor.node)
            else:
                first, second = between[place.id]
                row[channel] = float(second == sensor.node) - float(first == sensor.node)
    return found


def prescribed_friction(
    description: Description, effects: Sequence[Effect], kinds: Sequence[Kind]
) -> tuple[int, ...]:
    """Numbers of effects of dry friction along elements whose ends are both prescribed."""
    # It cannot stop such a motion, and so never sticks: its force follows from the motion
    # alone.
    between = {part.id: part.between for part in description.elements}
    return tuple(
        i
        for i, (effect, kind) in enumerate(zip(effects, kinds, strict=True))
        if isinstance(kind.action, Friction)
        and not set(between.get(effect.place.id, (effect.place.id,))) & set(description.dofs)
    )


def add_prescribed_friction(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    values: Mapping[Name, float],
    motion: Mapping[Place, Motion],
    outputs: Float[np.ndarray, "time sensor"],
    slopes: Float[np.ndarray, "time sensor slope"],
    columns: Mapping[Name, int],
    factors: Float[np.ndarray, " sensor"],
) -> None:
    """Add the force of friction that never sticks to the measured forces, in place.

    Slopes are empty where none are asked for; `columns` gives the column of each free
    parameter, `factors` lead from SI to the unit of each sensor.
    """
    felt = [k for k, one in enumerate(description.sensors) if one.quantity == "force"]
    for i in prescribed_friction(description, effects, kinds) if felt else ():
        shares = law_shares(description, effects, [(i, 0)], 1)[:, 0] * factors[felt]
        along = motion[effects[i].place]
        known = {name: values["effect", i, name] for name in kinds[i].names}
        force = force_along(kinds[i], known, along)
        outputs[:, felt] += np.multiply.outer(force, shares)
        for name in kinds[i].names if slopes.size else ():
            if ("effect", i, name) not in columns:
                continue
            step = NUDGE * (abs(known[name]) or 1.0)
            above, below = (
                force_along(kinds[i], known | {name: known[name] + sign * step}, along)
                for sign in (1, -1)
            )
            slope = np.multiply.outer((above - below) / (2 * step), shares)
            slopes[:, felt, columns["effect", i, name]] += slope


def boundary_rows(
    a: Stack,
    b_u: Stack,
    b_y: Stack,
    whole: Float[np.ndarray, "slope 3 all all"],
    names: Sequence[str],
    against: Float[np.ndarray, "moved input"],
    base: Sequence[bool],
    shares: Float[np.ndarray, "gauge channel"],
) -> None:
    """Write the rows and columns of supports and of measured forces, in place.

    Matrices a, b_u and b_y have the rows of the structure; `whole` is mass, damping and
    stiffness, each followed by its slopes. `against` is the acceleration of each support
    against the base for one unit of each input, `base` whether an input moves the base.
    """
    free, gauges = len(names), len(shares)
    moved = whole.shape[2] - free - 1 - gauges
    at, speed = _places(a.shape[1], moved, gauges)
    a[0, at : at + moved, speed : speed + moved] = np.eye(moved)
    b_u[0, speed : speed + moved] = against
    if not gauges:
        return
    mass, damping, stiffness = (whole[:, k, -gauges:] for k in range(3))
    own, there = slice(0, free), slice(free + 1, free + 1 + moved)
    rows = slice(a.shape[1] - gauges, a.shape[1])
    a[:, rows, :free], a[:, rows, free : 2 * free] = stiffness[:, :, own], damping[:, :, own]
    a[:, rows, at : at + moved] = stiffness[:, :, there]
    a[:, rows, speed : speed + moved] = damping[:, :, there]
    inertia = np.concatenate([mass[:, :, own], mass[:, :, there]], axis=2)
    moving = [*range(free, 2 * free), *range(speed, speed + moved)]
    a[:, rows] += product(inertia, a[:, moving])
    b_u[:, rows] = product(inertia, b_u[:, moving])
    b_y[:, rows] = product(inertia, b_y[:, moving])
    b_y[0, rows] += shares
    carried = np.array([not name.endswith(ROTATION) for name in names], dtype=float)
    rigid = np.concatenate([carried, np.ones(1 + moved), np.zeros(gauges)])
    for column, shaken in enumerate(base):
        if shaken:
            b_u[:, rows, column] += mass @ rigid


def _places(states: int, moved: int, gauges: int) -> tuple[int, int]:
    """First displacement and first velocity of supports among the states."""
    speed = states - gauges - moved
    return speed - moved, speed


def pseudo_static(
    stiffness: Float[np.ndarray, "slope all all"], free: int, moved: int
) -> Float[np.ndarray, "slope free moved"]:
    """Displacements of a structure per displacement of its supports, all at rest; and slopes.

    The matrix is over all coordinates [N/m], followed by its slopes.

    References
    ----------
    .. [1] R. W. Clough and J. Penzien, "Dynamics of Structures" (1993), section 26-4:
       pseudostatic displacements of structures on several supports.
    """
    inner = stiffness[:, :free, :free]
    outer = stiffness[:, :free, free + 1 : free + 1 + moved]
    # Where the supports do not decide it, as of a body on dampers alone, the least
    # displacements.
    inverse = np.linalg.pinv(inner[0], hermitian=True)
    first = -inverse @ outer[0]
    slopes = -inverse @ (outer[1:] + inner[1:] @ first)
    return np.concatenate([first[None], slopes])


def named_rows(
    rows: Float[np.ndarray, "time state"], names: Sequence[str], gauges: int
) -> Mapping[str, Float[np.ndarray, " time"]]:
    """Velocities, or with the rates accelerations, of supports by name."""
    first = rows.shape[1] - gauges - len(names)
    return {name: rows[:, first + k] for k, name in enumerate(names)}
