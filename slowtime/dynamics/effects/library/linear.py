"""Linear effects: changed stiffness, damping or mass, missing springs, hidden oscillators."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects.kind import (
    Hidden,
    Kind,
    Motion,
    Parameter,
    Shape,
    Square,
    Values,
)

from .parameter_grids import lines_hz

_NONE = np.zeros((1, 1))
_TIE = np.array([[1.0, -1.0], [-1.0, 1.0]])

RINGS = 0.3
"""Damping ratio up to which a hidden mass swings by itself: beyond that it dies within a
period, and does what any branch does that gives way in time. Den Hartog's absorbers have 0.27
at most, up to a hidden mass of a quarter of the node's."""

SAME = 0.1
"""Relative difference of two frequencies about which one looks at the same ones."""

LIGHT, ABOVE, DAMPED = 0.03, 1.3, 0.03
"""To begin with: hidden mass, beside the node's; its frequency, beside a mode's; its damping
ratio."""


def damped(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of damping `p` that is added [N s/m]."""
    return _NONE, np.array([[p[0]]]), _NONE


def softened(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of stiffness `p` that is lost [N/m]."""
    return _NONE, _NONE, np.array([[-p[0]]])


def stiffened(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of stiffness `p` that is added [N/m]."""
    return _NONE, _NONE, np.array([[p[0]]])


def turned(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of a gyroscopic coupling `p` of two coordinates [N s/m], over both."""
    return np.zeros((2, 2)), np.array([[0.0, p[0]], [-p[0], 0.0]]), np.zeros((2, 2))


def laden(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of mass `p` that is added [kg]."""
    return np.array([[p[0]]]), _NONE, _NONE


def ridden(p: Values) -> tuple[Square, Square, Square]:
    """Matrices of a hidden mass on a spring and a damper of its own.

    `p`: mass [kg], natural frequency [Hz], damping of the spring [N s/m]; the matrices are over
    the place and the hidden mass.
    """
    mass, frequency, damping = p
    stiffness = mass * (2 * math.pi * frequency) ** 2
    return np.diag([0.0, mass]), damping * _TIE, stiffness * _TIE


def rings(parameters: Mapping[str, float], motion: Motion) -> bool:
    """Tell whether a hidden mass is underdamped enough to oscillate, not only to lag."""
    critical = 4 * math.pi * parameters["frequency_hz"] * parameters["mass_kg"]
    return parameters["damping_n_s_per_m"] <= RINGS * critical


def resonances(motion: Motion) -> list[Shape]:
    """List frequencies near those at which the place moves most, lightly and heavily damped."""
    # By acceleration and by speed: of many modes, the slow ones show in the latter. Some
    # frequencies lie above them all, where a hidden oscillator acts almost as a mass.
    lines = lines_hz(motion.a, motion.times, 4)
    slow = lines_hz(motion.v, motion.times, 2)
    lines += [one for one in slow if all(abs(one - line) > SAME * line for line in lines)]
    every = [line * beside for line in lines for beside in (0.8, 0.95, 1.05, 1.25)]
    every += [max(lines) * above for above in (1.6, 2.0, 2.6) if lines]
    return [
        {
            "frequency_hz": hertz,
            "damping_n_s_per_m": 4 * math.pi * hertz * ratio,
            "mass_kg": 1.0,
        }
        for hertz in every
        for ratio in (0.01, 0.05)
    ]


def riders(mass_kg: float, frequencies_hz: Sequence[float]) -> list[Shape]:
    """Light oscillators a little above each mode, the fastest first."""
    # One that is too fast acts as a mass at first, and a refit slows it down; one that is too
    # slow has no effect, and a refit does not change it.
    return [
        {
            "mass_kg": LIGHT * mass_kg,
            "frequency_hz": ABOVE * hertz,
            "damping_n_s_per_m": 4 * math.pi * ABOVE * hertz * LIGHT * mass_kg * DAMPED,
        }
        for hertz in sorted(frequencies_hz, reverse=True)
        if hertz > 0 and mass_kg > 0
    ]


KINDS = (
    Kind(
        name="viscous_damping",
        title="Changed damping",
        family="linear damping",
        where="element",
        parameters=(Parameter(name="dc_n_s_per_m", unit="N s/m", meaning="damping added"),),
        equation="Δc v",
        source="",
        sentence="The viscous damping of the element is not that of the model.",
        action=Hidden(matrices=damped),
        strength="dc_n_s_per_m",
        joins=False,
    ),
    Kind(
        name="missing_damper",
        title="Missing damper",
        family="linear damping",
        where="element",
        parameters=(
            Parameter(name="c_n_s_per_m", unit="N s/m", meaning="its damping", low=0.0),
        ),
        equation="c v",
        source="",
        sentence="A viscous damper joins two points that the model does not join.",
        action=Hidden(matrices=damped),
        strength="c_n_s_per_m",
        joins=True,
    ),
    Kind(
        name="stiffness_loss",
        title="Changed stiffness",
        family="linear stiffness",
        where="element",
        parameters=(Parameter(name="dk_n_per_m", unit="N/m", meaning="stiffness lost"),),
        equation="−Δk e",
        source="",
        sentence="The element is softer than the model says, at every amplitude.",
        action=Hidden(matrices=softened),
        strength="dk_n_per_m",
        joins=False,
    ),
    Kind(
        name="missing_spring",
        title="Missing spring",
        family="linear stiffness",
        where="element",
        parameters=(Parameter(name="k_n_per_m", unit="N/m", meaning="its stiffness", low=0.0),),
        equation="k e",
        source="",
        sentence="A spring joins two points that the model does not join.",
        action=Hidden(matrices=stiffened),
        strength="k_n_per_m",
        joins=True,
    ),
    Kind(
        name="gyroscopic_coupling",
        title="Gyroscopic coupling",
        family="gyroscopic coupling",
        where="element",
        parameters=(
            Parameter(
                name="g_n_s_per_m",
                unit="N s/m",
                meaning="force on one end per speed of the other",
            ),
        ),
        equation="−g v₂ on the first end, +g v₁ on the second",
        source="Thomson and Tait 1879",
        sentence="A spinning part couples two coordinates, as two directions of a shaft.",
        action=Hidden(matrices=turned, ends=True),
        strength="g_n_s_per_m",
        joins=True,
    ),
    Kind(
        name="added_mass",
        title="Changed mass",
        family="linear mass",
        where="node",
        parameters=(Parameter(name="dm_kg", unit="kg", meaning="mass added"),),
        equation="mass + Δm",
        source="",
        sentence="The node is heavier than the model says; lighter, where it is negative.",
        action=Hidden(matrices=laden),
        strength="dm_kg",
    ),
    Kind(
        name="extra_dof",
        title="Hidden oscillator",
        family="extra degree of freedom",
        where="node",
        parameters=(
            Parameter(name="mass_kg", unit="kg", meaning="hidden mass", low=0.0, nonzero=True),
            Parameter(
                name="frequency_hz",
                unit="Hz",
                meaning="natural frequency of the hidden mass on a node held still",
                low=0.0,
                nonzero=True,
            ),
            Parameter(
                name="damping_n_s_per_m", unit="N s/m", meaning="damping of its spring", low=0.0
            ),
        ),
        equation="hidden oscillator m, k = m (2πf)², c on the node",
        source="Frahm 1909; Ormondroyd and Den Hartog 1928",
        sentence="A mass on a spring is attached to the node, and is not in the model.",
        action=Hidden(matrices=ridden, coordinates=1),
        strength="mass_kg",
        scales=("damping_n_s_per_m",),
        shapes=resonances,
        guesses=riders,
        shown=rings,
    ),
)
