"""Covariance of the response to random force, by Lyapunov's equation: truth for other tests."""

import dataclasses

import numpy as np
import scipy.linalg

from slowtime.dynamics.simulation import density_root, force_density
from slowtime.dynamics.structure import state_matrix


@dataclasses.dataclass(frozen=True)
class ResponseCovariance:
    """Covariances of displacement, velocity, both, and acceleration (None if white)."""

    displacement: np.ndarray
    velocity: np.ndarray
    displacement_velocity: np.ndarray
    acceleration: np.ndarray | None


def response_covariance(structure, force_psd, *, shaping=None):
    """Covariance of the stationary response; `force_psd` is one-sided [N^2/Hz].

    Solves A P + P A^T + B S B^T / 2 = 0, of structure and filters together if coloured.
    """
    dofs = structure.dofs
    whole, noise, acceleration = augmented(structure, force_psd, shaping)
    assert scipy.linalg.eigvals(whole).real.max() < 0
    covariance = scipy.linalg.solve_continuous_lyapunov(whole, -0.5 * noise @ noise.T)
    covariance = (covariance + covariance.T) / 2
    return ResponseCovariance(
        displacement=covariance[:dofs, :dofs],
        velocity=covariance[dofs : 2 * dofs, dofs : 2 * dofs],
        displacement_velocity=covariance[:dofs, dofs : 2 * dofs],
        acceleration=None if shaping is None else acceleration @ covariance @ acceleration.T,
    )


def augmented(structure, force_psd, shaping):
    """State matrix, input of unit white noise, and what of the state is acceleration."""
    dofs = structure.dofs
    own = state_matrix(structure)
    root = density_root(force_density(structure, force_psd))
    push = scipy.linalg.solve(structure.mass, root, assume_a="pos")
    if shaping is None:
        return own, np.vstack([np.zeros_like(push), push]), own[dofs:]
    sources = np.eye(root.shape[1])
    filters = np.kron(sources, shaping.state_matrix)
    pushed = np.kron(push, shaping.output_vector[None, :])
    size = 2 * dofs + len(filters)
    whole = np.zeros((size, size))
    whole[: 2 * dofs, : 2 * dofs] = own
    whole[dofs : 2 * dofs, 2 * dofs :] = pushed
    whole[2 * dofs :, 2 * dofs :] = filters
    noise = np.zeros((size, root.shape[1]))
    noise[2 * dofs :] = np.kron(sources, shaping.input_vector[:, None])
    return whole, noise, whole[dofs : 2 * dofs]
