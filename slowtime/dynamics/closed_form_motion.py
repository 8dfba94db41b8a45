r"""Free, step and pulse response of a structure in closed form.

With proportional damping each undamped mode moves by itself (eq. 3.137, 3.142); with any other
viscous damping the complex modes do,

.. math:: q(t) = 2 \operatorname{Re} \sum_j \frac{z_j}{\gamma_j} e^{s_j t}
    (z_j^T M \dot q_0 + z_j^T C q_0 + s_j z_j^T M q_0)

(eq. 3.244 with the conjugates of 3.246 put where they belong). Where modes do not span all
motion, as at critical damping, the matrix exponential does the same. For a force sampled in
time see `simulation`.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float

from .damping import is_proportional
from .modes import DefectiveModesError, complex_modes, undamped_modes
from .structure import Structure, state_matrix

Times = Float[np.ndarray, " time"]
State = Float[np.ndarray, " dof"]
Motion = Float[np.ndarray, "time dof"]


def free_motion(
    structure: Structure, times: Times, displacement: State, velocity: State
) -> tuple[Motion, Motion]:
    """Displacement [m] and velocity [m/s] after release at time zero.

    Examples
    --------
    >>> pair = np.array([[2.0, -1.0], [-1.0, 2.0]])
    >>> two = Structure(mass=np.eye(2), damping=0.2 * np.eye(2), stiffness=pair)
    >>> q, v = free_motion(two, np.array([0.0, 3.0]), np.array([2.0, 0.0]), np.zeros(2))
    >>> q[1].round(3)
    array([-0.419, -1.021])
    """
    if np.any(times < 0):
        raise ValueError(
            f"times hold {times.min()}: nothing is known of before the release. Give times of "
            "zero or more."
        )
    if is_proportional(structure):
        return _by_real_modes(structure, times, displacement, velocity)
    try:
        return _by_complex_modes(structure, times, displacement, velocity)
    except DefectiveModesError:
        return _by_exponential(structure, times, displacement, velocity)


def step_motion(structure: Structure, times: Times, force: State) -> tuple[Motion, Motion]:
    """Response from rest to a constant force that is applied at time zero.

    Gives displacement [m] and velocity [m/s] at times that ascend from 0.
    """
    try:
        static = scipy.linalg.solve(structure.stiffness, force, assume_a="sym")
    except (scipy.linalg.LinAlgError, scipy.linalg.LinAlgWarning):
        raise ValueError(
            "A structure that is free to drift comes to no rest under a constant force. Tie it "
            "to the base, or use simulation.simulate_structure."
        ) from None
    displacement, velocity = free_motion(structure, times, -static, np.zeros_like(static))
    return displacement + static, velocity


def pulse_motion(
    structure: Structure, times: Times, force: State, duration_s: float
) -> tuple[Motion, Motion]:
    """Response from rest to a constant force of limited duration.

    Gives displacement [m] and velocity [m/s] at times that ascend from 0.
    """
    # The difference of two steps. The book's form of it (eq. 3.186 to 3.188) holds after the
    # end of the pulse only, and overflows for a long one.
    displacement, velocity = step_motion(structure, times, force)
    after = times > duration_s
    later = step_motion(structure, times[after] - duration_s, force)
    displacement[after] -= later[0]
    velocity[after] -= later[1]
    return displacement, velocity


def _by_real_modes(
    structure: Structure, times: Times, displacement: State, velocity: State
) -> tuple[Motion, Motion]:
    modes = undamped_modes(structure)
    x, square = modes.shapes, modes.angular_frequency**2
    rate = np.einsum("aj,ab,bj->j", x, structure.damping, x) / 2
    a, b = x.T @ structure.mass @ displacement, x.T @ structure.mass @ velocity
    sine, cosine = _kernels(rate, square, times)
    moved = a * (cosine + rate * sine) + b * sine
    moving = b * (cosine - rate * sine) - a * square * sine
    return moved @ x.T, moving @ x.T


def _kernels(
    rate: Float[np.ndarray, " mode"], square: Float[np.ndarray, " mode"], times: Times
) -> tuple[Float[np.ndarray, "time mode"], Float[np.ndarray, "time mode"]]:
    r"""Compute :math:`e^{-rt} \sin(\omega_d t) / \omega_d` and its cosine, for any damping."""
    t, apart = times[:, None], square - rate**2
    omega = np.sqrt(np.abs(apart))
    ringing = apart > 0
    wave = np.where(ringing, omega, 1.0) * t
    # Exponentials of the real roots, since cosh and sinh overflow; the slow one as a quotient.
    quotient = square / np.where(rate > 0, rate + omega, 1.0)
    slow = np.where(ringing, 0.0, np.where(rate > 0, quotient, rate - omega))
    falling, gone = np.exp(-slow * t), -np.expm1(-2 * omega * t)
    creeping = falling * np.where(omega > 0, gone / np.where(omega > 0, 2 * omega, 1.0), t)
    settling = falling * (1 - gone / 2)
    decay = np.exp(-np.where(ringing, rate, 0.0) * t)
    scale = np.where(ringing, omega, 1.0)
    return (
        np.where(ringing, decay * np.sin(wave) / scale, creeping),
        np.where(ringing, decay * np.cos(wave), settling),
    )


def _by_complex_modes(
    structure: Structure, times: Times, displacement: State, velocity: State
) -> tuple[Motion, Motion]:
    poles, shapes, norms = complex_modes(structure).all()
    momentum = structure.mass @ velocity + structure.damping @ displacement
    start = (shapes.T @ momentum + poles * (shapes.T @ (structure.mass @ displacement))) / norms
    waves = np.exp(np.multiply.outer(times, poles)) * start
    return (waves @ shapes.T).real, ((waves * poles) @ shapes.T).real


def _by_exponential(
    structure: Structure, times: Times, displacement: State, velocity: State
) -> tuple[Motion, Motion]:
    start = np.concatenate([displacement, velocity])
    a = state_matrix(structure)
    states = np.array([scipy.linalg.expm(a * t) @ start for t in times]).reshape(-1, len(start))
    return states[:, : structure.dofs], states[:, structure.dofs :]
