r"""Whole series through the filter of a family of processes, there and back, compiled.

The recursions of `matern.run` and `matern.smooth`, without a Python step per reading. On the
way back the score and the information of the state are carried (de Jong, 1989). Of an
intervention that adds :math:`\delta` to a number of the state just before reading i, and so
:math:`\delta x_i` to the readings, they are

.. math:: s_i = x_i^T V^{-1} (y - \mu), \qquad S_i = x_i^T V^{-1} x_i

with V the covariance of the readings: the estimate of :math:`\delta` is :math:`s_i / S_i`, its
variance :math:`1 / S_i`, for all i from one pass (Harvey and Koopman, "Diagnostic checking of
unobserved-components time series models", 1992; de Jong and Penzer, "Diagnosing shocks in time
series", 1998).
"""

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Int

from .matern import Belief, Jump, Moving

Series = Float[np.ndarray, " time"]

_ENTRIES = 2_000_000
"""Entries of transitions that are held at once (16 MB): of more, the family goes in parts."""


class Startable(Moving, Protocol):
    """A process that can also say what is believed before any reading."""

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


def filtered(
    process: Startable,
    time: Series,
    value: Series,
    sd: Series,
    *,
    jumps: Sequence[Jump] = (),
) -> tuple[Belief, Float[np.ndarray, "*family"]]:
    """Belief after a series, and the log-likelihood of the series.

    Parameters
    ----------
    process
        A `matern.SlowProcess`, or one of `processes`; a family of them, or one.
    time, value, sd
        Ascending times, readings and their standard deviations; NaN values are missing.
    jumps
        As for `matern.run`.

    Returns
    -------
    Belief after the last reading, and the log-likelihood of each member.
    """
    return carried(process, process.start(float(time[0])), time, value, sd, jumps=jumps)


def carried(
    process: Startable,
    belief: Belief,
    time: Series,
    value: Series,
    sd: Series,
    *,
    jumps: Sequence[Jump] = (),
) -> tuple[Belief, Float[np.ndarray, "*family"]]:
    """Continue from a belief with further readings, as `filtered` does from none.

    Where a series is cut changes nothing, to the last bit.

    Parameters
    ----------
    process
        Process, or family of processes.
    belief
        Belief before the readings.
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
    Belief after the last reading, and the log-likelihood of the readings.
    """
    steps, which = _steps(belief.time, time)
    known = _Known(process, belief, steps, time)
    mean, covariance = known.belief()
    family, total = known.family, np.zeros(len(mean))
    lifts = _lifts(time, jumps)
    for part, move, noise, seen in known.parts():
        pattern = _pattern(move)
        _kernel("forward")(
            move, noise, seen, *pattern, which, value, sd, lifts,
            mean[part], covariance[part], total[part],
        )  # fmt: skip
    size = mean.shape[1]
    after = Belief(
        float(time[-1]) if len(time) else belief.time,
        mean.reshape(*family, size),
        covariance.reshape(*family, size, size),
    )
    return after, total.reshape(family)


def log_likelihood(
    process: Startable, time: Series, value: Series, sd: Series, *, jumps: Sequence[Jump] = ()
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
    return filtered(process, time, value, sd, jumps=jumps)[1]


class Passes:
    """Passes there and back over one series, for one family of processes.

    What does not hang on the readings and jumps is worked out once.
    """

    def __init__(self, process: Startable, time: Series) -> None:
        self._time = time
        start = process.start(float(time[0]))
        steps, self._which = _steps(start.time, time)
        known = _Known(process, start, steps, time)
        self._start = known.belief
        self._parts = [
            (part, move, noise, seen, *_pattern(move))
            for part, move, noise, seen in known.parts()
        ]

    def interventions(
        self, value: Series, sd: Series, *, jumps: Sequence[Jump] = ()
    ) -> Interventions:
        """Score a shift of the level before every reading, as the function of this name.

        Parameters
        ----------
        value
            Readings; NaN where missing.
        sd
            Their standard deviations, in the unit of the readings.
        jumps
            Instants between readings at which the level, the first number of the state, jumps,
            each with its standard deviation.

        Returns
        -------
        Scores of a shift before each reading.
        """
        mean, covariance = self._start()
        total = np.zeros(len(mean))
        shape = (len(mean), len(self._time))
        score, information, left_out = (np.zeros(shape) for _ in range(3))
        lifts = _lifts(self._time, jumps)
        for part, *known in self._parts:
            _kernel("there_and_back")(
                *known, self._which, value, sd, lifts,
                mean[part], covariance[part], total[part],
                score[part], information[part], left_out[part],
            )  # fmt: skip
        return Interventions(total, score, information, left_out)


def interventions(
    process: Startable, time: Series, value: Series, sd: Series, *, jumps: Sequence[Jump] = ()
) -> Interventions:
    """Score a shift of the level, the first number of the state, before every reading at once.

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
        Shifts that are taken for given, as for `matern.run`.

    Returns
    -------
    Scores of a shift before each reading.
    """
    return Passes(process, time).interventions(value, sd, jumps=jumps)


def sample(
    process: Startable,
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
    for part, move, noise, seen in known.parts():
        mine = np.flatnonzero((owners >= part.start) & (owners < part.stop))
        own = owners[mine]
        state = mean[own] + (begun[own] @ shocks[mine, 0, :, None])[..., 0]
        roots = _roots(noise)
        drawn = np.zeros((len(mine), len(times)))
        _kernel("paths")(
            move, roots, seen, *_pattern(move), *_pattern(roots), which.astype(np.int64),
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
        self, process: Startable, belief: Belief, steps: np.ndarray, time: np.ndarray
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

    def parts(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
        """Give the same of parts of the family, as large as may be held at once."""
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
            )


def _pattern(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of a transition that are not always zero: begin of each row, and columns."""
    used = (move != 0.0).any(axis=(0, 1))
    begins = np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int64)
    return begins, np.nonzero(used)[1].astype(np.int64)


def _forward_loop(  # type: ignore[no-untyped-def]
    move, noise, seen, begins, columns, which, value, sd, lifts, mean, covariance, total
):
    size = mean.shape[1]
    half = np.zeros((size, size))
    reach = np.zeros(size)
    moved = np.zeros(size)
    weak = np.zeros(size)
    for f in range(mean.shape[0]):
        p = covariance[f]
        m = mean[f]
        s = f if seen.shape[1] > 1 else 0
        for i in range(len(value)):
            k = which[i]
            a = move[k, f]
            p[0, 0] += lifts[i]
            for r in range(size):
                drawn = 0.0
                for c in range(size):
                    half[r, c] = 0.0
                for e in range(begins[r], begins[r + 1]):
                    column = columns[e]
                    entry = a[r, column]
                    drawn += entry * m[column]
                    for c in range(size):
                        half[r, c] += entry * p[column, c]
                moved[r] = drawn
            for r in range(size):
                m[r] = moved[r]
                for c in range(r + 1):
                    entry = noise[k, f, r, c]
                    for e in range(begins[c], begins[c + 1]):
                        column = columns[e]
                        entry += half[r, column] * a[c, column]
                    p[r, c] = entry
                    p[c, r] = entry
            variance = sd[i] * sd[i]
            if np.isnan(value[i]) or np.isnan(variance):
                continue
            expected, own = 0.0, 0.0
            for r in range(size):
                entry = 0.0
                for c in range(size):
                    entry += p[r, c] * seen[i, s, c]
                reach[r] = entry
                expected += m[r] * seen[i, s, r]
            for r in range(size):
                own += reach[r] * seen[i, s, r]
            spread = own + variance
            residual = value[i] - expected
            total[f] -= 0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
            # Joseph's form, in rank-one pieces: rounding cannot make it negative.
            for r in range(size):
                gain = reach[r] / spread
                m[r] += gain * residual
                for c in range(r + 1):
                    entry = p[r, c] - gain * reach[c]
                    p[r, c] = entry
                    p[c, r] = entry
            for r in range(size):
                entry = 0.0
                for c in range(size):
                    entry += p[r, c] * seen[i, s, c]
                weak[r] = entry
            for r in range(size):
                gain = reach[r] / spread
                for c in range(r + 1):
                    other = reach[c] / spread
                    entry = p[r, c] - 0.5 * (weak[r] * other + weak[c] * gain)
                    entry += variance * gain * other
                    p[r, c] = entry
                    p[c, r] = entry


def _there_and_back_loop(  # type: ignore[no-untyped-def]
    move, noise, seen, begins, columns, which, value, sd, lifts, mean, covariance, total,
    score, information, left_out,
):  # fmt: skip
    size, count = mean.shape[1], len(value)
    half = np.zeros((size, size))
    moved = np.zeros(size)
    reaches = np.zeros((count, size))
    residuals = np.zeros(count)
    spreads = np.zeros(count)
    weak = np.zeros(size)
    pull = np.zeros(size)
    known = np.zeros((size, size))
    for f in range(mean.shape[0]):
        p = covariance[f]
        m = mean[f]
        s = f if seen.shape[1] > 1 else 0
        for i in range(count):
            k = which[i]
            a = move[k, f]
            p[0, 0] += lifts[i]
            for r in range(size):
                drawn = 0.0
                for c in range(size):
                    half[r, c] = 0.0
                for e in range(begins[r], begins[r + 1]):
                    column = columns[e]
                    entry = a[r, column]
                    drawn += entry * m[column]
                    for c in range(size):
                        half[r, c] += entry * p[column, c]
                moved[r] = drawn
            for r in range(size):
                m[r] = moved[r]
                for c in range(r + 1):
                    entry = noise[k, f, r, c]
                    for e in range(begins[c], begins[c + 1]):
                        column = columns[e]
                        entry += half[r, column] * a[c, column]
                    p[r, c] = entry
                    p[c, r] = entry
            variance = sd[i] * sd[i]
            if np.isnan(value[i]) or np.isnan(variance):
                spreads[i] = np.inf
                residuals[i] = 0.0
                for r in range(size):
                    reaches[i, r] = 0.0
                continue
            expected, own = 0.0, 0.0
            for r in range(size):
                entry = 0.0
                for c in range(size):
                    entry += p[r, c] * seen[i, s, c]
                reaches[i, r] = entry
                expected += m[r] * seen[i, s, r]
            for r in range(size):
                own += reaches[i, r] * seen[i, s, r]
            spread = own + variance
            residual = value[i] - expected
            spreads[i] = spread
            residuals[i] = residual
            total[f] -= 0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
            # Joseph's form, in rank-one pieces: rounding cannot make it negative.
            for r in range(size):
                gain = reaches[i, r] / spread
                m[r] += gain * residual
                for c in range(r + 1):
                    entry = p[r, c] - gain * reaches[i, c]
                    p[r, c] = entry
                    p[c, r] = entry
            for r in range(size):
                entry = 0.0
                for c in range(size):
                    entry += p[r, c] * seen[i, s, c]
                weak[r] = entry
            for r in range(size):
                gain = reaches[i, r] / spread
                for c in range(r + 1):
                    other = reaches[i, c] / spread
                    entry = p[r, c] - 0.5 * (weak[r] * other + weak[c] * gain)
                    entry += variance * gain * other
                    p[r, c] = entry
                    p[c, r] = entry
        for r in range(size):
            pull[r] = 0.0
            for c in range(size):
                known[r, c] = 0.0
        for back in range(count):
            i = count - 1 - back
            spread = spreads[i]
            if not np.isinf(spread):
                # The reading, then what of the state it has left: keep = 1 - gain seen^T.
                along, within = 0.0, 0.0
                for r in range(size):
                    along += reaches[i, r] * pull[r]
                    entry = 0.0
                    for c in range(size):
                        entry += known[r, c] * reaches[i, c]
                    moved[r] = entry / spread
                    within += entry * reaches[i, r]
                along /= spread
                within /= spread * spread
                own = residuals[i] / spread - along
                left_out[f, i] = own / np.sqrt(1.0 / spread + within)
                weight = 1.0 / spread + within
                for r in range(size):
                    pull[r] += seen[i, s, r] * own
                for r in range(size):
                    for c in range(size):
                        known[r, c] += (
                            seen[i, s, r] * seen[i, s, c] * weight
                            - seen[i, s, r] * moved[c]
                            - moved[r] * seen[i, s, c]
                        )
            # Before the transition, as a shift of the level passes through it unchanged.
            k = which[i]
            a = move[k, f]
            for r in range(size):
                moved[r] = 0.0
                for c in range(size):
                    half[r, c] = 0.0
            for r in range(size):
                for e in range(begins[r], begins[r + 1]):
                    column = columns[e]
                    entry = a[r, column]
                    moved[column] += entry * pull[r]
                    for c in range(size):
                        half[column, c] += entry * known[r, c]
            for r in range(size):
                pull[r] = moved[r]
                for c in range(size):
                    known[r, c] = 0.0
            for r in range(size):
                for e in range(begins[r], begins[r + 1]):
                    column = columns[e]
                    entry = a[r, column]
                    for c in range(size):
                        known[c, column] += half[c, r] * entry
            score[f, i] = pull[0]
            information[f, i] = known[0, 0]


def _roots_loop(covariances, roots):  # type: ignore[no-untyped-def]
    steps, family, size, _ = covariances.shape
    for k in range(steps):
        for f in range(family):
            for c in range(size):
                left = covariances[k, f, c, c]
                whole = left
                for e in range(c):
                    left -= roots[k, f, c, e] * roots[k, f, c, e]
                # What rounding has left of nothing.
                if left <= 1e-14 * whole:
                    continue
                root = np.sqrt(left)
                roots[k, f, c, c] = root
                for r in range(c + 1, size):
                    entry = covariances[k, f, r, c]
                    for e in range(c):
                        entry -= roots[k, f, r, e] * roots[k, f, c, e]
                    roots[k, f, r, c] = entry / root


def _paths_loop(  # type: ignore[no-untyped-def]
    move, roots, seen, begins, columns, root_begins, root_columns, which, owners, rows, state,
    shocks, drawn,
):  # fmt: skip
    size = state.shape[1]
    moved = np.zeros(size)
    for n in range(state.shape[0]):
        f = owners[n]
        s = f if seen.shape[1] > 1 else 0
        x = state[n]
        z = shocks[rows[n]]
        for i in range(drawn.shape[1]):
            k = which[i]
            for r in range(size):
                entry = 0.0
                for e in range(begins[r], begins[r + 1]):
                    entry += move[k, f, r, columns[e]] * x[columns[e]]
                for e in range(root_begins[r], root_begins[r + 1]):
                    entry += roots[k, f, r, root_columns[e]] * z[i + 1, root_columns[e]]
                moved[r] = entry
            entry = 0.0
            for r in range(size):
                x[r] = moved[r]
                entry += moved[r] * seen[i, s, r]
            drawn[n, i] = entry


_LOOPS: dict[str, Callable[..., Any]] = {
    "forward": _forward_loop,
    "there_and_back": _there_and_back_loop,
    "roots": _roots_loop,
    "paths": _paths_loop,
}


@functools.cache
def _kernel(name: str) -> Callable[..., Any]:
    """Compile a loop at its first call, so that an import costs nothing.

    Unwrapped, for in tests every function wears a checker of shapes.
    """
    import numba

    compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True)(
        inspect.unwrap(_LOOPS[name])
    )
    return compiled
