"""Compiled recursions of a family of state-space processes over a series, there and back.

Imported by `filtering` when first called, as the compiler takes half a second to import.
Transitions are mostly zeros: `begins` and `columns` say where each row of them has entries.
All arrays are written in place. Axes: f member of the family, i reading, k time step that
differs from others, r, c, e entries of the state.
"""

import inspect
from collections.abc import Callable
from typing import Any

import numba
import numpy as np


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    # Unwrapped, for in tests every function wears a checker of shapes.
    made: Callable[..., Any] = numba.njit(cache=True, nogil=True)(inspect.unwrap(function))
    return made


@_compiled
def _move(a, begins, columns, noise, m, p, half, moved):  # type: ignore[no-untyped-def]
    """Carry mean and covariance over a time step."""
    size = len(m)
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
            entry = noise[r, c]
            for e in range(begins[c], begins[c + 1]):
                column = columns[e]
                entry += half[r, column] * a[c, column]
            p[r, c] = entry
            p[c, r] = entry


@_compiled
def _read(seen, value, sd, m, p, reach, weak):  # type: ignore[no-untyped-def]
    """Update mean and covariance by a reading.

    Returned are its residual, the variance of that, and what it adds to the log-likelihood; of
    a missing one 0, infinity and 0.
    """
    variance = sd * sd
    if np.isnan(value) or np.isnan(variance):
        return 0.0, np.inf, 0.0
    size = len(m)
    expected, own = 0.0, 0.0
    for r in range(size):
        entry = 0.0
        for c in range(size):
            entry += p[r, c] * seen[c]
        reach[r] = entry
        expected += m[r] * seen[r]
    for r in range(size):
        own += reach[r] * seen[r]
    spread = own + variance
    residual = value - expected
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
            entry += p[r, c] * seen[c]
        weak[r] = entry
    for r in range(size):
        gain = reach[r] / spread
        for c in range(r + 1):
            other = reach[c] / spread
            entry = p[r, c] - 0.5 * (weak[r] * other + weak[c] * gain)
            entry += variance * gain * other
            p[r, c] = entry
            p[c, r] = entry
    gained = -0.5 * (residual * residual / spread + np.log(2.0 * np.pi * spread))
    return residual, spread, gained


@_compiled
def _read_back(  # type: ignore[no-untyped-def]
    seen, residual, spread, reach, score, information, moved
):
    """Take a reading into score and information; its pull on the rest, and the weight of it.

    What the reading has left of the state is keep = 1 - gain seen^T.
    """
    size = len(score)
    along, within = 0.0, 0.0
    for r in range(size):
        along += reach[r] * score[r]
        entry = 0.0
        for c in range(size):
            entry += information[r, c] * reach[c]
        moved[r] = entry / spread
        within += entry * reach[r]
    pull = residual / spread - along / spread
    weight = 1.0 / spread + within / (spread * spread)
    for r in range(size):
        score[r] += seen[r] * pull
        for c in range(size):
            information[r, c] += (
                seen[r] * seen[c] * weight - seen[r] * moved[c] - moved[r] * seen[c]
            )
    return pull, weight


@_compiled
def _move_back(  # type: ignore[no-untyped-def]
    a, begins, columns, score, information, half, moved
):
    """Carry score and information to before a time step."""
    size = len(score)
    for r in range(size):
        moved[r] = 0.0
        for c in range(size):
            half[r, c] = 0.0
    for r in range(size):
        for e in range(begins[r], begins[r + 1]):
            column = columns[e]
            entry = a[r, column]
            moved[column] += entry * score[r]
            for c in range(size):
                half[column, c] += entry * information[r, c]
    for r in range(size):
        score[r] = moved[r]
        for c in range(size):
            information[r, c] = 0.0
    for r in range(size):
        for e in range(begins[r], begins[r + 1]):
            column = columns[e]
            entry = a[r, column]
            for c in range(size):
                information[c, column] += half[c, r] * entry


@_compiled
def forward(  # type: ignore[no-untyped-def]
    move, noise, seen, begins, columns, which, value, sd, lifts, mean, covariance, total,
    residuals, spreads,
):  # fmt: skip
    """Filter; `residuals` and `spreads` [family, time] are filled unless they are empty."""
    size, count = mean.shape[1], len(value)
    half = np.zeros((size, size))
    reach, moved, weak = np.zeros(size), np.zeros(size), np.zeros(size)
    for f in range(mean.shape[0]):
        m, p = mean[f], covariance[f]
        s = f if seen.shape[1] > 1 else 0
        for i in range(count):
            k = which[i]
            p[0, 0] += lifts[i]
            _move(move[k, f], begins, columns, noise[k, f], m, p, half, moved)
            residual, spread, gained = _read(seen[i, s], value[i], sd[i], m, p, reach, weak)
            total[f] += gained
            if residuals.size:
                residuals[f, i], spreads[f, i] = residual, spread


@_compiled
def there_and_back(  # type: ignore[no-untyped-def]
    move, noise, seen, begins, columns, which, value, sd, lifts, mean, covariance, total,
    scores, informations, pulls, weights, asked, smoothed,
):  # fmt: skip
    """Filter, and carry score and information of the state back.

    Filled are, of each member and reading, those of the level before it [family, time], pull
    and weight of the reading itself [family, time], and, for the rows `asked` [row, time,
    state], mean and variance given all readings `smoothed` [family, row, 2, time].
    """
    size, count, rows = mean.shape[1], len(value), len(asked)
    half, information = np.zeros((size, size)), np.zeros((size, size))
    moved, weak, score = np.zeros(size), np.zeros(size), np.zeros(size)
    reaches = np.zeros((count, size))
    residuals, spreads = np.zeros(count), np.zeros(count)
    kept = count if rows else 0
    means, covariances = np.zeros((kept, size)), np.zeros((kept, size, size))
    for f in range(mean.shape[0]):
        m, p = mean[f], covariance[f]
        s = f if seen.shape[1] > 1 else 0
        for i in range(count):
            k = which[i]
            p[0, 0] += lifts[i]
            _move(move[k, f], begins, columns, noise[k, f], m, p, half, moved)
            if rows:
                means[i], covariances[i] = m, p
            residuals[i], spreads[i], gained = _read(
                seen[i, s], value[i], sd[i], m, p, reaches[i], weak
            )
            total[f] += gained
        score[:], information[:] = 0.0, 0.0
        for back in range(count):
            i = count - 1 - back
            if not np.isinf(spreads[i]):
                pulls[f, i], weights[f, i] = _read_back(
                    seen[i, s], residuals[i], spreads[i], reaches[i], score, information, moved
                )
            for row in range(rows):
                found, own, gained = 0.0, 0.0, 0.0
                for r in range(size):
                    entry = 0.0
                    for c in range(size):
                        entry += covariances[i, r, c] * asked[row, i, c]
                    weak[r] = entry
                for r in range(size):
                    found += asked[row, i, r] * means[i, r] + weak[r] * score[r]
                    own += asked[row, i, r] * weak[r]
                    for c in range(size):
                        gained += weak[r] * information[r, c] * weak[c]
                smoothed[f, row, 0, i], smoothed[f, row, 1, i] = found, own - gained
            # Before the transition, as a shift of the level passes through it unchanged.
            _move_back(move[which[i], f], begins, columns, score, information, half, moved)
            scores[f, i], informations[f, i] = score[0], information[0, 0]


@_compiled
def roots(covariances, found):  # type: ignore[no-untyped-def]
    """Lower triangular roots of covariances [step, family, state, state]."""
    steps, family, size, _ = covariances.shape
    for k in range(steps):
        for f in range(family):
            for c in range(size):
                left = covariances[k, f, c, c]
                whole = left
                for e in range(c):
                    left -= found[k, f, c, e] * found[k, f, c, e]
                # What rounding has left of nothing.
                if left <= 1e-14 * whole:
                    continue
                root = np.sqrt(left)
                found[k, f, c, c] = root
                for r in range(c + 1, size):
                    entry = covariances[k, f, r, c]
                    for e in range(c):
                        entry -= found[k, f, r, e] * found[k, f, c, e]
                    found[k, f, r, c] = entry / root


@_compiled
def paths(  # type: ignore[no-untyped-def]
    move, roots, seen, begins, columns, root_begins, root_columns, which, owners, rows, state,
    shocks, drawn,
):  # fmt: skip
    """Draw a path from each state; `owners` are the members they belong to."""
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
