r"""Steady-state Kalman filters of several models at once, run in blocks of samples.

The gain is that of the algebraic Riccati equation, so that estimate and outputs are a linear
recursion with constant coefficients, :math:`\hat x_k = (I - K H) F \hat x_{k-1} + K y_k`; a
block of it is one matrix product.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float

from .latent import Latent
from .levels import Levels

BLOCK = 32
"""Samples of a block: a product as large as the filters' states and channels together."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Filters:
    """Recursions of all models, made ready for blocks.

    Parameters
    ----------
    through, from_state
        Outputs of a block, of its samples and of the state before it.
    into, onward
        State after a block, of its samples and of the state before it.
    variance
        Of the error of each output, by model.
    settles_s
        Time in which a wrong state loses its weight by e five times [s].
    prior_variance
        Of each output itself.
    """

    through: Float[np.ndarray, "model row column"]
    from_state: Float[np.ndarray, "model row state"]
    into: Float[np.ndarray, "model state column"]
    onward: Float[np.ndarray, "model state state"]
    variance: Float[np.ndarray, "model output"]
    prior_variance: Float[np.ndarray, "model output"]
    settles_s: float

    def run(
        self,
        state: Float[np.ndarray, "model state"],
        samples: Float[np.ndarray, "time channel"],
    ) -> tuple[Float[np.ndarray, "model state"], Float[np.ndarray, "model time output"]]:
        """Filter whole blocks of samples.

        Parameters
        ----------
        state
            State of each model.
        samples
            As many as a multiple of `BLOCK`, in SI.

        Returns
        -------
        State after the samples, and the outputs in their units.
        """
        outputs = self.variance.shape[1]
        blocks = samples.reshape(-1, BLOCK * samples.shape[1])
        out = np.empty((len(blocks), len(state), BLOCK * outputs))
        for number, block in enumerate(blocks):
            out[number] = self.through @ block + (self.from_state @ state[..., None])[..., 0]
            state = self.into @ block + (self.onward @ state[..., None])[..., 0]
        values = out.transpose(1, 0, 2).reshape(len(state), len(samples), outputs)
        return state, values


def make_filters(
    models: Sequence[Latent],
    levels: Levels,
    rate_hz: float,
) -> Filters:
    """Solve for the steady gain of each model, and unroll its recursion over a block.

    Parameters
    ----------
    models
        Models with their latent forces.
    levels
        Covariance of latent forces and noises.
    """
    closed, gains, variances, priors = [], [], [], []
    noise = np.diag(levels.noise)
    for model in models:
        transition, process = model.discrete(rate_hz, levels.forces)
        gain, after = _steady(transition, process, model.sensing, noise)
        keeps = np.eye(len(transition)) - gain @ model.sensing
        closed.append(keeps @ transition)
        gains.append(gain)
        variances.append(np.einsum("os,st,ot->o", model.telling, after, model.telling))
        whole = scipy.linalg.solve_discrete_lyapunov(transition, process)
        priors.append(np.einsum("os,st,ot->o", model.telling, whole, model.telling))
    recursion, gain_all = np.stack(closed), np.stack(gains)
    telling = np.stack([model.telling for model in models])
    slowest = max(float(np.abs(np.linalg.eigvals(matrix)).max()) for matrix in closed)
    count, states, channels = gain_all.shape
    outputs = telling.shape[1]
    through = np.zeros((count, BLOCK, outputs, BLOCK, channels))
    into = np.zeros((count, states, BLOCK, channels))
    from_state = np.zeros((count, BLOCK, outputs, states))
    heard, carried = gain_all, recursion
    for lag in range(BLOCK):
        told = telling @ heard
        for row in range(lag, BLOCK):
            through[:, row, :, row - lag] = told
        into[:, :, BLOCK - 1 - lag] = heard
        from_state[:, lag] = telling @ carried
        onward = carried
        heard, carried = recursion @ heard, recursion @ carried
    return Filters(
        through=through.reshape(count, BLOCK * outputs, BLOCK * channels),
        from_state=from_state.reshape(count, BLOCK * outputs, states),
        into=into.reshape(count, states, BLOCK * channels),
        onward=onward,
        variance=np.maximum(np.stack(variances), 0.0),
        prior_variance=np.stack(priors),
        settles_s=5.0 / (rate_hz * -np.log(min(slowest, 1 - 1e-12))),
    )


def _steady(
    transition: Float[np.ndarray, "state state"],
    process: Float[np.ndarray, "state state"],
    sensing: Float[np.ndarray, "channel state"],
    noise: Float[np.ndarray, "channel channel"],
) -> tuple[Float[np.ndarray, "state channel"], Float[np.ndarray, "state state"]]:
    """Gain, and covariance after a reading, once both are constant (structured doubling).

    Doubling squares the number of steps at each turn, and stays positive where the pencil of
    the Riccati equation has eigenvalues too near the unit circle for a Schur decomposition.
    """
    size = len(transition)
    a, h = transition.T, process
    # A factor of G: I + G H itself is singular to rounding where noise is small.
    factor = sensing.T / np.sqrt(np.diag(noise))
    for _ in range(TURNS):
        seen = factor.T @ h @ factor
        sizes, axes = np.linalg.eigh(np.eye(len(seen)) + (seen + seen.T) / 2)
        # All are 1 or more, but for rounding where noise is small.
        narrow = (factor @ axes / np.sqrt(np.maximum(sizes, 1.0))).T
        weighed = narrow @ h
        grown = a.T @ (h - weighed.T @ weighed) @ a
        reached = a @ narrow.T
        a = a @ a - reached @ (weighed @ a)
        factor = np.concatenate([factor, reached], axis=1)
        if factor.shape[1] > size:
            factor = np.asarray(np.linalg.qr(factor.T, mode="r")).T
        h = h + (grown + grown.T) / 2
        if np.abs(grown).max() <= TOLERANCE * np.abs(h).max():
            break
    seen = h @ sensing.T
    gain = np.linalg.solve(sensing @ seen + noise, seen.T).T
    keeps = np.eye(size) - gain @ sensing
    after = keeps @ h @ keeps.T + gain @ noise @ gain.T
    return gain, after


TURNS = 40
TOLERANCE = 1e-12
"""Relative growth of the covariance at which doubling has converged [1]."""
