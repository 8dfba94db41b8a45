"""Forces independent of the motion: a tone at a node, base motion."""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape, Unmeasured

from .parameter_grids import each, lines_hz


def tone(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Harmonic force [N].

    `p`: amplitude [N], frequency [Hz], phase at campaign time 0 [rad].
    """
    return float(p[0] * math.sin(2.0 * math.pi * p[1] * t + p[2]))


def tones(motion: Motion) -> list[Shape]:
    """List frequencies at which the place moves."""
    return each("frequency_hz", lines_hz(motion.a, motion.times, 6), phase_rad=0.0)


KINDS = (
    Kind(
        name="harmonic_force",
        title="Unmeasured tone",
        family="tonal input",
        where="node",
        parameters=(
            Parameter(name="amplitude_n", unit="N", meaning="amplitude", low=0.0),
            Parameter(
                name="frequency_hz", unit="Hz", meaning="its frequency", low=0.0, nonzero=True
            ),
            Parameter(name="phase_rad", unit="rad", meaning="its phase at campaign time 0"),
        ),
        equation="F0 sin(2π f t + φ)",
        source="",
        sentence="An unmeasured force of one frequency acts on the node.",
        action=Law(force=tone),
        strength="amplitude_n",
        quadrature="phase_rad",
        shapes=tones,
    ),
    Kind(
        name="base_motion",
        title="Unmeasured motion of the base",
        family="random input",
        where="base",
        parameters=(
            Parameter(name="rms_m_per_s2", unit="m/s^2", meaning="its size, r.m.s.", low=0.0),
        ),
        equation="an acceleration of the base that nobody measured",
        source="",
        sentence="The base moves, and its motion was not measured.",
        action=Unmeasured(),
        strength="rms_m_per_s2",
    ),
)
