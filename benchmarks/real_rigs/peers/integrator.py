"""Runge and Kutta's method for sums of terms, compiled."""

import math

import numba
import numpy as np

LOST = 1e6
"""[m or rad] Displacement at which a run has diverged. Source: a choice, far beyond any rig."""


@numba.njit(cache=True)
def accelerate(laws, rig, force, x, v, out):  # type: ignore[no-untyped-def]
    """Write the acceleration of every node [node]; terms as in `laws.NAMES`."""
    coefficients, nominal, gain, slip = laws
    to, stiffness, damping, masses = rig
    elements, terms, nodes = coefficients.shape
    values = np.empty(terms)
    for n in range(nodes):
        out[n] = gain * force[n]
    for i in range(elements):
        e, rate = 0.0, 0.0
        for n in range(nodes):
            e += to[i, n] * x[n]
            rate += to[i, n] * v[n]
        values[0], values[1], values[2], values[3] = 1.0, e, rate, e * e
        values[4], values[5] = e * e * e, abs(rate) * rate
        values[6], values[7], values[8] = math.tanh(rate / slip[i]), e * e * rate, math.sin(e)
        linear = nominal * (stiffness[i] * e + damping[i] * rate)
        for n in range(nodes):
            out[n] -= linear * to[i, n]
            for k in range(terms):
                out[n] -= coefficients[i, k, n] * values[k]
    for n in range(nodes):
        out[n] /= masses[n]


@numba.njit(cache=True)
def integrate(laws, rig, forces, fine, h, start, rows):  # type: ignore[no-untyped-def]
    """Run one law free.

    Parameters
    ----------
    laws
        Coefficients [element, term, node], share of the nominal model, gain, slip [element].
    rig
        Elongations [element, node], stiffness and damping [element], masses [node].
    forces
        On each node [step, node], straight lines between them.
    fine, h
        Steps a sample, and their length [s].
    start
        Displacements and velocities [state].
    rows
        Samples wanted.

    Returns
    -------
    Displacement, velocity and acceleration [3, row, node]; not a number once it has diverged.
    """
    nodes = len(rig[3])
    found = np.full((3, rows, nodes), np.nan)
    x, v = start[:nodes].copy(), start[nodes:].copy()
    a1, a2, a3, a4 = np.empty(nodes), np.empty(nodes), np.empty(nodes), np.empty(nodes)
    for row in range(rows):
        for step in range(row * fine, (row + 1) * fine):
            middle = 0.5 * (forces[step] + forces[step + 1])
            accelerate(laws, rig, forces[step], x, v, a1)
            if step == row * fine:
                found[0, row], found[1, row], found[2, row] = x, v, a1
            v2 = v + 0.5 * h * a1
            accelerate(laws, rig, middle, x + 0.5 * h * v, v2, a2)
            v3 = v + 0.5 * h * a2
            accelerate(laws, rig, middle, x + 0.5 * h * v2, v3, a3)
            v4 = v + h * a3
            accelerate(laws, rig, forces[step + 1], x + h * v3, v4, a4)
            x = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        for n in range(nodes):
            if not abs(x[n]) < LOST:
                return found
    return found
