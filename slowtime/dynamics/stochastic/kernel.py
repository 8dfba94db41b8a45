r"""Compiled time stepping of springs with nonlinear laws, many motions at once.

A row of `values` holds the stiffnesses of the springs, their dampings, the masses of the nodes,
and the parameters of laws, in this order. A row of `laws` is (address, 0 on an element or 1 on
a node, which one, first parameter in `values`).

Several functions share these parameters:

- `ends`: nodes that each element joins; -1 stands for the base.
- `laws`: laws of force, as the module describes.
- `values`: stiffnesses, dampings, masses and parameters of laws, in SI units.
- `t`: campaign time [s].
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from slowtime.dynamics.effects.compilation import call_law, compiled

Rows = Float[np.ndarray, "row _"]
Vector = Float[np.ndarray, " _"]
ROOM = 12
"""Vectors of one number per node that a step works in."""


@compiled
def stretch(x: Vector, first: int, second: int) -> float:
    """Elongation of an element between two nodes [m], or its rate [m/s]; -1 is the base."""
    begin = x[first] if first >= 0 else 0.0
    end = x[second] if second >= 0 else 0.0
    return float(end - begin)


@compiled
def pull(out: Vector, first: int, second: int, force: float) -> None:
    """Add a force that resists elongation to the nodes of an element."""
    if first >= 0:
        out[first] += force
    if second >= 0:
        out[second] -= force


@compiled
def accelerate(
    ends: Int[np.ndarray, "element 2"],
    laws: Int[np.ndarray, "law 4"],
    values: Vector,
    x: Vector,
    v: Vector,
    t: float,
    force: Vector,
    out: Vector,
) -> None:
    """Compute the acceleration of each node."""
    count, nodes = len(ends), len(x)
    own = values.ctypes.data
    for i in range(nodes):
        out[i] = force[i]
    for e in range(count):
        a, b = ends[e, 0], ends[e, 1]
        pull(out, a, b, values[e] * stretch(x, a, b) + values[count + e] * stretch(v, a, b))
    for k in range(len(laws)):
        place, p = laws[k, 2], own + 8 * laws[k, 3]
        if laws[k, 1] == 0:
            a, b = ends[place, 0], ends[place, 1]
            pull(out, a, b, call_law(laws[k, 0], stretch(x, a, b), stretch(v, a, b), t, own, p))
        else:
            out[place] += call_law(laws[k, 0], x[place], v[place], t, own, p)
    for i in range(nodes):
        out[i] /= values[2 * count + i]


@compiled
def runge_kutta(
    ends: Int[np.ndarray, "element 2"],
    laws: Int[np.ndarray, "law 4"],
    values: Rows,
    states: Rows,
    first: Rows,
    last: Rows,
    t: float,
    h: float,
    substeps: int,
    room: Float[np.ndarray, "vector node"],
) -> None:
    """Advance every row by h without noise; the force is linear from `first` to `last`.

    Each row of forces serves as many rows of states in turn as there are more of them.
    """
    nodes = first.shape[1]
    share = len(states) // len(first)
    d = h / substeps
    for row in range(len(states)):
        group = row // share
        q = states[row]
        for s in range(substeps):
            for i in range(nodes):
                room[0, i], room[1, i] = q[i], q[nodes + i]
                room[2, i] = room[3, i] = 0.0
            for stage in range(4):
                part = (s + (stage + 1) // 2 / 2.0) / substeps
                for i in range(nodes):
                    room[6, i] = first[group, i] + part * (last[group, i] - first[group, i])
                accelerate(
                    ends, laws, values[row], room[0], room[1], t + part * h, room[6], room[4]
                )
                weight = (1.0, 2.0, 2.0, 1.0)[stage] / 6.0
                reach = (0.5, 0.5, 1.0, 0.0)[stage] * d
                for i in range(nodes):
                    speed = room[1, i]
                    room[2, i] += weight * speed
                    room[3, i] += weight * room[4, i]
                    room[0, i] = q[i] + reach * speed
                    room[1, i] = q[nodes + i] + reach * room[4, i]
            for i in range(nodes):
                q[i] += d * room[2, i]
                q[nodes + i] += d * room[3, i]


@compiled
def bend(
    ends: Int[np.ndarray, "element 2"],
    laws: Int[np.ndarray, "law 4"],
    values: Vector,
    x: Vector,
    v: Vector,
    t: float,
    b: Vector,
    h: float,
    out: Vector,
) -> None:
    """Compute second derivatives of accelerations to velocities, along the noise.

    Along the noise `b` of each node's velocity [m/s^(3/2)]; a rate of the velocity [m/s^3].
    """
    own = values.ctypes.data
    for i in range(len(x)):
        out[i] = 0.0
    for k in range(len(laws)):
        place, p, law = laws[k, 2], own + 8 * laws[k, 3], laws[k, 0]
        if laws[k, 1] == 0:
            first, second = ends[place, 0], ends[place, 1]
            e, speed = stretch(x, first, second), stretch(v, first, second)
            size = b[first] * b[first] if first >= 0 else 0.0
            size += b[second] * b[second] if second >= 0 else 0.0
        else:
            e, speed, size = x[place], v[place], b[place] * b[place]
        d = (h * size) ** 0.5
        above, below = (
            call_law(law, e, speed + d, t, own, p),
            call_law(law, e, speed - d, t, own, p),
        )
        second_order = (above + below - 2.0 * call_law(law, e, speed, t, own, p)) / h
        if laws[k, 1] == 0:
            pull(out, first, second, second_order)
        else:
            out[place] += second_order
    for i in range(len(x)):
        out[i] /= values[2 * len(ends) + i]


@compiled
def ito_taylor(
    ends: Int[np.ndarray, "element 2"],
    laws: Int[np.ndarray, "law 4"],
    values: Rows,
    states: Rows,
    first: Rows,
    last: Rows,
    t: float,
    h: float,
    added: Vector,
    multiplied: Vector,
    normal: Float[np.ndarray, "2 row node"],
    room: Float[np.ndarray, "vector node"],
) -> None:
    """Advance every row by h with noise, by the scheme of strong order 1.5; see `paths`.

    `added` is the square root of the density of the white force on each node [N s^(1/2)],
    `multiplied` the same per metre of the node's displacement [N s^(1/2)/m]. There are two
    standard normal numbers for each row and node.
    """
    nodes, count = first.shape[1], len(ends)
    share = len(states) // len(first)
    a, b, up, down = room[0], room[1], room[2], room[3]
    x_up, v_up, x_down, v_down = room[4], room[5], room[6], room[7]
    kick, along, bent = room[8], room[9], room[10]
    tiny = 0.01 * h
    for row in range(len(states)):
        force, own = first[row // share], values[row]
        x, v = states[row, :nodes], states[row, nodes:]
        accelerate(ends, laws, own, x, v, t, force, a)
        for i in range(nodes):
            b[i] = (added[i] + multiplied[i] * x[i]) / own[2 * count + i]
            kick[i] = 0.5 * h**1.5 * (normal[0, row, i] + normal[1, row, i] / 3.0**0.5)
            # The derivative along dZ is linear in it, so any length of it serves.
            v_up[i] = v[i] + b[i] * kick[i] / h
            v_down[i] = v[i] - b[i] * kick[i] / h
        accelerate(ends, laws, own, x, v_up, t, force, up)
        accelerate(ends, laws, own, x, v_down, t, force, down)
        for i in range(nodes):
            along[i] = 0.5 * h * (up[i] - down[i])
            x_up[i], x_down[i] = x[i] + tiny * v[i], x[i] - tiny * v[i]
            v_up[i], v_down[i] = v[i] + tiny * a[i], v[i] - tiny * a[i]
        accelerate(ends, laws, own, x_up, v_up, t + tiny, force, up)
        accelerate(ends, laws, own, x_down, v_down, t - tiny, force, down)
        bend(ends, laws, own, x, v, t, b, h, bent)
        for i in range(nodes):
            mass = own[2 * count + i]
            d_w = h**0.5 * normal[0, row, i]
            pushed = (last[row // share, i] - force[i]) / (h * mass)
            flow = (up[i] - down[i]) / (2.0 * tiny) + pushed + 0.5 * bent[i]
            sway = multiplied[i] * v[i] / mass * (d_w * h - kick[i])
            states[row, i] += v[i] * h + 0.5 * a[i] * h * h + b[i] * kick[i]
            room[11, i] = a[i] * h + b[i] * d_w + along[i] + 0.5 * flow * h * h + sway
        for i in range(nodes):
            states[row, nodes + i] += room[11, i]


def room_for(nodes: int) -> Any:
    """Working space of a step."""
    return np.zeros((ROOM, nodes))
