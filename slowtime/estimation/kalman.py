r"""Linear Gaussian state, one reading at a time, and back again for the past.

.. math:: x_k = F x_{k-1} + u_k + w_k, \quad z_k = H x_k + \nu_k, \qquad
          w_k \sim N(0, Q), \; \nu_k \sim N(0, R)

with both noises white in time and independent of each other and of the start, without which
the recursion is not the batch posterior (the book asks for zero mean and Gaussian only).
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from .gaussian import FilterStep, Gaussian, root_of, smooth, take_in, triangular

__all__ = ["FilterStep", "Gaussian", "Kalman", "smooth", "update"]


def update(
    belief: Gaussian,
    reading: Float[np.ndarray, "*twins reading"],
    observation: Float[np.ndarray, "*twins reading state"],
    reading_noise: Float[np.ndarray, "*twins reading reading"],
) -> Gaussian:
    """Update a belief by a reading, without a step in time (eq. 1.24 to 1.26).

    Eq. 1.26 is printed with a 1 where the identity matrix belongs.

    Parameters
    ----------
    belief
        Belief before the reading.
    reading
        Reading; NaN entries are missing.
    observation
        Matrix H that maps the state to the reading.
    reading_noise
        Covariance R of the noise of the reading.

    Returns
    -------
    Belief after the reading.
    """
    expected = (observation @ belief.mean[..., None])[..., 0]
    seen = observation @ belief.root
    noise = root_of(reading_noise)
    return take_in(belief, expected, belief.root, seen, reading, noise, None)[0]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Kalman:
    """A filter whose model is the same at every step.

    Parameters
    ----------
    transition, process_noise, observation, reading_noise
        F, Q, H and R of the model: one for all twins, or with axes of twins in front.
    gate
        Probability below which a reading is rejected as none of this model; None takes all.

    Examples
    --------
    A constant level read twice, with a prior as good as one reading:

    >>> level = Kalman(transition=np.eye(1), process_noise=np.zeros((1, 1)),
    ...                observation=np.eye(1), reading_noise=np.eye(1))
    >>> belief = level.start(np.zeros(1), np.eye(1))
    >>> for reading in (3.0, 3.0):
    ...     belief, _ = level.step(belief, np.array([reading]))
    >>> belief.mean.round(9), belief.covariance.round(9)
    (array([2.]), array([[0.33333333]]))
    """

    transition: Float[np.ndarray, "... state state"]
    process_noise: Float[np.ndarray, "... state state"]
    observation: Float[np.ndarray, "... reading state"]
    reading_noise: Float[np.ndarray, "... reading reading"]
    gate: float | None = None
    _process_root: np.ndarray = dataclasses.field(init=False, repr=False)
    _reading_root: np.ndarray = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_process_root", root_of(self.process_noise))
        object.__setattr__(self, "_reading_root", root_of(self.reading_noise))

    def start(
        self,
        mean: Float[np.ndarray, "*twins state"],
        covariance: Float[np.ndarray, "*twins state state"],
    ) -> Gaussian:
        """Belief one step before the first reading.

        Parameters
        ----------
        mean
            Mean of the state.
        covariance
            Covariance of the state.

        Returns
        -------
        The belief.
        """
        return Gaussian.of(mean, covariance)

    def step(
        self,
        belief: Gaussian,
        reading: Float[np.ndarray, "*twins reading"],
        known: Any = None,
    ) -> tuple[Gaussian, FilterStep]:
        """Predict one step, and update by one reading (eq. 1.22 to 1.26).

        Parameters
        ----------
        belief
            Belief after the reading before.
        reading
            Reading; NaN entries are missing.
        known
            Vector that is added to the state in the step [state]; None for none.

        Returns
        -------
        Belief after the reading, and the details of the step.
        """
        carried = self.transition @ belief.root
        noise = np.broadcast_to(self._process_root, carried.shape)
        after = np.concatenate([carried, noise], axis=-1)
        before = np.concatenate([belief.root, np.zeros_like(carried)], axis=-1)
        mean = (self.transition @ belief.mean[..., None])[..., 0]
        if known is not None:
            mean = mean + known
        predicted = Gaussian(mean, triangular(after))
        expected = (self.observation @ mean[..., None])[..., 0]
        seen = self.observation @ predicted.root
        updated, rest = take_in(
            predicted, expected, predicted.root, seen, reading, self._reading_root, self.gate
        )
        return updated, FilterStep(predicted, updated, before, after, **rest)

    def run(
        self, belief: Gaussian, readings: Float[np.ndarray, "time *twins reading"]
    ) -> list[FilterStep]:
        """Filter a whole series.

        Parameters
        ----------
        belief
            Belief one step before the first reading.
        readings
            Readings; NaN entries are missing.

        Returns
        -------
        Details of every step.
        """
        steps = []
        for reading in readings:
            belief, step = self.step(belief, reading)
            steps.append(step)
        return steps
