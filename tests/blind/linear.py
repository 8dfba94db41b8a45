"""The linear rig under a piecewise cubic force, exactly: one recursive filter a mode."""

import numpy as np
import scipy.signal as sps
from numpy.typing import ArrayLike, NDArray

from .rig import Rig
from .signals import Signal

Array = NDArray[np.float64]


def linear_motion(
    rig: Rig,
    forces: dict[int, Signal],
    base: Signal | None,
    knots: int,
    start: ArrayLike | None = None,
) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration relative to the base, at the knots [knot, node].

    Parameters
    ----------
    forces
        By index of the node [N].
    base
        Acceleration of the base.
    start
        Displacements, then velocities, at time 0; at rest where not given.
    """
    n = rig.size
    pushes: list[tuple[Signal, Array]] = [
        (signal, np.eye(n)[node] / rig.masses[node]) for node, signal in forces.items()
    ]
    if base is not None:
        pushes.append((base, -np.ones(n)))
    rate_hz = pushes[0][0].rate_hz
    poles, shapes = np.linalg.eig(rig.state_matrix())
    inverse = np.linalg.inv(shapes)
    held = _held(poles, 1.0 / rate_hz)
    state = np.zeros((knots, 2 * n), complex)
    state[0] = inverse @ (np.zeros(2 * n) if start is None else start)
    acceleration = np.zeros((knots, n))
    at = np.arange(knots) / rate_hz
    for signal, share in pushes:
        into = inverse[:, n:] @ share
        state[1:] += (signal.coefficients[: knots - 1] @ held) * into
        acceleration += np.outer(signal.at(at), share)
    for mode, pole in enumerate(poles):
        state[:, mode] = sps.lfilter([1.0], [1.0, -np.exp(pole / rate_hz)], state[:, mode])
    motion = (state @ shapes.T).real
    acceleration += motion @ rig.state_matrix()[n:].T
    return motion[:, :n], motion[:, n:], acceleration


def _held(poles: NDArray[np.complex128], step: float) -> NDArray[np.complex128]:
    r"""Give :math:`\int_0^h e^{\lambda (h - s)} (s / h)^j ds` for j = 3, 2, 1, 0."""
    integrals = [np.expm1(poles * step) / poles]
    for j in (1, 2, 3):
        integrals.append((j / step * integrals[-1] - 1.0) / poles)
    return np.array(integrals[::-1])
