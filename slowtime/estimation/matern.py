r"""A Gaussian process over slow time, trend plus Matérn, at a constant cost per reading.

.. math:: y(t_i) = \underbrace{a(t_i)}_{\text{trend}} + g(t_i) + \varepsilon_i, \qquad
          g \sim GP(0, \sigma^2 k_\nu(|t - t'| / \ell)), \quad \varepsilon_i \sim N(0, s_i^2)

with the standard deviation :math:`s_i` of each reading known and instants at any distance from
each other. The state is (level, slope, g and its derivatives); what the trend does not use has
variance zero. All functions also take processes whose parameters are arrays: then every
result has the shape of those parameters in front, and a whole family is filtered at once.
"""

import dataclasses
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from . import kernels

Parameter = float | Float[np.ndarray, " family"]
Jump = tuple[float, float]
"""Time, and standard deviation of how far the level goes between it and later readings."""

PerMember = Float[np.ndarray, "*family"] | np.float64


@runtime_checkable
class Moving(Protocol):
    """What a process must be able to do to be foretold."""

    def observation_row(self, time: Float[np.ndarray, " time"]) -> np.ndarray:
        """Row that maps the state to the process, at each time.

        Parameters
        ----------
        time
            Times, in the unit of time.

        Returns
        -------
        Rows [time, family, state].
        """
        ...

    def advance(self, step: Float[np.ndarray, " time"]) -> tuple[np.ndarray, np.ndarray]:
        """Compute transition and process noise over time steps.

        Parameters
        ----------
        step
            Time steps [time], in the unit of time.

        Returns
        -------
        Transitions and covariances [time, family, state, state].
        """
        ...


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SlowProcess:
    """A trend plus a Matérn process.

    Parameters
    ----------
    smoothness
        0.5 (rough, as after jumps), 1.5 or 2.5 (twice differentiable).
    length
        Length scale, in the unit of time.
    sd
        Standard deviation of the Matérn process, in the unit of the readings.
    centre
        Mean of the level at `start`, in the unit of the readings.
    level_sd
        Standard deviation of that level; 0 for a known mean.
    slope_sd
        Standard deviation of the slope of the mean [reading / time]; 0 for a constant mean.
    slope_drift
        How the slope wanders: the standard deviation of its change over one unit of time
        [reading / time]; it grows with the root of the time. 0 for a straight mean.
    """

    smoothness: float = 1.5
    length: Parameter
    sd: Parameter
    centre: float = 0.0
    level_sd: float = 0.0
    slope_sd: float = 0.0
    slope_drift: Parameter = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a process."""
        if self.smoothness not in kernels.SMOOTHNESSES:
            raise ValueError(
                f"smoothness={self.smoothness} is none of 0.5, 1.5, 2.5. Give 1.5 when unsure."
            )
        if not np.all(np.asarray(self.length) > 0.0):
            raise ValueError(
                f"length={self.length} is not a length scale. Give a positive one, in the unit "
                "of the times."
            )
        spreads = (self.sd, self.level_sd, self.slope_sd, self.slope_drift)
        if not all(np.all(np.asarray(spread) >= 0.0) for spread in spreads):
            raise ValueError(
                f"sd={self.sd}, level_sd={self.level_sd}, slope_sd={self.slope_sd}, "
                f"slope_drift={self.slope_drift} must not be negative. Give 0 to leave one out."
            )

    @property
    def observation(self) -> Float[np.ndarray, " state"]:
        """What of the state a reading sees."""
        seen = np.zeros(3 + round(self.smoothness - 0.5))
        seen[[0, 2]] = 1.0
        return seen

    def observation_row(
        self, time: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, "time state"]:
        """Row that maps the state to the process; the same at all times.

        Parameters
        ----------
        time
            Times, in the unit of time.

        Returns
        -------
        Rows.
        """
        return np.broadcast_to(self.observation, (len(time), len(self.observation)))

    def start(self, time: float) -> "Belief":
        """Belief before any reading.

        Parameters
        ----------
        time
            Time of the belief, no later than the first reading.

        Returns
        -------
        Mean and covariance of the state.
        """
        family = np.broadcast_shapes(np.shape(self.length), np.shape(self.sd))
        size = len(self.observation)
        mean, covariance = np.zeros((*family, size)), np.zeros((*family, size, size))
        mean[..., 0] = self.centre
        covariance[..., 0, 0] = self.level_sd**2
        covariance[..., 1, 1] = self.slope_sd**2
        covariance[..., 2:, 2:] = _per_member(self.sd) ** 2 * kernels.stationary(
            self.smoothness
        )
        return Belief(float(time), mean, covariance)

    def step(
        self,
        belief: "Belief",
        time: float,
        value: float,
        sd: float,
        advanced: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> tuple["Belief", "Reading"]:
        """Update a belief by one reading, in constant time.

        Parameters
        ----------
        belief
            Belief after the reading before.
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
        move, noise = advanced or self.advance(np.array([time - belief.time]))
        return self._step(belief, time, value, sd, move[0], noise[0])

    def advance(self, step: Float[np.ndarray, " time"]) -> tuple[np.ndarray, np.ndarray]:
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
        if step.size and not step.min() >= 0.0:
            raise ValueError(
                f"The time goes back by {-step.min():g}. Give readings in ascending order of "
                "time; equal times are allowed."
            )
        apart = step.reshape(-1, *([1] * np.ndim(self.length)))
        scaled = apart * kernels.rate(self.smoothness, self.length)
        inner = kernels.matern_transition(self.smoothness, scaled)
        rest = kernels.stationary(self.smoothness)
        noise_inner = rest - inner @ rest @ np.swapaxes(inner, -1, -2)
        size = len(self.observation)
        move = np.zeros((*inner.shape[:-2], size, size))
        noise = np.zeros_like(move)
        move[..., 0, 0] = move[..., 1, 1] = 1.0
        move[..., 0, 1] = apart
        move[..., 2:, 2:] = inner
        noise[..., :2, :2] = _per_member(self.slope_drift) ** 2 * kernels.trend_noise(apart)
        noise[..., 2:, 2:] = _per_member(self.sd) ** 2 * noise_inner
        return move, noise

    def _step(
        self,
        belief: "Belief",
        time: float,
        value: float,
        sd: float,
        move: np.ndarray,
        noise: np.ndarray,
    ) -> tuple["Belief", "Reading"]:
        mean = (move @ belief.mean[..., None])[..., 0]
        covariance = move @ belief.covariance @ np.swapaxes(move, -1, -2) + noise
        seen = covariance[..., 0] + covariance[..., 2]
        expected, own = mean[..., 0] + mean[..., 2], seen[..., 0] + seen[..., 2]
        spread = own + sd * sd
        if value != value or sd != sd:
            none = np.zeros_like(own)
            return Belief(time, mean, covariance), Reading(
                expected,
                own,
                none,
                mean,
                covariance,
                seen,
                none,
                np.inf * np.ones_like(own),
                move,
            )
        residual = value - expected
        inverse = 1.0 / spread
        gain = seen * inverse[..., None]
        likelihood = -0.5 * (residual * residual * inverse + np.log(2.0 * np.pi * spread))
        updated = Belief(
            time,
            mean + gain * residual[..., None],
            covariance - gain[..., :, None] * seen[..., None, :],
        )
        return updated, Reading(
            expected, own, likelihood, mean, covariance, seen, residual, spread, move
        )


@dataclasses.dataclass(frozen=True, slots=True)
class Belief:
    """What is known of the state at a time."""

    time: float
    mean: Float[np.ndarray, "*family state"]
    covariance: Float[np.ndarray, "*family state state"]


@dataclasses.dataclass(frozen=True, slots=True)
class Reading:
    """One reading as the filter met it; what the smoother needs on its way back.

    Parameters
    ----------
    expected, variance
        Of the process at this time, before the reading.
    log_likelihood
        Of the reading given all before it.
    mean, covariance
        Of the state before the reading.
    seen
        Covariance of the state with the process.
    residual, spread
        Reading minus `expected`, and its variance (infinite where missing).
    move
        Transition that led here.
    """

    expected: PerMember
    variance: PerMember
    log_likelihood: PerMember
    mean: Float[np.ndarray, "*family state"]
    covariance: Float[np.ndarray, "*family state state"]
    seen: Float[np.ndarray, "*family state"]
    residual: PerMember
    spread: PerMember
    move: Float[np.ndarray, "... state state"]


@dataclasses.dataclass(frozen=True, slots=True)
class Smoothed:
    """The process at each time given all readings.

    Parameters
    ----------
    mean, sd
        Of trend and Matérn process together, without the noise of readings.
    trend, trend_sd
        Of the trend alone.
    """

    mean: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    trend: Float[np.ndarray, " time"]
    trend_sd: Float[np.ndarray, " time"]


def run(
    process: SlowProcess,
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
    *,
    jumps: Sequence[Jump] = (),
) -> tuple[Belief, list[Reading]]:
    """Filter a whole series.

    Parameters
    ----------
    process
        Process, or family of processes.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.
    jumps
        Instants between readings at which the level jumps, each with its standard deviation.

    Returns
    -------
    Belief after the last reading, and each reading as the filter met it.
    """
    steps, which = np.unique(np.diff(time, prepend=time[:1]), return_inverse=True)
    moves, noises = process.advance(steps)
    belief, readings = process.start(time[0]), []
    waiting = sorted(jumps)
    for i in range(len(time)):
        while waiting and waiting[0][0] < time[i]:
            belief = lifted(belief, waiting.pop(0)[1])
        belief, reading = process._step(
            belief,
            float(time[i]),
            float(value[i]),
            float(sd[i]),
            moves[which[i]],
            noises[which[i]],
        )
        readings.append(reading)
    return belief, readings


def lifted(belief: Belief, sd: float) -> Belief:
    """Widen a belief by a jump of the level of unknown size.

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


def log_likelihood(
    process: SlowProcess,
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
    *,
    jumps: Sequence[Jump] = (),
) -> Float[np.ndarray, "*family"]:
    """Log-likelihood of the series, one entry per member of a family of processes.

    Parameters
    ----------
    process
        Process, or family of processes.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.
    jumps
        Instants between readings at which the level jumps, each with its standard deviation.

    Returns
    -------
    Log-likelihoods.
    """
    each = [reading.log_likelihood for reading in run(process, time, value, sd, jumps=jumps)[1]]
    total: Float[np.ndarray, "*family"] = np.asarray(np.sum(each, axis=0))
    return total


def predict(
    process: Moving, belief: Belief, times: Float[np.ndarray, " later"]
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


def smooth(
    process: SlowProcess,
    time: Float[np.ndarray, " time"],
    value: Float[np.ndarray, " time"],
    sd: Float[np.ndarray, " time"],
) -> Smoothed:
    """Estimate the process at every time of the series given all of it.

    Times without a reading, past or future, are given with a value of NaN. The backward pass
    carries scores instead of inverting predicted covariances (de Jong, 1989), so that readings
    close together in time do no harm.

    Parameters
    ----------
    process
        Process.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.

    Returns
    -------
    Mean and standard deviation of the process and of its trend, at each time.

    References
    ----------
    .. [1] P. de Jong, "Smoothing and interpolation with the state-space model", J. Amer.
       Statist. Assoc. 84 (1989) 1085-1088.
    """
    _, readings = run(process, time, value, sd)
    seen = process.observation
    size = len(seen)
    score, information = np.zeros(size), np.zeros((size, size))
    found = np.zeros((4, len(time)))
    for i in range(len(time) - 1, -1, -1):
        now = readings[i]
        keep = np.eye(size) - np.outer(now.seen / now.spread, seen)
        score = seen * (now.residual / now.spread) + keep.T @ score
        information = np.outer(seen, seen) / now.spread + keep.T @ information @ keep
        mean = now.mean + now.covariance @ score
        covariance = now.covariance - now.covariance @ information @ now.covariance
        found[:, i] = mean @ seen, seen @ covariance @ seen, mean[0], covariance[0, 0]
        score, information = now.move.T @ score, now.move.T @ information @ now.move
    found[[1, 3]] = np.sqrt(np.maximum(found[[1, 3]], 0.0))
    return Smoothed(*found)


def _per_member(parameter: Parameter) -> np.ndarray:
    return np.asarray(parameter)[..., None, None]
