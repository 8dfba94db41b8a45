r"""A process of teeth: it rises steadily, and falls at once to begin anew at each edge.

A tank that is emptied by a steady flow and filled in no time, as seen in a frequency.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .algebra import Leaf

Parameter = float | Float[np.ndarray, "*family"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Sawtooth(Leaf):
    r"""Teeth :math:`a(t) (2 \phi(t) - 1)`, with :math:`\phi` the part of a period gone by.

    Their height wanders as an Ornstein–Uhlenbeck process does.

    Parameters
    ----------
    period, edge
        Of the teeth, and the time of one of the edges; neither is learnt by slopes, as the
        likelihood goes in steps where an edge passes a reading.
    sd
        Standard deviation of half the height, which may be of either sign.
    memory
        Length scale over which the height changes.

    Examples
    --------
    >>> process = Sawtooth(period=4.0, edge=1.0, sd=1.0, memory=99.0)
    >>> process.observation_row(np.array([1.0, 2.0])).ravel()
    array([-1. , -0.5])
    """

    period: Parameter
    edge: Parameter
    sd: Parameter
    memory: Parameter

    stationary = False

    @property
    def _names(self) -> tuple[str, ...]:
        return ("sd", "memory")

    @property
    def observation(self) -> np.ndarray:
        """See `Process`; half the height, which is what is seen just before an edge."""
        return np.ones(1)

    def observation_row(self, time: np.ndarray) -> np.ndarray:
        """See `StateSpace.observation_row`."""
        family = np.broadcast_shapes(np.shape(self.period), np.shape(self.edge))
        since = time.reshape(-1, *(1,) * len(family)) - self.edge
        return np.asarray(2.0 * ((since / self.period) % 1.0) - 1.0)[..., None]

    def initial_covariance(self) -> np.ndarray:
        """See `Process`."""
        sd, _ = np.broadcast_arrays(self.sd, self.memory)
        return np.asarray(np.square(sd)[..., None, None])

    def transitions(self, step: np.ndarray) -> np.ndarray:
        """See `Process`."""
        _, memory = np.broadcast_arrays(self.sd, self.memory)
        gone = step.reshape(-1, *(1,) * np.ndim(memory)) / memory
        return np.asarray(np.exp(-gone)[..., None, None])
