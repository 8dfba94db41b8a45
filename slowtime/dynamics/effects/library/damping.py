"""Nonlinear dampers: drag, other powers of speed, and negative damping."""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, levels


def drag(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of drag, which grows with the square of speed [N].

    `p`: coefficient of drag [N s^2/m^2].
    """
    return float(p[0] * abs(v) * v)


def van_der_pol(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of damping that is negative at small elongations and positive at large ones.

    `p`: negative damping at rest [N s/m]; elongation from which damping is positive [m].
    """
    ratio = e / p[1]
    return float(p[0] * (ratio * ratio - 1.0) * v)


def power_law(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force that grows with a power of speed, against it [N]."""
    ratio = abs(v) / p[1]
    return float(math.copysign(p[0] * ratio ** p[2], v)) if ratio > 0.0 else 0.0


def cubic_damping(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force that grows with the third power of speed, against it [N]."""
    return float(p[0] * v * v * v)


def rayleigh(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force that feeds slow motion and brakes fast [N]."""
    ratio = v / p[1]
    return float(p[0] * (ratio * ratio - 1.0) * v)


def positional(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of damping that grows with the square of the elongation [N]."""
    return float(p[0] * e * e * v)


def powers(motion: Motion) -> list[Shape]:
    """Powers of speed from friction to beyond drag, at a high speed of the motion."""
    return [
        {"v0_m_per_s": fast, "power": power}
        for fast in levels(motion.v, 0.9)
        for power in (0.3, 0.6, 1.4, 2.5, 3.5)
    ]


def braked_speeds(motion: Motion) -> list[Shape]:
    """Speeds at which damping may change its sign."""
    top = levels(motion.v, 0.98)
    return each("v0_m_per_s", [share * one for one in top for share in (0.25, 0.5, 0.8, 1.2)])


def amplitudes(motion: Motion) -> list[Shape]:
    """List elongations at which damping may change its sign."""
    top = levels(motion.e, 0.98)
    return each("e0_m", [share * level for level in top for share in (0.25, 0.5, 0.8, 1.2)])


KINDS = (
    Kind(
        name="quadratic_damping",
        title="Drag",
        family="drag",
        where="element",
        parameters=(
            Parameter(
                name="c2_n_s2_per_m2", unit="N s^2/m^2", meaning="coefficient of drag", low=0.0
            ),
        ),
        equation="c2 |v| v",
        source="Morison et al. 1950",
        sentence="Drag as of a fluid: damping that grows with speed.",
        action=Law(force=drag),
        strength="c2_n_s2_per_m2",
    ),
    Kind(
        name="van_der_pol",
        title="Negative damping",
        family="negative damping",
        where="element",
        parameters=(
            Parameter(name="cn_n_s_per_m", unit="N s/m", meaning="negative damping", low=0.0),
            Parameter(
                name="e0_m",
                unit="m",
                meaning="elongation beyond which damping is positive",
                low=0.0,
                nonzero=True,
            ),
        ),
        equation="cn (−1 + (e/e0)²) v",
        source="van der Pol 1926",
        sentence="Damping is negative at small amplitude, positive at large: self-excited.",
        action=Law(force=van_der_pol),
        strength="cn_n_s_per_m",
        shapes=amplitudes,
    ),
    Kind(
        name="power_law_damping",
        title="Damping by a power of speed",
        family="drag",
        where="element",
        parameters=(
            Parameter(name="force_n", unit="N", meaning="force at the speed v0", low=0.0),
            Parameter(
                name="v0_m_per_s",
                unit="m/s",
                meaning="speed that the force is given at",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
            Parameter(name="power", unit="", meaning="power of speed", low=0.05, high=5.0),
        ),
        equation="F0 |v/v0|ᵃ sign(v)",
        source="Soong and Constantinou 1994 (fluid dampers)",
        sentence="The damping force grows with a power of speed that is fitted.",
        action=Law(force=power_law),
        strength="force_n",
        shapes=powers,
        contains=("quadratic_damping", "viscous_damping", "cubic_damping"),
        similar=("coulomb",),
    ),
    Kind(
        name="cubic_damping",
        title="Cubic damping",
        family="drag",
        where="element",
        parameters=(
            Parameter(
                name="c3_n_s3_per_m3", unit="N s^3/m^3", meaning="cubic damping", low=0.0
            ),
        ),
        equation="c3 v³",
        source="Nayfeh and Mook 1979",
        sentence="Damping that grows with the third power of speed.",
        action=Law(force=cubic_damping),
        strength="c3_n_s3_per_m3",
        similar=("viscous_damping",),
    ),
    Kind(
        name="positional_damping",
        title="Damping that depends on elongation",
        family="damping by elongation",
        where="element",
        parameters=(
            Parameter(
                name="c2_n_s_per_m3", unit="N s/m^3", meaning="damping per squared elongation"
            ),
        ),
        equation="c2 e² v",
        source="Nayfeh and Mook 1979",
        sentence="Damping grows, or falls, with the square of the elongation.",
        action=Law(force=positional),
        strength="c2_n_s_per_m3",
        similar=("viscous_damping",),
    ),
    Kind(
        name="rayleigh_damping",
        title="Negative damping at low speed",
        family="negative damping",
        where="element",
        parameters=(
            Parameter(name="cn_n_s_per_m", unit="N s/m", meaning="negative damping", low=0.0),
            Parameter(
                name="v0_m_per_s",
                unit="m/s",
                meaning="speed beyond which damping is positive",
                low=0.0,
                nonzero=True,
            ),
        ),
        equation="cn (−1 + (v/v0)²) v",
        source="Rayleigh 1883; not the proportional damping that is also named after him",
        sentence="Damping is negative at low speed and positive at high: self-excited.",
        action=Law(force=rayleigh),
        strength="cn_n_s_per_m",
        shapes=braked_speeds,
        contains=("cubic_damping",),
    ),
)
