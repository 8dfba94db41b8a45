"""Force of an effect along a known motion."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from .compilation import call_law, compiled, law_address
from .kind import Friction, Hidden, Kind, Law, Motion, Series, Values


def force_along(kind: Kind, parameters: Mapping[str, float], motion: Motion) -> Series:
    """Force that an effect of known parameters has along a known motion [N].

    On an element it resists elongation, on a node it pushes the node. Internal states start at
    zero; friction slides throughout, and is zero where the speed is. A coupling of two
    coordinates has no force along an elongation.

    Parameters
    ----------
    kind
        Kind of the effect.
    parameters
        Its parameters, by name, in their units.
    motion
        Of the place; of a node, its displacement and velocity against the base, and its
        acceleration in space.

    Returns
    -------
    Force [N].

    Raises
    ------
    ValueError
        For kinds that are no forces: of inputs, sensors, and the base.

    Examples
    --------
    >>> from slowtime.dynamics.effects import catalogue
    >>> e, still = np.array([0.0, 1.0, 2.0]), np.zeros(3)
    >>> seen = Motion(e=e, v=still, a=still, times=np.arange(3.0))
    >>> force_along(catalogue()["cubic_hardening"], {"k3_n_per_m3": 5.0}, seen)
    array([ 0.,  5., 40.])
    """
    values = kind.values(parameters)
    # Not-a-number stands for the end of the record.
    values = np.where(np.isnan(values), motion.times[-1], values)
    if isinstance(kind.action, Friction):
        size = _law(
            np.array([law_address(kind.action.limit)]), motion, np.abs(motion.v), values
        )
        return np.asarray(size * np.sign(motion.v))
    if isinstance(kind.action, Law):
        if kind.action.along is not None:
            return kind.action.along(motion, values)
        laws = [law_address(law) for law in (kind.action.force, *kind.action.rates)]
        return _law(np.array(laws), motion, motion.v, values)
    if isinstance(kind.action, Hidden):
        return _hidden(kind, motion, values)
    raise ValueError(f"{kind.name} sits on the {kind.where}: it is no force along a motion.")


def _law(laws: Int[np.ndarray, " law"], motion: Motion, v: Series, values: Values) -> Series:
    force = np.empty(len(motion.e))
    columns = (motion.e, v, motion.a, motion.times, values)
    e, v, a, times, p = (np.ascontiguousarray(column, dtype=float) for column in columns)
    _loop(laws, e, v, a, times, p, force, np.zeros((4, len(laws))))
    return force


@compiled
def _between(first: float, last: float, leave: float, arrive: float, s: float) -> float:
    """Cubic through two values with their slopes."""
    straight = first + s * (last - first)
    bent = (1 - s) * (leave - last + first) - s * (arrive - last + first)
    return straight + s * (1 - s) * bent


@compiled
def _loop(
    laws: Any,
    e: Series,
    v: Series,
    a: Series,
    times: Series,
    p: Values,
    force: Series,
    room: Any,
) -> None:
    """Evaluate laws at the samples; internal states by Runge and Kutta's fourth-order rule."""
    states = len(laws) - 1
    z, begin, total, slope = room[0], room[1], room[2], room[3]
    for k in range(len(e)):
        force[k] = call_law(laws[0], e[k], v[k], times[k], z.ctypes.data, p.ctypes.data)
        if states == 0 or k + 1 == len(e):
            continue
        h = times[k + 1] - times[k]
        for i in range(states):
            begin[i], total[i] = z[i], 0.0
        for stage in range(4):
            s = (stage + 1) // 2 / 2.0
            place = _between(e[k], e[k + 1], h * v[k], h * v[k + 1], s)
            speed = _between(v[k], v[k + 1], h * a[k], h * a[k + 1], s)
            weight = (1.0, 2.0, 2.0, 1.0)[stage] / 6.0
            for i in range(states):
                slope[i] = call_law(
                    laws[i + 1], place, speed, times[k] + s * h, z.ctypes.data, p.ctypes.data
                )
            reach = (0.5, 0.5, 1.0, 0.0)[stage] * h
            for i in range(states):
                total[i] += weight * slope[i]
                z[i] = begin[i] + reach * slope[i]
        for i in range(states):
            z[i] = begin[i] + h * total[i]


def _hidden(kind: Kind, motion: Motion, values: Values) -> Series:
    assert isinstance(kind.action, Hidden)
    mass, damping, stiffness = kind.action.matrices(values)
    along = np.stack([motion.a, motion.v, motion.e])
    own = np.array([mass[0, 0], damping[0, 0], stiffness[0, 0]])
    if not kind.action.coordinates:
        force = own @ along
        return np.asarray(force if kind.where == "element" else -force)
    inner = [matrix[1:, 1:] for matrix in (mass, damping, stiffness)]
    carried = np.ones(len(mass))
    # Hidden coordinates against the place: what carrying them along takes, drives them.
    drive = [matrix[1:] @ carried for matrix in (mass, damping, stiffness)]
    pushed = -sum(
        np.multiply.outer(series, one) for series, one in zip(along, drive, strict=True)
    )
    rate_hz = (len(motion.times) - 1) / (motion.times[-1] - motion.times[0])
    r, v, a = _ridden(inner, np.asarray(pushed), rate_hz)
    whole = [float(matrix[0] @ carried) for matrix in (mass, damping, stiffness)]
    force = (
        np.array(whole) @ along + a @ mass[0, 1:] + v @ damping[0, 1:] + r @ stiffness[0, 1:]
    )
    return np.asarray(-force)


def _ridden(
    matrices: Sequence[Float[np.ndarray, "own own"]],
    force: Float[np.ndarray, "time own"],
    rate_hz: float,
) -> tuple[Float[np.ndarray, "time own"], ...]:
    """Motion from rest, velocity and acceleration under a force straight between samples."""
    # What `simulate_structure` gives, without modes: there are few coordinates, and many runs.
    size = force.shape[1]
    mass, damping, stiffness = matrices
    flow = np.zeros((4 * size, 4 * size))
    flow[:size, size : 2 * size] = np.eye(size) / rate_hz
    by_force = np.linalg.solve(
        mass, np.concatenate([-stiffness, -damping, np.eye(size)], axis=1)
    )
    flow[size : 2 * size, : 3 * size] = by_force / rate_hz
    flow[2 * size : 3 * size, 3 * size :] = np.eye(size)
    moved = scipy.linalg.expm(flow)[: 2 * size]
    kept, constant, ramp = np.split(moved, [2 * size, 3 * size], axis=1)
    state = np.zeros((len(force), 2 * size))
    come = force[:-1] @ (constant - ramp).T + force[1:] @ ramp.T
    _step_on(np.ascontiguousarray(kept), come, state)
    r, v = state[:, :size], state[:, size:]
    return r, v, np.concatenate([state, force], axis=1) @ by_force.T


@compiled
def _step_on(kept: Any, come: Any, state: Any) -> None:
    """Move a state from sample to sample by what it keeps and what comes."""
    size = len(kept)
    for k in range(len(come)):
        for i in range(size):
            total = come[k, i]
            for j in range(size):
                total += kept[i, j] * state[k, j]
            state[k + 1, i] = total
