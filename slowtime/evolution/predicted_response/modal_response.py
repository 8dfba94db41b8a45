r"""Response of one structure with modal damping to one load, mode by mode.

A modal coordinate follows

.. math:: \ddot r_j + 2 \zeta_j \omega_j \dot r_j + \omega_j^2 r_j = g_j f(t), \qquad
          r_j = \Im w_j / \omega_{d,j}, \quad \dot w_j = p_j w_j + g_j f

with the pole :math:`p_j = -\zeta_j \omega_j + i \omega_{d,j}`. Under a load that is linear
between its samples a pole is stepped without error by one multiplication a sample.
"""

import numpy as np
import scipy
import scipy.linalg
from jaxtyping import Complex, Float

SMALL = 0.1
"""Size of a step [1] below which its weights are summed as series, since their closed forms
lose digits."""

TERMS = 12
"""Terms of these series; the first that is left out is below 1e-16 of the sum."""


def modal_response(
    matrices: tuple[Float[np.ndarray, "dof dof"], Float[np.ndarray, "dof dof"]],
    ratios: Float[np.ndarray, " mode"],
    pushed: Float[np.ndarray, " dof"],
    load: Float[np.ndarray, " time"],
    rate_hz: float,
    *,
    rows: Float[np.ndarray, "output dof"],
    order: int,
) -> Float[np.ndarray, "time output"] | None:
    """Motion of a structure from rest under one load, linear between its samples.

    Parameters
    ----------
    matrices
        Mass and stiffness [kg, N/m].
    ratios
        Damping ratio of each mode, the lowest first, below 1 [1].
    pushed
        Force on each degree of freedom per unit of the load.
    load
        The load at the samples.
    rate_hz
        Samples per second.
    rows
        What each output sees of the degrees of freedom.
    order
        How often the displacement is differentiated: 0, 1 or 2.

    Returns
    -------
    One column for each output; None where a motion strains nothing, so that it has no ratio.
    """
    mass, stiffness = matrices
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    if not squares[0] > 0.0:
        return None
    omega = np.sqrt(squares)
    swings = omega * np.sqrt(1.0 - ratios**2)
    poles = -ratios * omega + 1j * swings
    gains = shapes.T @ pushed
    kept, before, after = linear_hold(poles / rate_hz)
    seen = rows @ shapes
    parts = np.empty((len(omega), len(load)))
    for j, pole in enumerate(poles):
        # At rest at the first sample, whatever the load is there.
        rest = [-after[j] * load[0]]
        waves, _ = scipy.signal.lfilter([after[j], before[j]], [1.0, -kept[j]], load, zi=rest)
        waves = waves / rate_hz
        turned = waves if order == 0 else pole * waves
        parts[j] = turned.imag / swings[j]
        if order == 2:
            parts[j] = -2.0 * ratios[j] * omega[j] * parts[j]
            parts[j] += load - squares[j] * waves.imag / swings[j]
    return np.asarray(((seen * gains) @ parts).T)


def linear_hold(
    step: Complex[np.ndarray, " mode"],
) -> tuple[
    Complex[np.ndarray, " mode"], Complex[np.ndarray, " mode"], Complex[np.ndarray, " mode"]
]:
    r"""Weights of a step under a load that is linear between its samples.

    .. math:: w_{k+1} = e^z w_k + h [(\phi_1 - \phi_2) f_k + \phi_2 f_{k+1}], \qquad
              \phi_1 = (e^z - 1) / z, \quad \phi_2 = (e^z - 1 - z) / z^2

    Parameters
    ----------
    step
        Poles times the time step, :math:`z`.

    Returns
    -------
    :math:`e^z`, :math:`\phi_1 - \phi_2` and :math:`\phi_2`.

    Examples
    --------
    >>> kept, before, after = linear_hold(np.array([0.0, -1.0], dtype=complex))
    >>> np.array([kept, before, after]).real.round(6).tolist()
    [[1.0, 0.367879], [0.5, 0.264241], [0.5, 0.367879]]
    """
    first, second = np.zeros_like(step), np.zeros_like(step)
    large = np.abs(step) >= SMALL
    z = step[large]
    first[large] = np.expm1(z) / z
    second[large] = (np.expm1(z) - z) / z**2
    near, power, factorial = step[~large], np.ones(int((~large).sum()), dtype=complex), 1.0
    for k in range(TERMS):
        factorial *= k + 1
        first[~large] += power / factorial
        second[~large] += power / (factorial * (k + 2))
        power = power * near
    return np.exp(step), first - second, second
