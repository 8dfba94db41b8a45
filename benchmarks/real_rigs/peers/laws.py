"""Laws that a regression may find: sums of terms of the elements' motion."""

import dataclasses

import numpy as np

from benchmarks.real_rigs.pieces import Array

from .task import Rig

NAMES = (
    "1",
    "e{0}",
    "v{0}",
    "e{0}^2",
    "e{0}^3",
    "|v{0}|v{0}",
    "sign(v{0})",
    "e{0}^2*v{0}",
    "sin(e{0})",
)
"""Elongation e and rate v of an element, from 1."""
LIBRARIES = {
    "polynomial": frozenset(NAMES) - {"sin(e{0})"},
    "sine": frozenset({"1", "v{0}", "|v{0}|v{0}", "sign(v{0})", "sin(e{0})"}),
}
"""Terms by library; the sine is for angles."""


@dataclasses.dataclass(frozen=True, eq=False)
class States:
    """Displacement, velocity and acceleration [time, node], relative to the base."""

    x: Array
    v: Array
    a: Array


def terms_at(e: Array, v: Array, slip: Array) -> Array:
    """Return every term of every element [..., element, term]."""
    columns = (
        np.ones_like(e),
        e,
        v,
        e**2,
        e**3,
        np.abs(v) * v,
        np.tanh(v / slip),
        e**2 * v,
        np.sin(e),
    )
    return np.stack(columns, axis=-1)


def term_values(states: States, to: Array, slip: Array) -> Array:
    """Return the terms along a motion [time, element, term]."""
    return terms_at(states.x @ to.T, states.v @ to.T, slip)


@dataclasses.dataclass(frozen=True, eq=False)
class PeerLaw:
    """Forces of the elements on the nodes.

    Parameters
    ----------
    coefficients
        Force that is taken off each node by a unit of each term [element, term, node].
    nominal
        1 where the nominal springs and dampers act as well, else 0.
    slip
        Rate of each element at which dry friction turns over.
    gain
        On the measured force.
    """

    coefficients: Array
    nominal: float
    slip: Array
    gain: float = 1.0

    def force(self, states: States, rig: Rig) -> Array:
        """Return the force along a motion [time, node]."""
        values = term_values(states, rig.to, self.slip)
        force = np.einsum("tek,ekn->tn", values, self.coefficients)
        linear = states.x @ rig.to.T * rig.stiffness + states.v @ rig.to.T * rig.damping
        return np.asarray(force + self.nominal * linear @ rig.to)
