r"""Stationary response of many linear structures at once to white and coloured noise.

Lyapunov's equation :math:`A P + P A^T + Q = 0` of each row is turned by Cayley's transform
into :math:`P = F P F^T + R` and solved by doubling, which needs no eigenvectors and so does
not suffer at critical damping.

References
----------
.. [1] R. A. Smith, "Matrix equation XA + BX = C", SIAM J. Appl. Math. 16 (1968) 198-201.
"""

import numpy as np
from jaxtyping import Float

MOST_DOUBLINGS = 60
"""2^60 steps of Cayley's transform: a motion that has not died by then does not die."""

SETTLED = 1e-12
"""Relative addition to the covariance at which the doubling ends."""

States = Float[np.ndarray, "row state state"]


def state_matrices(
    mass: Float[np.ndarray, "row dof dof"],
    damping: Float[np.ndarray, "row dof dof"],
    stiffness: Float[np.ndarray, "row dof dof"],
) -> States:
    r"""State matrix of :math:`(q, \dot q)` for each row [row, state, state].

    Parameters
    ----------
    mass, damping, stiffness
        Matrices of each row, in SI units.
    """
    rows, dofs, _ = mass.shape
    below = -np.linalg.solve(mass, np.concatenate([stiffness, damping], axis=2))
    above = np.zeros((rows, dofs, 2 * dofs))
    above[:, :, dofs:] = np.eye(dofs)
    return np.concatenate([above, below], axis=1)


def stationary_covariance(a: States, noise: States) -> States:
    r"""Covariance :math:`P` of :math:`\dot x = A x + w`, where :math:`Q` is the noise's.

    Parameters
    ----------
    a
        State matrices; every motion must die away.
    noise
        Intensity :math:`Q`, with :math:`E[w(t) w(t')^T] = Q\,\delta(t - t')`.

    Returns
    -------
    Covariances [row, state, state].

    Raises
    ------
    ValueError
        Where a motion does not die away.
    """
    size = a.shape[1]
    half = size // 2
    # Rates of the slowest and the fastest motion: their geometric mean converges soonest.
    fast = np.abs(np.linalg.eigvals(a))
    pace = np.sqrt(fast.min(axis=1) * fast.max(axis=1))
    pace = np.where(pace > 0.0, pace, 1.0)[:, None, None]
    left = np.linalg.inv(pace * np.eye(size) - a)
    step = left @ (pace * np.eye(size) + a)
    found = 2.0 * pace * (left @ noise @ left.swapaxes(1, 2))
    for _ in range(MOST_DOUBLINGS):
        added = step @ found @ step.swapaxes(1, 2)
        found = found + added
        if not np.isfinite(found).all():
            break
        own = np.abs(np.diagonal(found, axis1=1, axis2=2))
        more = np.abs(np.diagonal(added, axis1=1, axis2=2))
        if (more <= SETTLED * np.maximum(own, np.finfo(float).tiny)).all():
            return np.asarray(0.5 * (found + found.swapaxes(1, 2)))
        step = step @ step
    raise ValueError(
        "A motion does not die away, so that the response never becomes stationary: "
        f"{half} coordinates or a filter lack damping. Give every mode damping."
    )
