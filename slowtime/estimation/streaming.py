r"""A Gaussian process as a stream: one step for each new reading, however many there have been.

.. math:: y_i = f(t_i) + \varepsilon_i, \qquad f \sim GP(0, k), \quad
          \varepsilon_i \sim N(0, s_i^2)

with the standard deviation of each reading known and times at any distance: the same numbers
as the dense process of n by n matrices gives, at a cost per reading that does not hang on n.
Takes the processes of `processes`, and those of `matern`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import optimize

from .hyperparameters import quasi_random_points as even
from .matern import Belief, Jump, Moving, Reading, lifted, predict
from .processes import Process

__all__ = [
    "Belief",
    "Fitted",
    "Reading",
    "Stream",
    "fit",
    "leave_one_out",
    "likelihood_and_slopes",
    "log_likelihood",
    "predict",
    "run",
    "sample",
    "smooth",
]

Series = Float[np.ndarray, " time"]
_NET, _WIDEST = 63, 40
"""Members of the net from which a search begins, and the largest state of such a net."""

_PRIOR_SD = 1.4
"""Of the logarithm of a parameter about where the search starts: a factor of four."""


@dataclasses.dataclass(frozen=True, slots=True)
class Stream:
    """A process with readings coming in.

    Hyperparameters may be learnt anew from kept readings by `fit` while the stream goes on;
    ``Stream(fitted.process).resume(...)`` then takes over.

    Examples
    --------
    >>> from .processes import Matern
    >>> stream = Stream(Matern(length=5.0, sd=1.0))
    >>> belief = stream.start(0.0)
    >>> for t in range(20):
    ...     belief, reading = stream.step(belief, float(t), float(np.sin(t / 5)), 0.1)
    >>> mean, sd = predict(stream.process, belief, np.array([20.0]))
    >>> bool(abs(mean[0] - np.sin(4.0)) < 2 * sd[0])
    True
    """

    process: Process
    _prior: np.ndarray | None = dataclasses.field(init=False, repr=False, compare=False)
    """Covariance before any reading of one stationary process; None of others."""
    _seen: np.ndarray = dataclasses.field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        prior = self.process.initial_covariance()[0]
        alone = self.process.stationary and prior.ndim == 2
        object.__setattr__(self, "_prior", prior if alone else None)
        object.__setattr__(self, "_seen", self.process.observation)

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
        return self.process.start(time)

    def step(
        self, belief: Belief, time: float, value: float, sd: float
    ) -> tuple[Belief, Reading]:
        """Update the belief by one reading, in constant time.

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

        Returns
        -------
        Belief after the reading, and the reading as the filter met it.
        """
        apart = time - belief.time
        if self._prior is not None and apart >= 0.0:
            move = self.process.transition_over(apart)
            noise = self._prior - move.dot(self._prior).dot(move.T)
            return _step(self._seen, belief, time, value, sd, move, noise)
        move, noise = self.process.advance(np.array([apart]))
        seen = self.process.observation_row(np.array([time]))[0]
        return _step(seen, belief, time, value, sd, move[0], noise[0])

    def resume(self, time: Series, value: Series, sd: Series) -> Belief:
        """Belief after a series of readings.

        Parameters
        ----------
        time
            Times of the readings, ascending.
        value
            Readings; NaN where missing.
        sd
            Their standard deviations, in the unit of the readings.

        Returns
        -------
        Belief after the last reading.
        """
        return run(self.process, time, value, sd)[0]


@dataclasses.dataclass(frozen=True, slots=True)
class Smoothed:
    """The process at each time given all readings, without the noise of readings.

    Parameters
    ----------
    mean, sd
        Of the process, or of the part of it that was asked for.
    """

    mean: Series
    sd: Series


@dataclasses.dataclass(frozen=True, slots=True)
class Fitted:
    """A process fitted to readings.

    Parameters
    ----------
    log_likelihood
        Of the readings under it.
    log_posterior
        With the prior density of the parameters, up to a constant.
    evaluations
        How often the likelihood was asked for.
    """

    process: Process
    log_likelihood: float
    log_posterior: float
    evaluations: int


def run(
    process: Process,
    time: Series,
    value: Series,
    sd: Series,
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
        Instants between readings at which the level, the first number of the state, jumps,
        each with its standard deviation.

    Returns
    -------
    Belief after the last reading, and each reading as the filter met it.
    """
    steps, which = np.unique(np.diff(time, prepend=time[:1]), return_inverse=True)
    moves, noises = process.advance(steps)
    all_seen, waiting = process.observation_row(time), sorted(jumps)
    belief, readings = Stream(process).start(float(time[0])), []
    triples = zip(time.tolist(), value.tolist(), sd.tolist(), strict=True)
    for (t, y, s), k, seen in zip(triples, which, all_seen, strict=True):
        while waiting and waiting[0][0] < t:
            belief = lifted(belief, waiting.pop(0)[1])
        belief, reading = _step(seen, belief, t, y, s, moves[k], noises[k])
        readings.append(reading)
    return belief, readings


def log_likelihood(
    process: Process,
    time: Series,
    value: Series,
    sd: Series,
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
        Instants between readings at which the level, the first number of the state, jumps,
        each with its standard deviation.

    Returns
    -------
    Log-likelihoods.
    """
    each = [reading.log_likelihood for reading in run(process, time, value, sd, jumps=jumps)[1]]
    return np.asarray(np.sum(each, axis=0))


def likelihood_and_slopes(
    process: Process, time: Series, value: Series, sd: Series
) -> tuple[float, Float[np.ndarray, " parameter"]]:
    """Log-likelihood, and its slopes to the logarithms of the free parameters, exact.

    The sensitivities of mean and covariance are carried along with them.

    Parameters
    ----------
    process
        Process, one member.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.

    Returns
    -------
    Log-likelihood, and its slopes.
    """
    steps, which = np.unique(np.diff(time, prepend=time[:1]), return_inverse=True)
    moves, of_moves = process.moves(steps)
    noises, of_noises = process.noises(steps, moves, of_moves)
    count, size, all_seen = len(of_moves), process.size, process.observation_row(time)
    d_moves = np.array(of_moves).reshape(count, len(steps), size, size)
    d_noises = np.array(of_noises).reshape(count, len(steps), size, size)
    p, of_spread = process.initial_covariance()
    d_p = np.array(of_spread).reshape(count, size, size)
    m, d_m = np.zeros(size), np.zeros((count, size))
    total, slope = 0.0, np.zeros(count)
    for y, s, k, seen in zip(
        value.tolist(), sd.tolist(), which.tolist(), all_seen, strict=True
    ):
        a, d_a = moves[k], d_moves[:, k]
        half = d_a @ p @ a.T
        d_m = d_a @ m + d_m @ a.T
        d_p = half + np.swapaxes(half, 1, 2) + a @ d_p @ a.T + d_noises[:, k]
        m, p = a @ m, a @ p @ a.T + noises[k]
        if y != y or s != s:
            continue
        reach, d_reach = p @ seen, d_p @ seen
        spread, d_spread = float(seen @ reach) + s * s, d_reach @ seen
        residual, d_residual = y - float(seen @ m), -(d_m @ seen)
        pull = residual / spread
        total -= 0.5 * (residual * pull + np.log(2.0 * np.pi * spread))
        slope -= pull * d_residual + 0.5 * d_spread * (1.0 / spread - pull * pull)
        gain = reach / spread
        d_gain = (d_reach - gain * d_spread[:, None]) / spread
        m = m + gain * residual
        d_m = d_m + d_gain * residual + gain * d_residual[:, None]
        p = p - gain[:, None] * reach
        d_p = d_p - d_gain[:, :, None] * reach - gain[:, None] * d_reach[:, None, :]
    return total, slope


def smooth(
    process: Process,
    time: Series,
    value: Series,
    sd: Series,
    *,
    part: Float[np.ndarray, " state"] | Float[np.ndarray, "time state"] | None = None,
    jumps: Sequence[Jump] = (),
) -> Smoothed:
    """Estimate the process, or a part of it, at every time of the series given all of it.

    Ask for times without a reading, past or future, by putting them in with a value of NaN.
    The way back carries scores instead of inverting predicted covariances (de Jong, 1989), so
    that readings close together in time do no harm.

    Parameters
    ----------
    process
        Process, one member.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.
    part
        What of the state is asked for, as `processes.Sum.part` tells, or at each time; all of
        it if not given.
    jumps
        As for `run`.

    Returns
    -------
    Mean and standard deviation at each time.
    """
    readings = run(process, time, value, sd, jumps=jumps)[1]
    all_seen, size = process.observation_row(time), process.size
    score, information = np.zeros(size), np.zeros((size, size))
    found = np.zeros((2, len(time)))
    for i in range(len(time) - 1, -1, -1):
        now, seen = readings[i], all_seen[i]
        asked = seen if part is None else part[i] if part.ndim == 2 else part
        keep = np.eye(size) - np.outer(now.seen / now.spread, seen)
        score = seen * (now.residual / now.spread) + keep.T @ score
        information = np.outer(seen, seen) / now.spread + keep.T @ information @ keep
        reach = now.covariance @ asked
        found[0, i] = asked @ now.mean + reach @ score
        found[1, i] = asked @ reach - reach @ information @ reach
        score, information = now.move.T @ score, now.move.T @ information @ now.move
    return Smoothed(found[0], np.sqrt(np.maximum(found[1], 0.0)))


def leave_one_out(
    process: Process, time: Series, value: Series, sd: Series
) -> tuple[Series, Series]:
    """Predict the process at each reading from all other readings.

    In one pass there and back (de Jong, 1988).

    Parameters
    ----------
    process
        Process, one member.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.

    Returns
    -------
    Mean and standard deviation of the process, in the unit of the readings.
    """
    readings = run(process, time, value, sd)[1]
    all_seen, size = process.observation_row(time), process.size
    score, information = np.zeros(size), np.zeros((size, size))
    mean, variance = np.zeros(len(time)), np.zeros(len(time))
    for i in range(len(time) - 1, -1, -1):
        now, seen = readings[i], all_seen[i]
        if not np.isfinite(now.spread):
            # Nothing was read: what is expected, and what the future adds to it.
            mean[i] = now.expected + now.seen @ score
            variance[i] = now.variance - now.seen @ information @ now.seen
        else:
            gain = now.seen / now.spread
            pull = now.residual / now.spread - gain @ score
            weight = 1.0 / now.spread + gain @ information @ gain
            mean[i] = value[i] - pull / weight
            variance[i] = 1.0 / weight - sd[i] ** 2
        keep = np.eye(size) - np.outer(now.seen / now.spread, seen)
        score = seen * (now.residual / now.spread) + keep.T @ score
        information = np.outer(seen, seen) / now.spread + keep.T @ information @ keep
        score, information = now.move.T @ score, now.move.T @ information @ now.move
    return mean, np.sqrt(np.maximum(variance, 0.0))


def fit(
    process: Process,
    time: Series,
    value: Series,
    sd: Series,
    *,
    prior_sd: float | Float[np.ndarray, " parameter"] = _PRIOR_SD,
    starts: int = 4,
) -> Fitted:
    """Learn the free parameters: likelihood times a weak prior about those of `process`.

    Parameters
    ----------
    process
        Kind of process, and where the search and the prior are centred.
    time
        Times of the readings, ascending.
    value
        Readings; NaN where missing.
    sd
        Their standard deviations, in the unit of the readings.
    prior_sd
        Standard deviations of the prior on the logarithms. Give a narrow one for a period: the
        likelihood has a peak for each count of waves.
    starts
        From how many points the search begins: the likeliest of a net over the prior.

    Returns
    -------
    The process, and its log-likelihood.
    """
    if np.isfinite(value).sum() < 3:
        raise ValueError(
            f"{int(np.isfinite(value).sum())} readings are too few to learn a process from. "
            "Give at least 3 at different times."
        )
    centre, asked = process.logs, 0
    prior_sd = np.broadcast_to(np.asarray(prior_sd, dtype=float), centre.shape)
    least = 1e-6 * max(float(np.nanstd(value)), 1e-300)
    sd = np.maximum(sd, least)

    def downhill(logs: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal asked
        asked += 1
        away = (logs - centre) / prior_sd
        total, slope = likelihood_and_slopes(process.at(logs), time, value, sd)
        return 0.5 * float(away @ away) - total, away / prior_sd - slope

    bounds = list(zip(centre - 5.0 * prior_sd, centre + 5.0 * prior_sd, strict=True))
    net = np.vstack([centre, centre + prior_sd * even(_NET, len(centre))])
    if process.at(net).size > _WIDEST:
        begin = net[:starts]
    else:
        away = (net - centre) / prior_sd
        score = log_likelihood(process.at(net), time, value, sd) - 0.5 * np.sum(away**2, -1)
        begin = net[np.argsort(-score)[:starts]]
    best = min(
        (
            optimize.minimize(downhill, point, jac=True, method="L-BFGS-B", bounds=bounds)
            for point in begin
        ),
        key=lambda found: float(found.fun),
    )
    away = (best.x - centre) / prior_sd
    found = process.at(best.x)
    posterior = -float(best.fun)
    return Fitted(found, posterior + 0.5 * float(away @ away), posterior, asked)


def sample(
    process: Moving,
    belief: Belief,
    times: Float[np.ndarray, " later"],
    paths: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "path later"]:
    """Draw futures of the process, each a whole path.

    Parameters
    ----------
    process
        Process, one member.
    belief
        Belief after the last reading.
    times
        Future times, ascending.
    paths
        Number of paths.
    rng
        Generator of the draws.

    Returns
    -------
    Paths, in the unit of the readings.
    """
    apart = np.diff(times, prepend=belief.time)
    scale = max(float(apart.max(initial=0.0)), 1e-300)
    steps, which = np.unique(np.round(apart / scale, 12), return_inverse=True)
    moves, noises = process.advance(steps * scale)
    roots, first = _any_root(noises), _any_root(belief.covariance)
    state = belief.mean + rng.standard_normal((paths, len(belief.mean))) @ first.T
    seen, found = process.observation_row(times), np.zeros((paths, len(times)))
    for k, j in enumerate(which):
        state = state @ moves[j].T + rng.standard_normal(state.shape) @ roots[j].T
        found[:, k] = state @ seen[k]
    return found


def _any_root(covariance: np.ndarray) -> np.ndarray:
    """Root of a covariance that rounding may have made a little negative, as short steps do."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def _step(
    seen: np.ndarray,
    belief: Belief,
    time: float,
    value: float,
    sd: float,
    move: np.ndarray,
    noise: np.ndarray,
) -> tuple[Belief, Reading]:
    if belief.mean.ndim == move.ndim - 1 == seen.ndim == 1:
        mean = move.dot(belief.mean)
        covariance = move.dot(belief.covariance).dot(move.T) + noise
        return _read(seen, mean, covariance, (time, value, sd), move)
    mean = (move @ belief.mean[..., None])[..., 0]
    covariance = move @ belief.covariance @ np.swapaxes(move, -1, -2) + noise
    reach = (covariance @ seen[..., None])[..., 0]
    expected, own = np.vecdot(mean, seen), np.vecdot(reach, seen)
    if value != value or sd != sd:
        none = np.zeros_like(own)
        return Belief(time, mean, covariance), Reading(
            expected, own, none, mean, covariance, reach, none, np.full_like(own, np.inf), move
        )
    spread = own + sd * sd
    residual = value - expected
    gain = reach / spread[..., None]
    likelihood = -0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
    left = covariance - gain[..., :, None] * reach[..., None, :]
    # Joseph's form, in rank-one pieces: rounding cannot make it negative.
    left = left - (left @ seen[..., None]) * gain[..., None, :]
    left = left + (sd * sd) * gain[..., :, None] * gain[..., None, :]
    updated = Belief(
        time, mean + gain * residual[..., None], 0.5 * (left + np.swapaxes(left, -1, -2))
    )
    return updated, Reading(
        expected, own, likelihood, mean, covariance, reach, residual, spread, move
    )


def _read(
    seen: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    given: tuple[float, float, float],
    move: np.ndarray,
) -> tuple[Belief, Reading]:
    """Update one process, predicted for the time of a reading, by it.

    Products of single matrices by `dot` cost half of those of `matmul`, which also takes
    families.
    """
    time, value, sd = given
    reach = covariance.dot(seen)
    expected, own = mean.dot(seen), reach.dot(seen)
    if value != value or sd != sd:
        none, endless = np.float64(0.0), np.float64(np.inf)
        return Belief(time, mean, covariance), Reading(
            expected, own, none, mean, covariance, reach, none, endless, move
        )
    spread = own + sd * sd
    residual = value - expected
    gain = reach / spread
    likelihood = -0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
    # Joseph's form of a single reading: an error of the gain counts in second order only.
    left = covariance - gain[:, None] * (2.0 * reach - spread * gain)
    updated = Belief(time, mean + gain * residual, 0.5 * (left + left.T))
    return updated, Reading(
        expected, own, likelihood, mean, covariance, reach, residual, spread, move
    )
