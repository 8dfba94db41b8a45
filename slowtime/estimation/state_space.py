r"""Processes over time as small linear systems: what each tells, and what is believed of it.

.. math:: x(t + \tau) = A(\tau)\, x(t) + w, \quad w \sim N(0, Q(\tau)), \qquad
          y_i = h(t_i)\, x(t_i) + \varepsilon_i, \quad \varepsilon_i \sim N(0, s_i^2)

with the standard deviation :math:`s_i` of each reading known and instants at any distance. All
functions take families too: processes whose parameters are arrays. Then every result has the
shape of those parameters in front.
"""

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

Jump = tuple[float, float]
"""Time, and standard deviation of how far the level goes between it and later readings."""

PerMember = Float[np.ndarray, "*family"] | np.float64

Advanced = tuple[np.ndarray, np.ndarray]
"""Transition and process noise over time steps, as `StateSpace.advance` gives them."""


@dataclasses.dataclass(frozen=True, slots=True)
class Belief:
    """What is known of the state at a time."""

    time: float
    mean: Float[np.ndarray, "*family state"]
    covariance: Float[np.ndarray, "*family state state"]


@runtime_checkable
class StateSpace(Protocol):
    """A process, or a family of them, seen through a state."""

    def start(self, time: float) -> Belief:
        """Belief before any reading.

        Parameters
        ----------
        time
            Time of the belief, no later than the first reading.

        Returns
        -------
        Mean and covariance of the state.
        """
        ...

    def advance(self, step: Float[np.ndarray, " time"]) -> Advanced:
        """Compute transition and process noise over time steps.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions and covariances [time, family, state, state].

        Raises
        ------
        ValueError
            Where a step is negative.
        """
        ...

    def observation_row(self, time: Float[np.ndarray, " time"]) -> np.ndarray:
        """Row that maps the state to the process, at each time.

        Parameters
        ----------
        time
            Times, in the unit of time.

        Returns
        -------
        Rows [time, family, state]; the same at all times unless the process depends on the
        clock.
        """
        ...


@dataclasses.dataclass(frozen=True, slots=True)
class Innovation:
    """One reading as the filter met it.

    Parameters
    ----------
    expected, variance
        Of the process at this time, before the reading.
    residual, spread
        Reading minus `expected`, and its variance (infinite where missing).
    log_likelihood
        Of the reading given all before it.
    """

    expected: PerMember
    variance: PerMember
    residual: PerMember
    spread: PerMember
    log_likelihood: PerMember


def step(
    process: StateSpace,
    belief: Belief,
    time: float,
    value: float,
    sd: float,
    advanced: Advanced | None = None,
) -> tuple[Belief, Innovation]:
    """Update a belief by one reading, in constant time.

    Parameters
    ----------
    process
        Process, or family of processes.
    belief
        Belief after the reading before. It may have more axes in front than the family, as
        rivals have.
    time
        Time of the reading.
    value
        Reading; NaN only advances the time.
    sd
        Its standard deviation, in the unit of the readings.
    advanced
        Result of `advance` for the one time step, where several beliefs share it.

    Returns
    -------
    Belief after the reading, and the reading as the filter met it.
    """
    moves, noises = advanced or process.advance(np.array([time - belief.time]))
    move, seen = moves[0], process.observation_row(np.array([time]))[0]
    mean = (move @ belief.mean[..., None])[..., 0]
    covariance = move @ belief.covariance @ np.swapaxes(move, -1, -2) + noises[0]
    reach = (covariance @ seen[..., None])[..., 0]
    expected, own = np.vecdot(mean, seen), np.vecdot(reach, seen)
    if value != value or sd != sd:
        none, endless = np.zeros_like(own), np.full_like(own, np.inf)
        return Belief(time, mean, covariance), Innovation(expected, own, none, endless, none)
    spread = own + sd * sd
    residual = value - expected
    gain = reach / spread[..., None]
    likelihood = -0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
    # Joseph's form of a single reading: an error of the gain counts in second order only.
    left = (
        covariance - gain[..., :, None] * (2.0 * reach - spread[..., None] * gain)[..., None, :]
    )
    left = 0.5 * (left + np.swapaxes(left, -1, -2))
    updated = Belief(time, mean + gain * residual[..., None], left)
    return updated, Innovation(expected, own, residual, spread, likelihood)


def lifted(belief: Belief, sd: float) -> Belief:
    """Widen a belief by a jump of the level, the first number of the state, of unknown size.

    Parameters
    ----------
    belief
        Belief before the jump.
    sd
        Standard deviation of the jump, in the unit of the readings.

    Returns
    -------
    Belief after the jump.
    """
    covariance = belief.covariance.copy()
    covariance[..., 0, 0] += sd**2
    return dataclasses.replace(belief, covariance=covariance)


def predict(
    process: StateSpace, belief: Belief, times: Float[np.ndarray, " later"]
) -> tuple[Float[np.ndarray, "*family later"], Float[np.ndarray, "*family later"]]:
    """Mean and standard deviation of the process at future times, without noise of readings.

    Parameters
    ----------
    process
        Process, or family of processes.
    belief
        Belief after the last reading.
    times
        Future times, ascending.

    Returns
    -------
    Mean and standard deviation, in the unit of the readings.
    """
    move, noise = process.advance(times - belief.time)
    seen = process.observation_row(times)
    seen = seen.reshape(len(times), *(1,) * (move.ndim - 1 - seen.ndim), *seen.shape[1:])
    mean = np.vecdot((move @ belief.mean[..., None])[..., 0], seen)
    rows = (seen[..., None, :] @ move)[..., 0, :]
    carried = (rows[..., None, :] @ belief.covariance @ rows[..., :, None])[..., 0, 0]
    variance = carried + (seen[..., None, :] @ noise @ seen[..., :, None])[..., 0, 0]
    spread = np.sqrt(np.maximum(variance, 0.0))
    return np.moveaxis(mean, 0, -1), np.moveaxis(spread, 0, -1)
