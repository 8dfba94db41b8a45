r"""Random motion: the Itô–Taylor scheme of strong order 1.5.

.. math:: dx = v \, dt, \qquad dv = a(x, v, t) \, dt + \sum_j b_j(x) \, dW_j, \qquad
          b_j = (\sigma_j + \mu_j x_j) / m_j

with white forces of density :math:`\sigma_j`, and of a density that grows with the
displacement. As b does not hang on v, Itô's and Stratonovich's readings agree. One step is

.. math::
    x &\mathrel{+}= v h + \tfrac12 a h^2 + \sum b_j \Delta Z_j \\
    v &\mathrel{+}= a h + \sum b_j \Delta W_j + a_v \sum b_j \Delta Z_j \\
      &+ \tfrac12 h^2 (a_t + a_x v + a_v a + \tfrac12 \sum b_j^T a_{vv} b_j)
      + \sum (v \cdot \nabla b_j)(\Delta W_j h - \Delta Z_j)

(Kloeden and Platen, 1992, sec. 10.4; Tripura et al., 2020), with derivatives by central
differences along the flow, so that any law of force will do.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from . import kernel
from .springs import Springs


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class WhiteForce:
    """White forces on the nodes.

    Parameters
    ----------
    added
        Square root of the (two-sided) density of each [N s^(1/2)].
    multiplied
        The same per metre of the node's displacement [N s^(1/2) / m]; None for none.
    """

    added: Float[np.ndarray, " node"]
    multiplied: Float[np.ndarray, " node"] | None = None

    @property
    def per_metre(self) -> Float[np.ndarray, " node"]:
        """What is multiplied, zeros where there is none."""
        return np.zeros_like(self.added) if self.multiplied is None else self.multiplied


def simulate(
    springs: Springs,
    forces: Float[np.ndarray, "time series node"],
    rate_hz: float,
    noise: WhiteForce,
    rng: np.random.Generator,
    *,
    values: Float[np.ndarray, "row parameter"] | None = None,
    start: Float[np.ndarray, "path state"],
    start_s: float = 0.0,
) -> Float[np.ndarray, "time path state"]:
    """Draw paths of the motion, as many as `start` has rows.

    Parameters
    ----------
    springs
        Structure.
    forces
        Known forces on the nodes [N] at the samples, straight between them; one series for
        all paths, or one for each.
    rate_hz
        Samples per second; one step of the scheme a sample.
    noise
        White forces beside them.
    rng
        Generator of the noise.
    values
        Of the parameters, one row for all paths or one for each.
    start
        Displacements, then velocities, at the first sample.
    start_s
        Campaign time of the first sample [s].

    Returns
    -------
    States at the samples.
    """
    paths, count = len(start), len(springs.nodes)
    if start.shape[1] != 2 * count or forces.shape[2] != count:
        raise ValueError(
            f"{start.shape[1]} states and {forces.shape[2]} forces were given for {count} "
            "nodes. Give displacements and velocities of all, and a force on each."
        )
    if paths % forces.shape[1]:
        raise ValueError(
            f"{forces.shape[1]} series of forces for {paths} paths. Give one for all, or one "
            "for each."
        )
    rows, h = springs.rows(values, paths), 1.0 / rate_hz
    room, forces = kernel.room_for(count), np.ascontiguousarray(forces, dtype=float)
    out = np.zeros((len(forces), paths, 2 * count))
    out[0] = start
    for k in range(len(forces) - 1):
        out[k + 1] = out[k]
        normal = rng.standard_normal((2, paths, count))
        kernel.ito_taylor(
            springs.ends,
            springs.laws,
            rows,
            out[k + 1],
            forces[k],
            forces[k + 1],
            start_s + k * h,
            h,
            np.asarray(noise.added, dtype=float),
            np.asarray(noise.per_metre, dtype=float),
            normal,
            room,
        )
    return out


def means(
    samples: Float[np.ndarray, "time *twins _"], every: int
) -> Float[np.ndarray, "interval *twins _"]:
    """Means over intervals of a signal that is linear between samples.

    Parameters
    ----------
    samples
        Samples of the signal.
    every
        Number of steps per interval.

    Returns
    -------
    Mean over each whole interval, in the unit of the samples.
    """
    middle = 0.5 * (samples[1:] + samples[:-1])
    count = len(middle) // every
    return np.asarray(middle[: count * every].reshape(count, every, *middle.shape[1:]).mean(1))
