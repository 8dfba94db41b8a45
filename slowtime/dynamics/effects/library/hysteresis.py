"""Hysteretic forces (Bouc–Wen)."""

from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import levels


def bouc_wen(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of a Bouc-Wen spring, less its initial linear force.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Elongation of the yielding spring itself [m].
    p
        Stiffness that yields [N/m], elongation of yield [m], sharpness of the yield [1].

    Returns
    -------
    Force [N].
    """
    return float(p[0] * (z[0] - e))


def yielding(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Rate of the internal elongation of a Bouc-Wen spring.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Elongation of the yielding spring itself [m].
    p
        Stiffness that yields [N/m], elongation of yield [m], sharpness of the yield [1].

    Returns
    -------
    Rate [m/s].
    """
    if v * z[0] <= 0.0:
        return float(v)
    return float(v * (1.0 - abs(z[0] / p[1]) ** p[2]))


def yields(motion: Motion) -> list[Shape]:
    """List elongations at which the spring may yield, and how sharply.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
    return [
        {"zy_m": share * top, "n": n}
        for top in levels(motion.e, 0.99)
        for share in (0.15, 0.3, 0.6)
        for n in (1.0, 2.0)
    ]


KINDS = (
    Kind(
        name="bouc_wen",
        title="Hysteresis",
        family="hysteresis",
        where="element",
        parameters=(
            Parameter(name="kh_n_per_m", unit="N/m", meaning="stiffness that yields", low=0.0),
            Parameter(
                name="zy_m", unit="m", meaning="elongation of yield", low=0.0, nonzero=True
            ),
            Parameter(name="n", unit="", meaning="sharpness of the yield", low=0.5, high=20.0),
        ),
        equation="kh (z − e), ż = v (1 − |z/zy|ⁿ (1 + sign(v z))/2)",
        source="Bouc 1967; Wen 1976",
        sentence="Hysteresis: the spring yields and comes back on another path.",
        action=Law(force=bouc_wen, rates=(yielding,)),
        strength="kh_n_per_m",
        shapes=yields,
    ),
)
