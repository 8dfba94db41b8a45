r"""Whole series through the filter of a family of processes, there and back.

One compiled pass for single processes and families, with the numbers of the dense process of n
by n matrices at a cost per reading that does not hang on n. On the way back the score and the
information of the state are carried, rather than inverting predicted covariances, so that
readings close together in time do no harm (de Jong, 1989). Of an intervention that adds
:math:`\delta` to a number of the state just before reading i, and so :math:`\delta x_i` to the
readings, they are

.. math:: s_i = x_i^T V^{-1} (y - \mu), \qquad S_i = x_i^T V^{-1} x_i

with V the covariance of the readings: the estimate of :math:`\delta` is :math:`s_i / S_i`, its
variance :math:`1 / S_i`, for all i from one pass (Harvey and Koopman, "Diagnostic checking of
unobserved-components time series models", 1992; de Jong and Penzer, "Diagnosing shocks in time
series", 1998).

All functions take ascending times, readings of which NaN are missing, their standard
deviations in the unit of the readings, and `jumps`: instants between readings at which the
level, the first number of the state, jumps, each with its standard deviation.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .state_space import Belief, Jump, StateSpace

Series = Float[np.ndarray, " time"]

_ENTRIES = 2_000_000
"""Entries of transitions that are held at once (16 MB): of more, the family goes in parts."""


class Interventions(NamedTuple):
    """What one pass there and back says of a shift of the level just before each reading.

    Parameters
    ----------
    log_likelihood
        Of the readings, of each member of the family.
    score, information
        :math:`s_i` [1 / reading] and :math:`S_i` [1 / reading²] of each member and reading.
    left_out
        Residual of each reading against what all others say of it, over its standard
        deviation; 0 where it is missing [1].
    """

    log_likelihood: Float[np.ndarray, " family"]
    score: Float[np.ndarray, "family time"]
    information: Float[np.ndarray, "family time"]
    left_out: Float[np.ndarray, "family time"]

    def gain(self, sd: float) -> Float[np.ndarray, "family time"]:
        r"""Gain in log-likelihood by a shift of unknown size before each reading.

        With a size of standard deviation `sd` the covariance of the readings grows by
        :math:`\tau^2 x_i x_i^T`, of rank one, so that

        .. math:: \ln \frac{p(y | i)}{p(y)} =
                  \frac{s_i^2 \tau^2}{2 (1 + \tau^2 S_i)} - \tfrac12 \ln(1 + \tau^2 S_i) .

        Parameters
        ----------
        sd
            Standard deviation of the shift, in the unit of the readings.

        Returns
        -------
        Gains [1].
        """
        grown = 1.0 + sd**2 * self.information
        return np.asarray(0.5 * (self.score * sd) ** 2 / grown - 0.5 * np.log(grown))

    def loss(self, sd: float) -> Float[np.ndarray, "family time"]:
        """Loss of log-likelihood by removing a shift that the model holds before each reading.

        Parameters
        ----------
        sd
            Standard deviation of the shift, in the unit of the readings.

        Returns
        -------
        Losses [1].
        """
        left = np.maximum(1.0 - sd**2 * self.information, 1e-12)
        return np.asarray(0.5 * (self.score * sd) ** 2 / left + 0.5 * np.log(left))


class Passed(NamedTuple):
    """What the filter says of a series.

    Parameters
    ----------
    belief
        After the last reading.
    log_likelihood
        Of the readings.
    residual, spread
        Of each reading against all before it, and its variance (0 and infinite where missing);
        empty unless they were asked for.
    """

    belief: Belief
    log_likelihood: Float[np.ndarray, "*family"]
    residual: Float[np.ndarray, "*family time"]
    spread: Float[np.ndarray, "*family time"]


class SmoothedProcess(NamedTuple):
    """The process, or a part of it, given all readings, without the noise of readings."""

    mean: Series
    sd: Series


def filtered(
    process: StateSpace,
    time: Series,
    value: Series,
    sd: Series,
    *,
    jumps: Sequence[Jump] = (),
    belief: Belief | None = None,
    innovations: bool = False,
) -> Passed:
    """Belief after a series, and the log-likelihood of the series.

    Where a series is cut, and carried on from the `belief` after its first part, changes
    nothing, to the last bit.

    Parameters
    ----------
    time, value, sd, jumps
        Series.
    belief
        Before the readings; where the process starts if not given.
    innovations
        Whether each reading is told of, too.

    Returns
    -------
    Belief, log-likelihood of each member, and innovations.
    """
    begun = process.start(float(time[0])) if belief is None else belief
    steps, which = _steps(begun.time, time)
    known = _Known(process, begun, steps, time)
    mean, covariance = known.belief()
    family, total = known.family, np.zeros(len(mean))
    lifts = _lifts(time, jumps)
    residual, spread = np.zeros((2, len(mean), len(time) if innovations else 0))
    for part, *moves in known.parts():
        _kernel("forward")(
            *moves, which, value, sd, lifts,
            mean[part], covariance[part], total[part], residual[part], spread[part],
        )  # fmt: skip
    size = mean.shape[1]
    after = Belief(
        float(time[-1]) if len(time) else begun.time,
        mean.reshape(*family, size),
        covariance.reshape(*family, size, size),
    )
    shape = (*family, residual.shape[1])
    return Passed(after, total.reshape(family), residual.reshape(shape), spread.reshape(shape))


def log_likelihood(
    process: StateSpace,
    time: Series,
    value: Series,
    sd: Series,
    *,
    jumps: Sequence[Jump] = (),
) -> Float[np.ndarray, "*family"]:
    """Log-likelihood of the series, one entry per member of a family of processes."""
    return filtered(process, time, value, sd, jumps=jumps).log_likelihood


class Passes:
    """Passes there and back over one series, for one family of processes.

    What does not hang on the readings and jumps is worked out once.
    """

    def __init__(self, process: StateSpace, time: Series) -> None:
        self._time = time
        start = process.start(float(time[0]))
        steps, self._which = _steps(start.time, time)
        known = _Known(process, start, steps, time)
        self._start = known.belief
        self._parts = list(known.parts())

    def interventions(
        self, value: Series, sd: Series, *, jumps: Sequence[Jump] = ()
    ) -> Interventions:
        """Score a shift of the level, the first number of the state, before every reading.

        Parameters
        ----------
        value, sd
            Series.
        jumps
            Shifts that are taken for given.

        Returns
        -------
        Scores of a shift before each reading.
        """
        nothing = np.zeros((0, len(self._time), self._start()[0].shape[1]))
        total, score, information, pull, weight, _ = self._run(value, sd, jumps, nothing)
        left_out = pull / np.sqrt(np.where(weight > 0.0, weight, 1.0))
        return Interventions(total, score, information, left_out)

    def smoothed(
        self, value: Series, sd: Series, asked: np.ndarray, *, jumps: Sequence[Jump] = ()
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimate parts of the state given all readings.

        Parameters
        ----------
        value, sd, jumps
            Series.
        asked
            Rows [row, time, state] that map the state to each part.

        Returns
        -------
        Mean and variance [family, row, 2, time]; and of each reading the pull of its residual
        against all others, and the weight by which that was divided [family, time].
        """
        *_, pull, weight, found = self._run(value, sd, jumps, np.ascontiguousarray(asked))
        return found, pull, weight

    def _run(
        self, value: Series, sd: Series, jumps: Sequence[Jump], asked: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        mean, covariance = self._start()
        total, (rows, count, _) = np.zeros(len(mean)), asked.shape
        each = np.zeros((4, len(mean), count))
        smoothed = np.zeros((len(mean), rows, 2, count))
        lifts = _lifts(self._time, jumps)
        for part, *moves in self._parts:
            _kernel("there_and_back")(
                *moves, self._which, value, sd, lifts, mean[part], covariance[part],
                total[part], *each[:, part], asked, smoothed[part],
            )  # fmt: skip
        return total, *each, smoothed


def smooth(
    process: StateSpace,
    time: Series,
    value: Series,
    sd: Series,
    *,
    part: Float[np.ndarray, " state"] | Float[np.ndarray, "time state"] | None = None,
    jumps: Sequence[Jump] = (),
) -> SmoothedProcess:
    """Estimate the process, or a part of it, at every time of the series given all of it.

    Ask for times without a reading, past or future, by putting them in with a value of NaN.

    Parameters
    ----------
    process
        Process, one member.
    time, value, sd, jumps
        Series.
    part
        What of the state is asked for, as `algebra.Sum.part` tells, or at each time; all of it
        if not given.

    Returns
    -------
    Mean and standard deviation at each time.

    References
    ----------
    .. [1] P. de Jong, "Smoothing and interpolation with the state-space model", J. Amer.
       Statist. Assoc. 84 (1989) 1085-1088.
    """
    rows = process.observation_row(time)
    asked = np.broadcast_to(rows if part is None else part, rows.shape)[None]
    found = Passes(process, time).smoothed(value, sd, asked, jumps=jumps)[0][0, 0]
    return SmoothedProcess(found[0], np.sqrt(np.maximum(found[1], 0.0)))


def leave_one_out(
    process: StateSpace, time: Series, value: Series, sd: Series
) -> tuple[Series, Series]:
    """Predict the process at each reading from all other readings.

    In one pass there and back (de Jong, 1988).

    Parameters
    ----------
    process
        Process, one member.
    time, value, sd
        Series.

    Returns
    -------
    Mean and standard deviation of the process, in the unit of the readings.
    """
    asked = process.observation_row(time)[None]
    found, pull, weight = Passes(process, time).smoothed(value, sd, asked)
    (mean, variance), heard = found[0, 0], weight[0] > 0.0
    # Where nothing was read, all others are all readings.
    mean[heard] = value[heard] - pull[0, heard] / weight[0, heard]
    variance[heard] = 1.0 / weight[0, heard] - sd[heard] ** 2
    return mean, np.sqrt(np.maximum(variance, 0.0))


def sample(
    process: StateSpace,
    belief: Belief,
    times: Float[np.ndarray, " later"],
    owners: Int[np.ndarray, " path"],
    shocks: Float[np.ndarray, "path step state"],
) -> Float[np.ndarray, "path later"]:
    """Draw futures of a family from a belief, each a whole path of one member.

    Parameters
    ----------
    process
        Family of processes.
    belief
        Belief after the last reading.
    times
        Ascending, none before the belief.
    owners
        Of each path, the number of its member.
    shocks
        Independent standard normal numbers: for the belief, then for each time.

    Returns
    -------
    Paths, in the unit of the readings.
    """
    apart = np.diff(times, prepend=belief.time)
    scale = max(float(apart.max(initial=0.0)), 1e-300)
    steps, which = np.unique(np.round(apart / scale, 12), return_inverse=True)
    known = _Known(process, belief, steps * scale, times)
    mean, covariance = known.belief()
    begun = _roots(covariance[None])[0]
    found = np.zeros((len(owners), len(times)))
    for part, move, noise, seen, begins, columns in known.parts():
        mine = np.flatnonzero((owners >= part.start) & (owners < part.stop))
        own = owners[mine]
        state = mean[own] + (begun[own] @ shocks[mine, 0, :, None])[..., 0]
        roots = _roots(noise)
        drawn = np.zeros((len(mine), len(times)))
        _kernel("paths")(
            move, roots, seen, begins, columns, *_pattern(roots), which.astype(np.int64),
            (own - part.start).astype(np.int64), mine, state, shocks, drawn,
        )  # fmt: skip
        found[mine] = drawn
    return found


def _roots(covariances: np.ndarray) -> np.ndarray:
    """Lower triangular roots of covariances, singular ones too, as short steps make them."""
    roots = np.ascontiguousarray(covariances)
    found = np.zeros_like(roots)
    _kernel("roots")(roots, found)
    return found


def _steps(
    begin: float, time: Series
) -> tuple[Float[np.ndarray, " step"], Int[np.ndarray, " time"]]:
    """Time steps that differ, and which of them leads to each reading."""
    steps, which = np.unique(np.diff(time, prepend=begin), return_inverse=True)
    return steps, which.astype(np.int64)


def _lifts(time: Series, jumps: Sequence[Jump]) -> Series:
    """Variance that the level gains just before each reading."""
    lifts = np.zeros(len(time) + 1)
    if jumps:
        at, sds = np.array(jumps, dtype=np.float64).T
        np.add.at(lifts, np.searchsorted(time, at, side="right"), sds**2)
    return lifts[:-1]


class _Known:
    """What of a pass does not hang on the readings: transitions, noises, what is seen."""

    def __init__(
        self, process: StateSpace, belief: Belief, steps: np.ndarray, time: np.ndarray
    ) -> None:
        self._belief = belief
        self._move, self._noise = process.advance(steps)
        self._seen = process.observation_row(time)
        shapes = (self._move.shape[1:-2], self._noise.shape[1:-2], self._seen.shape[1:-1])
        self.family = np.broadcast_shapes(belief.mean.shape[:-1], *shapes)

    def belief(self) -> tuple[np.ndarray, np.ndarray]:
        """Give own copies of mean and covariance, with one axis for the family."""
        size = self._belief.mean.shape[-1]
        mean = np.broadcast_to(self._belief.mean, (*self.family, size))
        covariance = np.broadcast_to(self._belief.covariance, (*self.family, size, size))
        return mean.copy().reshape(-1, size), covariance.copy().reshape(-1, size, size)

    def parts(self) -> Iterator[tuple[Any, ...]]:
        """Give transitions, noises, rows and pattern of parts that may be held at once."""
        steps, size = len(self._move), self._move.shape[-1]
        count = int(np.prod(self.family, dtype=int))
        whole = (steps, *self.family, size, size)
        flat = (steps, count, size, size)
        move = np.broadcast_to(self._move, whole).reshape(flat)
        noise = np.broadcast_to(self._noise, whole).reshape(flat)
        seen = self._seen
        if seen.ndim > 2:
            seen = np.broadcast_to(seen, (len(seen), *self.family, size))
        seen = seen.reshape(len(seen), -1, size)
        width = max(1, _ENTRIES // max(1, steps * size * size))
        for begin in range(0, count, width):
            part = slice(begin, min(count, begin + width))
            own = seen if seen.shape[1] == 1 else seen[:, part]
            yield (
                part,
                np.ascontiguousarray(move[:, part]),
                np.ascontiguousarray(noise[:, part]),
                np.ascontiguousarray(own),
                *_pattern(move),
            )


def _pattern(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of a transition that are not always zero: begin of each row, and columns."""
    used = (move != 0.0).any(axis=(0, 1))
    begins = np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int64)
    return begins, np.nonzero(used)[1].astype(np.int64)


def _kernel(name: str) -> Callable[..., Any]:
    """Compiled recursion; with them comes the compiler, at the first call."""
    from . import recursions

    found: Callable[..., Any] = getattr(recursions, name)
    return found
