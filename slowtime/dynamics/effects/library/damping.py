"""Nonlinear dampers: drag, and negative damping."""

from typing import Any

from slowtime.dynamics.effects.kind import Kind, Law, Motion, Parameter, Shape

from .parameter_grids import each, levels


def drag(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of drag, which grows with the square of speed.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Coefficient of drag [N s^2/m^2].

    Returns
    -------
    Force [N].
    """
    return float(p[0] * abs(v) * v)


def van_der_pol(e: float, v: float, t: float, z: Any, p: Any) -> float:
    """Force of damping that is negative at small elongations and positive at large ones.

    Parameters
    ----------
    e
        Elongation [m].
    v
        Its rate [m/s].
    t
        Campaign time [s]; not used.
    z
        Internal states; none.
    p
        Negative damping at rest [N s/m]; elongation from which damping is positive [m].

    Returns
    -------
    Force [N].
    """
    ratio = e / p[1]
    return float(p[0] * (ratio * ratio - 1.0) * v)


def amplitudes(motion: Motion) -> list[Shape]:
    """List elongations at which damping may change its sign.

    Parameters
    ----------
    motion
        Motion of the place of the effect.

    Returns
    -------
    Values of the shape parameters to try, by name.
    """
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
        sentence="Damping is negative at small amplitude and positive at large: it sings.",
        action=Law(force=van_der_pol),
        strength="cn_n_s_per_m",
        shapes=amplitudes,
    ),
)
