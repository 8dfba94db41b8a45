"""Viscoelastic forces: springs in series with dampers, and damping of fractional order."""

import math
from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import lines_hz


def maxwell(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a spring in series with a damper [N]."""
    return float(p[0] * z[0])


def relaxation(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of that spring's elongation [m/s]."""
    return float(v - z[0] / p[1])


def fractional(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of five branches whose stiffness is a power of their frequency [N]."""
    total = 0.0
    for k in range(5):
        total += 10.0 ** (0.5 * p[1] * (k - 2.0)) * z[k]
    return float(p[0] * total)


def branch_0(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the elongation of the branch one decade below the centre [m/s]."""
    return float(v - 0.1 * 2.0 * math.pi * p[2] * z[0])


def branch_1(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the elongation of the branch half a decade below the centre [m/s]."""
    return float(v - math.sqrt(0.1) * 2.0 * math.pi * p[2] * z[1])


def branch_2(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the elongation of the branch at the centre [m/s]."""
    return float(v - 2.0 * math.pi * p[2] * z[2])


def branch_3(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the elongation of the branch half a decade above the centre [m/s]."""
    return float(v - math.sqrt(10.0) * 2.0 * math.pi * p[2] * z[3])


def branch_4(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the elongation of the branch one decade above the centre [m/s]."""
    return float(v - 10.0 * 2.0 * math.pi * p[2] * z[4])


def relaxation_times(motion: Motion) -> list[Shape]:
    """List times about the period of the strongest line of the motion."""
    return [
        {"relaxation_s": factor / (2.0 * math.pi * hertz)}
        for hertz in lines_hz(motion.v, motion.times, 1)
        for factor in (0.1, 0.3, 1.0, 3.0, 10.0)
    ]


def orders(motion: Motion) -> list[Shape]:
    """List orders between a spring and a damper, about the strongest line of the motion."""
    return [
        {"order": order, "centre_hz": hertz}
        for hertz in lines_hz(motion.v, motion.times, 1)
        for order in (0.2, 0.5, 0.8)
    ]


KINDS = (
    Kind(
        name="maxwell",
        title="Spring in series with a damper (Maxwell)",
        family="viscoelasticity",
        where="element",
        parameters=(
            Parameter(
                name="km_n_per_m", unit="N/m", meaning="stiffness of the branch", low=0.0
            ),
            Parameter(
                name="relaxation_s",
                unit="s",
                meaning="relaxation time of the branch",
                low=0.0,
                nonzero=True,
            ),
        ),
        equation="km z, ż = v − z/τ",
        source="Maxwell 1867; beside the spring of the element: standard linear solid",
        sentence="Stiffness and damping depend on frequency, as of rubber: a viscous branch.",
        action=Law(force=maxwell, rates=(relaxation,)),
        strength="km_n_per_m",
        shapes=relaxation_times,
        contains=("viscous_damping",),
    ),
    Kind(
        name="fractional_damping",
        title="Damping of fractional order",
        family="viscoelasticity",
        where="element",
        parameters=(
            Parameter(
                name="kf_n_per_m", unit="N/m", meaning="stiffness of the middle branch", low=0.0
            ),
            Parameter(
                name="order",
                unit="",
                meaning="order of the derivative: 0 of a spring, 1 of a damper",
                low=0.0,
                high=1.0,
            ),
            Parameter(
                name="centre_hz",
                unit="Hz",
                meaning="centre of two decades of frequency",
                low=0.0,
                nonzero=True,
                fitted=False,
            ),
        ),
        equation="kf Σ 10^(α k/2) zₖ, żₖ = v − 2π fc 10^(k/2) zₖ, k = −2 … 2",
        source="Oustaloup et al. 2000; Bagley and Torvik 1983",
        sentence="Stiffness and damping rise with a power of frequency, as of polymers.",
        action=Law(force=fractional, rates=(branch_0, branch_1, branch_2, branch_3, branch_4)),
        strength="kf_n_per_m",
        shapes=orders,
        contains=("maxwell", "viscous_damping"),
    ),
)
