r"""Compiled time stepping of a plant.

Between events the state obeys :math:`\dot x = A x + B_u u(t) + B_y y(t)`, where the forces
:math:`y = f(w, t)` hang on what is observed of the state, :math:`w = H x`. A step takes y as
the parabola through three Radau points (Hairer and Wanner 1996, section IV.5: order 5), for
which the linear part is solved exactly; Newton's method finds y. Steps are a sample interval
halved as often as the parabola misses the force at the step's beginning, which closes in on
kinks. In the shortest, instants at which friction begins to stick or slide, and those at which
a law jumps, are located, and slopes jump as they must (Leine and Nijmeijer 2004, chapter 7).

All of it stands in one file, for the compiler keeps its code by file and would not notice that
another has changed. Axis names: states, w observed, c channel of force, p slope, u input.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from slowtime.dynamics.effects.compilation import ROUND, call_law, compiled, sum_rows, view_of

Reals = np.ndarray[Any, np.dtype[np.float64]]
Whole = np.ndarray[Any, np.dtype[np.int64]]

RADAU = ((4 - math.sqrt(6)) / 10, (4 + math.sqrt(6)) / 10, 1.0)
_C1, _C2 = RADAU[0], RADAU[1]
_LEFT_1 = _C2 / ((_C1 - _C2) * (_C1 - 1.0))
_LEFT_2 = _C1 / ((_C2 - _C1) * (_C2 - 1.0))
_LEFT_3 = _C1 * _C2 / ((1.0 - _C1) * (1.0 - _C2))

FRICTION, CHANNEL, SEEN, STATES, FIRST, COUNT = 0, 1, 2, 3, 4, 5
"""Columns of the table of effects: friction or not, its first channel and observation, how many
internal states, its first parameter and how many."""

CONVERGED = 1e-9
"""Change of a force, over the largest so far, at which Newton's method has converged."""
NUDGE = 1e-5
"""Step of differences, over the largest value so far."""
HAIR = 1e-9
"""Of a step: what instants are told apart by."""
EVENTS = 24
"""Events that one shortest step may hold; what is left of it then passes without."""
GIVE_UP = 2000
"""Steps a sample, over the whole of a run, at which it is given up."""


BOUND = 1e60
"""Motion beyond which a run is given up, in any unit."""


class System(NamedTuple):
    """What a run does not change: laws, matrices, and their slopes to linear parameters.

    `matrix` gives the rate of the state by (state; input; force). `big` does so for a step,
    for each level, a sample interval halved so many times: rows (state at the end; what is
    seen at the three points), columns (state; input by power of time; force by point and
    channel). What is `by_column` has the columns of another in its rows, which zeros make
    longer. Slopes of `matrix` and `big` to linear parameters have a row for each column of
    these, and in it (row; parameter), whole rounds of parameters. `column` says which slope
    belongs to a law's parameter, or -1; `jumps` the instants at which laws jump, and
    `jump_columns` the slope of each, or -1. Inputs beyond those of the matrices drive slopes
    only: `driven` says which, and through which input.
    """

    table: Whole
    laws: Whole
    p: Reals
    column: Whole
    jumps: Reals
    jump_columns: Whole
    driven: Whole
    seeing: Reals
    matrix: Reals
    slope_matrix: Reals
    big: Reals
    slope_big: Reals
    by_column: Reals
    matrix_by_column: Reals
    seeing_by_column: Reals


class Now(NamedTuple):
    """What a run changes, and room for it: state, slopes, modes, the largest values so far.

    A mode is 1 or -1 for friction that slides, by direction, and 0 where it sticks. `v` is
    (state; input; force), `g` the same over a step, as `big` has it. Slopes are as many as
    `padded` makes them, those beyond what is asked zero; `by_linear` is what linear parameters
    do by themselves, `nought` a round of zeros.
    """

    x: Reals
    s: Reals
    modes: Reals
    largest_y: Reals
    largest_w: Reals
    v: Reals
    slope_v: Reals
    rate: Reals
    slope_rate: Reals
    w: Reals
    slope_w: Reals
    limit: Reals
    by_seen: Reals
    by_parameter: Reals
    g: Reals
    room: Reals
    slope_room: Reals
    y: Reals
    points: Reals
    newton: Reals
    inverse: Reals
    right: Reals
    slope_right: Reals
    part: Reals
    stuck: Reals
    stuck_right: Reals
    stuck_slope: Reals
    x_0: Reals
    s_0: Reals
    x_1: Reals
    s_1: Reals
    before: Reals
    moved: Reals
    by_linear: Reals
    nought: Reals


def padded(count: int) -> int:
    """Make a number of slopes one of whole rounds."""
    return -(-count // ROUND) * ROUND


def places(system: System, now: Now) -> Whole:
    """Where all arrays stand in memory, and their shapes: one row an array.

    Compiled functions take this one table and find in it what they need; to hand them the
    arrays would take the compiler five times as long. The arrays must outlive the table.
    """
    found = np.zeros((len(system) + len(now), 5), dtype=np.int64)
    for row, array in zip(found, (*system, *now), strict=True):
        assert array.flags.c_contiguous
        assert array.dtype in (np.float64, np.int64)
        row[0] = array.ctypes.data
        row[1 : 1 + array.ndim] = array.shape
    return found


(
    TABLE,
    LAWS,
    P,
    COLUMN,
    JUMPS,
    JUMP_COLUMNS,
    DRIVEN,
    SEEING,
    MATRIX,
    SLOPE_MATRIX,
    BIG,
    SLOPE_BIG,
    BY_COLUMN,
    MATRIX_BY_COLUMN,
    SEEING_BY_COLUMN,
) = range(15)
(X, S, MODES, LARGEST_Y, LARGEST_W, V, SLOPE_V, RATE, SLOPE_RATE, W, SLOPE_W) = range(15, 26)
(LIMIT, BY_SEEN, BY_PARAMETER, G, ROOM, SLOPE_ROOM, Y, POINTS, NEWTON, INVERSE) = range(26, 36)
(RIGHT, SLOPE_RIGHT, PART, STUCK, STUCK_RIGHT, STUCK_SLOPE, X_0, S_0, X_1, S_1) = range(36, 46)
BEFORE, MOVED, BY_LINEAR, NOUGHT = range(46, 50)
"""Rows of that table."""


line, grid = view_of(numba.float64, 1), view_of(numba.float64, 2)
cube = view_of(numba.float64, 3)
whole_line, whole_grid = view_of(numba.int64, 1), view_of(numba.int64, 2)
"""From that table and a row, the array: of real numbers by axes, and of whole ones."""


@compiled
def plain(number: int) -> int:
    """Hide a number from the compiler, which would compile what is called anew for it."""
    return number * 1


@compiled
def address(matrix: Reals, row: int, column: int) -> int:
    """Memory address of an entry of a matrix.

    Parameters
    ----------
    matrix
        Matrix, stored row by row.
    row, column
        Indices of the entry.

    Returns
    -------
    Address [bytes].
    """
    return int(matrix.ctypes.data + 8 * (row * matrix.shape[1] + column))


@compiled
def by_linear(store: Whole, shares: Reals, slopes: Reals) -> None:
    """Compute what linear parameters do by themselves: slopes of a matrix, times its columns.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    shares
        Factor of each column of the matrix [column].
    slopes
        Slopes of the matrix, laid out by column [column, row and parameter].
    """
    found, nought = line(store, BY_LINEAR), line(store, NOUGHT)
    width = slopes.shape[1]
    for i in range(0, width, ROUND):
        sum_rows(
            found.ctypes.data + 8 * i,
            nought.ctypes.data,
            shares.ctypes.data,
            len(slopes),
            address(slopes, plain(0), i),
            width,
        )


@compiled
def carry(store: Whole, matrix: Reals, linear: int, slope: Reals, found: Reals) -> None:
    """Compute the slopes of a matrix times the state, and add those of `by_linear`.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    matrix
        The matrix [row, column]; its first columns belong to the state.
    linear
        Number of slopes to linear parameters, in whole rounds.
    slope
        Slopes of the state [state, slope].
    found
        Slopes of the product [row, slope]; written.
    """
    own, nought = line(store, BY_LINEAR), line(store, NOUGHT)
    states, width = slope.shape
    for r in range(len(found)):
        for j in range(0, width, ROUND):
            start = nought.ctypes.data
            if j < linear:
                start = own.ctypes.data + 8 * (r * linear + j)
            shares, rows = address(matrix, r, plain(0)), address(slope, plain(0), j)
            sum_rows(address(found, r, j), start, shares, states, rows, width)


@compiled
def solve(matrix: Reals, right: Reals, size: int) -> None:
    """Solve a system of linear equations in place, by elimination with pivoting.

    Parameters
    ----------
    matrix
        Matrix [row, column]; overwritten.
    right
        Right sides [row, side]; overwritten by the solutions.
    size
        Number of leading rows that make the system.
    """
    sides = right.shape[1]
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            for j in range(k, size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            for j in range(sides):
                right[k, j], right[best, j] = right[best, j], right[k, j]
        for i in range(k + 1, size):
            share = matrix[i, k] / matrix[k, k]
            if share != 0.0:
                for j in range(k + 1, size):
                    matrix[i, j] -= share * matrix[k, j]
                for j in range(sides):
                    right[i, j] -= share * right[k, j]
    for k in range(size - 1, -1, -1):
        for i in range(k + 1, size):
            for j in range(sides):
                right[k, j] -= matrix[k, i] * right[i, j]
        for j in range(sides):
            right[k, j] /= matrix[k, k]


@compiled
def force_of(law: int, row: Whole, mode: float, w: Reals, t: float, p: Reals) -> float:
    """Value of one channel of one effect; that of sliding friction has its sign.

    Parameters
    ----------
    law
        Address of the compiled law.
    row
        Row of the table of effects.
    mode
        Mode of friction: 1 or -1 where it slides, 0 where it sticks.
    w
        Observations of the state that laws see [observation].
    t
        Time [s].
    p
        Parameters of all laws [parameter].

    Returns
    -------
    Force [N], or rate of an internal state.
    """
    seen = row[SEEN]
    z, own = w.ctypes.data + 8 * (seen + 2), p.ctypes.data + 8 * row[FIRST]
    if row[FRICTION] == 1:
        sign = 1.0 if mode == 0.0 else mode
        speed = max(mode * w[seen + 1], 0.0)
        return float(sign * call_law(law, w[seen], speed, t, z, own))
    return float(call_law(law, w[seen], w[seen + 1], t, z, own))


@compiled
def forces(store: Whole, modes: Reals, w: Reals, t: float, y: Reals, first: int) -> None:
    """Compute all channels; of friction that sticks, the most that it holds.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    modes
        Mode of each effect [effect].
    w
        Observations of the state that laws see [observation].
    t
        Time [s].
    y
        Column that takes the channels [row, 1]; written.
    first
        Row of the first channel.
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    p = line(store, P)
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        for c in range(channel, channel + 1 + table[i, STATES]):
            y[first + c, 0] = force_of(laws[c], table[i], modes[i], w, t, p)


@compiled
def slopes_of_laws(store: Whole, w: Reals, t: float, point: int) -> None:
    """Differentiate all channels to observations and parameters, by central differences.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    w
        Observations of the state that laws see [observation].
    t
        Time [s].
    point
        Index of the Radau point whose slopes are written.
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    column, modes = whole_line(store, COLUMN), line(store, MODES)
    largest_w, by_seen = line(store, LARGEST_W), cube(store, BY_SEEN)
    by_parameter, p = grid(store, BY_PARAMETER), line(store, P)
    for i in range(len(table)):
        channel, seen, first = table[i, CHANNEL], table[i, SEEN], table[i, FIRST]
        seen_count = 2 + table[i, STATES]
        for c in range(channel, channel + 1 + table[i, STATES]):
            for k in range(seen_count + table[i, COUNT]):
                at = seen + k if k < seen_count else first + k - seen_count
                if k >= seen_count and column[at] < 0:
                    continue
                varied = w if k < seen_count else p
                kept = varied[at]
                step = NUDGE * abs(kept)
                if k < seen_count:
                    step = max(step, NUDGE * largest_w[at])
                if step == 0.0:
                    step = 1e-8
                varied[at] = kept + step
                slope = force_of(laws[c], table[i], modes[i], w, t, p)
                varied[at] = kept - step
                slope -= force_of(laws[c], table[i], modes[i], w, t, p)
                varied[at] = kept
                if k < seen_count:
                    by_seen[point, c, k] = slope / (2.0 * step)
                else:
                    by_parameter[c, k - seen_count] = slope / (2.0 * step)


@compiled
def spread_slopes(
    store: Whole, point: int, slope_w: Reals, at: int, slope_y: Reals, first: int
) -> None:
    """Apply the chain rule from observations to forces; of what sticks, slopes are zero.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    point
        Index of the Radau point.
    slope_w
        Slopes of the observations [row, slope].
    at
        Row of the first observation.
    slope_y
        Slopes of the forces [row, slope]; written.
    first
        Row of the first channel.
    """
    table, column = whole_grid(store, TABLE), whole_line(store, COLUMN)
    modes, by_seen = line(store, MODES), cube(store, BY_SEEN)
    by_parameter, nought = grid(store, BY_PARAMETER), line(store, NOUGHT)
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        for c in range(channel, channel + 1 + table[i, STATES]):
            count = 2 + table[i, STATES]
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                count = 0
            shares = by_seen.ctypes.data + 8 * (point * by_seen.shape[1] + c) * by_seen.shape[2]
            for j in range(0, slope_y.shape[1], ROUND):
                rows = address(slope_w, at + table[i, SEEN], j)
                found = address(slope_y, first + c, j)
                sum_rows(found, nought.ctypes.data, shares, count, rows, slope_y.shape[1])
            if count == 0:
                continue
            for k in range(table[i, COUNT]):
                j = column[table[i, FIRST] + k]
                if j >= 0:
                    slope_y[first + c, j] += by_parameter[c, k]


@compiled
def stick(store: Whole, rates: Reals, v: Reals, right: Reals) -> None:
    """Add the forces that keep the speeds of sticking friction, and their effect on the rates.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    rates
        Rates of the state, or their slopes [state, side]; changed.
    v
        State, inputs and forces, or their slopes [row, side]; forces are written.
    right
        Room for the right sides [friction, side].
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    seeing, matrix = grid(store, SEEING), grid(store, MATRIX)
    modes, stuck = line(store, MODES), grid(store, STUCK)
    first = matrix.shape[1] - len(laws)
    row = plain(0)
    for i in range(len(table)):
        if table[i, FRICTION] == 0 or modes[i] != 0.0:
            continue
        speed, col = table[i, SEEN] + 1, 0
        for j in range(right.shape[1]):
            right[row, j] = 0.0
            for k in range(len(rates)):
                right[row, j] -= seeing[speed, k] * rates[k, j]
        for j in range(len(table)):
            if table[j, FRICTION] == 1 and modes[j] == 0.0:
                stuck[row, col] = 0.0
                for k in range(len(rates)):
                    column = first + table[j, CHANNEL]
                    stuck[row, col] += seeing[speed, k] * matrix[k, column]
                col += 1
        row += 1
    if row == 0:
        return
    solve(stuck, right, row)
    row = plain(0)
    for i in range(len(table)):
        if table[i, FRICTION] == 1 and modes[i] == 0.0:
            column = first + table[i, CHANNEL]
            for j in range(right.shape[1]):
                v[column, j] = right[row, j]
                for k in range(len(rates)):
                    rates[k, j] += matrix[k, column] * right[row, j]
            row += 1


@compiled
def see(store: Whole, x: Reals) -> None:
    """Compute what laws see of a state.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    x
        State [state].
    """
    seeing, w, nought = grid(store, SEEING_BY_COLUMN), line(store, W), line(store, NOUGHT)
    width = seeing.shape[1]
    for o in range(0, len(w), ROUND):
        found, rows = w.ctypes.data + 8 * o, address(seeing, plain(0), o)
        sum_rows(found, nought.ctypes.data, x.ctypes.data, len(x), rows, width)


@compiled
def flow(store: Whole, x: Reals, t: float, coefficients: Reals, s: float) -> None:
    """Compute the forces at one instant, those of sticking too, and the rate of the state.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    x
        State [state].
    t
        Time [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    matrix, modes = grid(store, MATRIX_BY_COLUMN), line(store, MODES)
    v, rate, nought = grid(store, V), grid(store, RATE), line(store, NOUGHT)
    w, stuck_right = line(store, W), grid(store, STUCK_RIGHT)
    states, all_of = len(x), len(matrix)
    first = all_of - len(laws)
    see(store, x)
    forces(store, modes, w, t, v, first)
    for i in range(len(table)):
        if table[i, FRICTION] == 1 and modes[i] == 0.0:
            v[first + table[i, CHANNEL], 0] = 0.0
    for i in range(first - states):
        value = 0.0
        for j in range(coefficients.shape[1] - 1, -1, -1):
            value = value * s + coefficients[i, j]
        v[states + i, 0] = value
    for k in range(states):
        v[k, 0] = x[k]
    width = matrix.shape[1]
    for k in range(0, states, ROUND):
        found, rows = rate.ctypes.data + 8 * k, address(matrix, plain(0), k)
        sum_rows(found, nought.ctypes.data, v.ctypes.data, all_of, rows, width)
    stick(store, rate, v, stuck_right)


@compiled
def slopes_of_flow(store: Whole, slope: Reals, t: float, coefficients: Reals, s: float) -> None:
    """Compute the slopes of the forces and rates that `flow` has just computed.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    slope
        Slopes of the state [state, slope].
    t
        Time [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    """
    laws, driven = whole_line(store, LAWS), whole_grid(store, DRIVEN)
    seeing, matrix = grid(store, SEEING), grid(store, MATRIX)
    slope_matrix = grid(store, SLOPE_MATRIX)
    slope_v, slope_rate = grid(store, SLOPE_V), grid(store, SLOPE_RATE)
    w, slope_w = line(store, W), grid(store, SLOPE_W)
    stuck_slope = grid(store, STUCK_SLOPE)
    states, slopes = slope.shape
    channels, all_of = len(laws), matrix.shape[1]
    first = all_of - channels
    by_linear(store, line(store, V), slope_matrix)
    carry(store, matrix, slope_matrix.shape[1] // states, slope, slope_rate)
    if len(driven) > 0:
        for k in range(states, first):
            for j in range(slopes):
                slope_v[k, j] = 0.0
    for i in range(len(driven)):
        value = 0.0
        for j in range(coefficients.shape[1] - 1, -1, -1):
            value = value * s + coefficients[first - states + i, j]
        slope_v[states + driven[i, 1], driven[i, 0]] += value
    slopes_of_laws(store, w, t, plain(0))
    for o in range(len(w)):
        for j in range(slopes):
            slope_w[o, j] = 0.0
        for k in range(states):
            share = seeing[o, k]
            if share != 0.0:
                for j in range(slopes):
                    slope_w[o, j] += share * slope[k, j]
    spread_slopes(store, plain(0), slope_w, plain(0), slope_v, first)
    # Most inputs do not hang on any parameter.
    moving = plain(states) if len(driven) > 0 else first
    for k in range(states):
        for r in range(moving, all_of):
            share = matrix[k, r]
            if share != 0.0:
                for j in range(slopes):
                    slope_rate[k, j] += share * slope_v[r, j]
    stick(store, slope_rate, slope_v, stuck_slope)


@compiled
def settle(store: Whole, t: float, coefficients: Reals, s: float) -> None:
    """Let friction whose mode is 0 stick where it can hold, and slide where it cannot.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    t
        Time [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    matrix, x = grid(store, MATRIX), line(store, X)
    modes, v = line(store, MODES), grid(store, V)
    w, limit = line(store, W), grid(store, LIMIT)
    first = matrix.shape[1] - len(laws)
    for _ in range(2 * len(table)):
        flow(store, x, t, coefficients, s)
        forces(store, modes, w, t, limit, plain(0))
        worst, over, sign = plain(-1), 1.0, 1.0
        for i in range(len(table)):
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                c = table[i, CHANNEL]
                held, most = v[first + c, 0], limit[c, 0]
                if abs(held) > over * most:
                    worst, sign = i, math.copysign(1.0, held)
                    over = abs(held) / most if most > 0.0 else np.inf
        if worst < 0:
            return
        modes[worst] = sign


@compiled
def crawl(
    store: Whole,
    t: float,
    h: float,
    coefficients: Reals,
    s: float,
    width: float,
    slopes: int,
) -> None:
    """Step from `x`, `s` to `x_1`, `s_1` by the classical Runge-Kutta rule of order 4.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    t
        Time [s].
    h
        Length of the step [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    width
        Length of the step over the sample interval [1].
    slopes
        Number of slopes to carry along.
    """
    x, slope = line(store, X), grid(store, S)
    rate, slope_rate = grid(store, RATE), grid(store, SLOPE_RATE)
    x_0, s_0 = line(store, X_0), grid(store, S_0)
    x_1, s_1 = line(store, X_1), grid(store, S_1)
    states = len(x)
    for k in range(states):
        x_0[k] = x_1[k] = x[k]
        for j in range(slopes):
            s_0[k, j] = s_1[k, j] = slope[k, j]
    for stage in range(4):
        # A hair before the end, so that a law that jumps there has not done so.
        share = (0.0, 0.5, 0.5, 1.0 - HAIR)[stage]
        weight, ahead = (h / 6, h / 3, h / 3, h / 6)[stage], (h / 2, h / 2, h, 0.0)[stage]
        flow(store, x_0, t + share * h, coefficients, s + share * width)
        if slopes > 0:
            slopes_of_flow(store, s_0, t + share * h, coefficients, s + share * width)
        for k in range(states):
            x_1[k] += weight * rate[k, 0]
            x_0[k] = x[k] + ahead * rate[k, 0]
            for j in range(slopes):
                s_1[k, j] += weight * slope_rate[k, j]
                s_0[k, j] = slope[k, j] + ahead * slope_rate[k, j]


@compiled
def margin(store: Whole, i: int, x: Reals, t: float, coefficients: Reals, s: float) -> float:
    """Distance of friction from its next event.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    i
        Index of the effect.
    x
        State [state].
    t
        Time [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].

    Returns
    -------
    Speed in its direction [m/s] while it slides, force to spare [N] while it sticks.
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    p, matrix = line(store, P), grid(store, MATRIX)
    modes, v = line(store, MODES), grid(store, V)
    w = line(store, W)
    c = table[i, CHANNEL]
    flow(store, x, t, coefficients, s)
    if modes[i] != 0.0:
        return float(modes[i] * w[table[i, SEEN] + 1])
    most = force_of(laws[c], table[i], 0.0, w, t, p)
    held = v[matrix.shape[1] - len(laws) + c, 0]
    return float(most * (1.0 + 1e-9) - abs(held))


@compiled
def creep(
    store: Whole, t: float, h: float, coefficients: Reals, s: float, width: float
) -> None:
    """Take the shortest step, with every event within it at its instant.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    t
        Time [s].
    h
        Length of the step [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    width
        Length of the step over the sample interval [1].
    """
    table, jumps = whole_grid(store, TABLE), line(store, JUMPS)
    x, slope = line(store, X), grid(store, S)
    x_1, s_1 = line(store, X_1), grid(store, S_1)
    states, slopes = slope.shape
    left, pace = h, width / h
    for count in range(EVENTS):
        step, which, jump = left, plain(-1), plain(-1)
        for j in range(len(jumps)):
            ahead = jumps[j] - t
            if HAIR * h < ahead and ahead <= step * (1.0 + HAIR):
                step, jump = min(ahead, left), j
        crawl(store, t, step, coefficients, s, pace * step, plain(0))
        for i in range(len(table)):
            if table[i, FRICTION] == 0 or count == EVENTS - 1:
                continue
            above = margin(store, i, x_1, t + step, coefficients, s + pace * step)
            if above >= 0.0:
                continue
            low, high = 0.0, step
            below = margin(store, i, x, t, coefficients, s)
            while high - low > 1e-12 * h and below > 0.0:
                # Regula falsi, one end halved where the other lags.
                guess = low + (high - low) * min(max(below / (below - above), 0.02), 0.98)
                crawl(store, t, guess, coefficients, s, pace * guess, plain(0))
                found = margin(store, i, x_1, t + guess, coefficients, s + pace * guess)
                if found < 0.0:
                    high, above, below = guess, found, 0.5 * below
                else:
                    low, below, above = guess, found, 0.5 * above
            step, which, jump = high, i, plain(-1)
            crawl(store, t, step, coefficients, s, pace * step, plain(0))
        crawl(store, t, step, coefficients, s, pace * step, slopes)
        for k in range(states):
            x[k] = x_1[k]
            for j in range(slopes):
                slope[k, j] = s_1[k, j]
        t, s, left = t + step, s + pace * step, left - step
        if which >= 0 or jump >= 0:
            switch(store, t, coefficients, s, which, jump, HAIR * h)
        if left <= HAIR * h:
            return


@compiled
def switch(
    store: Whole,
    t: float,
    coefficients: Reals,
    s: float,
    which: int,
    jump: int,
    hair: float,
) -> None:
    """Change the mode of friction `which`, or pass `jump`; slopes jump with the rate.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    t
        Time [s].
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Share of the sample interval that has passed [1].
    which
        Index of the effect whose friction changes its mode; -1 for none.
    jump
        Index of the instant at which a law jumps; -1 for none.
    hair
        Time by which before and after the event are told apart [s].
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    jump_columns, seeing = whole_line(store, JUMP_COLUMNS), grid(store, SEEING)
    matrix, x = grid(store, MATRIX), line(store, X)
    slope, modes = grid(store, S), line(store, MODES)
    rate, w = grid(store, RATE), line(store, W)
    before, moved = line(store, BEFORE), line(store, MOVED)
    states, slopes = slope.shape
    flow(store, x, t - hair, coefficients, s)
    for k in range(states):
        before[k] = rate[k, 0]
    for j in range(slopes):
        moved[j] = 0.0
    if which >= 0 and modes[which] != 0.0:
        speed = table[which, SEEN] + 1
        column = matrix.shape[1] - len(laws) + table[which, CHANNEL]
        pace, size, past = 0.0, 0.0, w[speed]
        for k in range(states):
            pace += seeing[speed, k] * before[k]
            size += seeing[speed, k] * matrix[k, column]
        for k in range(states):
            for j in range(slopes):
                if pace != 0.0:
                    moved[j] -= seeing[speed, k] * slope[k, j] / pace
            x[k] -= matrix[k, column] * past / size
    if which >= 0:
        modes[which] = 0.0
    if jump >= 0 and jump_columns[jump] >= 0:
        moved[jump_columns[jump]] += 1.0
    settle(store, t + hair, coefficients, s)
    flow(store, x, t + hair, coefficients, s)
    for k in range(states):
        change = before[k] - rate[k, 0]
        for j in range(slopes):
            slope[k, j] += change * moved[j]


@compiled
def newton_inverse(store: Whole, level: int) -> None:
    """Invert the Jacobian of (force - law) at the three points to the forces there.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    level
        How often the sample interval is halved.
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    big, x = cube(store, BIG)[level], line(store, X)
    modes, w = line(store, MODES), line(store, W)
    by_seen, newton = cube(store, BY_SEEN), grid(store, NEWTON)
    inverse = grid(store, INVERSE)
    channels = len(laws)
    first = big.shape[1] - 3 * channels
    for point in range(3):
        at = len(x) + point * len(w)
        for i in range(len(table)):
            channel, seen = table[i, CHANNEL], at + table[i, SEEN]
            for c in range(channel, channel + 1 + table[i, STATES]):
                r = point * channels + c
                for k in range(3 * channels):
                    if table[i, FRICTION] == 1 and modes[i] == 0.0:
                        newton[r, k] = big[seen + 1, first + k] / big[seen + 1, first + r]
                        continue
                    total = 1.0 if k == r else 0.0
                    for q in range(2 + table[i, STATES]):
                        total -= by_seen[point, c, q] * big[seen + q, first + k]
                    newton[r, k] = total
    for r in range(3 * channels):
        for k in range(3 * channels):
            inverse[r, k] = 1.0 if k == r else 0.0
    solve(newton, inverse, 3 * channels)


@compiled
def collocate(store: Whole, level: int, t: float, h: float, tolerance: float) -> float:
    """Try one step: write the forces at its three points into `y`.

    The miss is that of the forces at the beginning, over the largest so far, in units of the
    tolerance; infinity stands for an event, or for no convergence.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    level
        How often the sample interval is halved.
    t
        Time [s].
    h
        Length of the step [s].
    tolerance
        Miss that counts as one, over the largest force so far [1].

    Returns
    -------
    Miss of the forces at the beginning, in units of the tolerance; or infinity.
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    p, matrix = line(store, P), grid(store, MATRIX)
    big, x = cube(store, BIG)[level], line(store, X)
    modes, largest_y = line(store, MODES), line(store, LARGEST_Y)
    v, w = grid(store, V), line(store, W)
    g, room = line(store, G), line(store, ROOM)
    y, points = line(store, Y), grid(store, POINTS)
    inverse, right = grid(store, INVERSE), grid(store, RIGHT)
    by_column, nought = cube(store, BY_COLUMN)[level], line(store, NOUGHT)
    part = grid(store, PART)
    states, seen_count, channels = len(x), len(w), len(laws)
    first, width = big.shape[1] - 3 * channels, by_column.shape[1]
    for k in range(states):
        g[k] = x[k]
    powers = part.shape[1]
    for i in range((first - states) // powers if powers > 0 else 0):
        for k in range(powers):
            g[states + i * powers + k] = part[i, k]
    for r in range(0, len(room), ROUND):
        found, rows = room.ctypes.data + 8 * r, address(by_column, plain(0), r)
        sum_rows(found, nought.ctypes.data, g.ctypes.data, first, rows, width)
    if channels == 0:
        return 0.0
    flow(store, x, t, part, 0.0)
    left = matrix.shape[1] - channels
    for r in range(3 * channels):
        y[r] = v[left + r % channels, 0]
    most = np.inf
    for trial in range(12):
        for o in range(0, 3 * seen_count, ROUND):
            found, start = points.ctypes.data + 8 * o, room.ctypes.data + 8 * (states + o)
            rows = address(by_column, first, states + o)
            sum_rows(found, start, y.ctypes.data, 3 * channels, rows, width)
        for point in range(3):
            if trial == 0 or trial == 4:
                slopes_of_laws(store, points[point], t + RADAU[point] * h, point)
            forces(
                store,
                modes,
                points[point],
                t + RADAU[point] * h,
                right,
                point * channels,
            )
            for c in range(channels):
                r = point * channels + c
                right[r, 0] = y[r] - right[r, 0]
            for i in range(len(table)):
                if table[i, FRICTION] == 1 and modes[i] == 0.0:
                    r, speed = point * channels + table[i, CHANNEL], table[i, SEEN] + 1
                    row = states + point * seen_count + speed
                    right[r, 0] = points[point, speed] / big[row, first + r]
        if trial == 0 or trial == 4:
            newton_inverse(store, level)
        most = 0.0
        for r in range(3 * channels):
            change = 0.0
            for k in range(3 * channels):
                change += inverse[r, k] * right[k, 0]
            y[r] -= change
            largest = max(largest_y[r % channels], abs(y[r]))
            if change != 0.0:
                most = max(most, abs(change) / largest if largest > 0.0 else np.inf)
        if most <= CONVERGED or not most < np.inf:
            break
    if not most <= CONVERGED:
        return np.inf
    miss = 0.0
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        if table[i, FRICTION] == 1:
            for point in range(3):
                if modes[i] * points[point, table[i, SEEN] + 1] < 0.0:
                    return np.inf
                if modes[i] == 0.0 and abs(y[point * channels + channel]) > force_of(
                    laws[channel], table[i], 0.0, points[point], t + RADAU[point] * h, p
                ):
                    return np.inf
        for c in range(channel, channel + 1 + table[i, STATES]):
            begin, end = v[left + c, 0], y[2 * channels + c]
            at_left = _LEFT_1 * y[c] + _LEFT_2 * y[channels + c] + _LEFT_3 * end
            largest = max(largest_y[c], abs(begin), abs(end))
            if largest > 0.0:
                miss = max(miss, abs(at_left - begin) / largest)
    return miss / tolerance


@compiled
def drive(store: Whole, level: int) -> None:
    """Add the contribution of inputs that depend on parameters to the slopes of a step.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    level
        How often the sample interval is halved.
    """
    driven, big = whole_grid(store, DRIVEN), cube(store, BIG)[level]
    part, slope_room = grid(store, PART), grid(store, SLOPE_ROOM)
    states, powers = len(line(store, X)), part.shape[1]
    inputs = len(part) - len(driven)
    for i in range(len(driven)):
        at = states + driven[i, 1] * powers
        for r in range(len(slope_room)):
            for k in range(powers):
                slope_room[r, driven[i, 0]] += big[r, at + k] * part[inputs + i, k]


@compiled
def advance(store: Whole, level: int, t: float, h: float) -> None:
    """Take the step that `collocate` found: state, and slopes.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    level
        How often the sample interval is halved.
    t
        Time [s].
    h
        Length of the step [s].
    """
    table, laws = whole_grid(store, TABLE), whole_line(store, LAWS)
    driven, big = whole_grid(store, DRIVEN), cube(store, BIG)[level]
    slope_big, x = cube(store, SLOPE_BIG)[level], line(store, X)
    slope, modes = grid(store, S), line(store, MODES)
    largest_y, largest_w = line(store, LARGEST_Y), line(store, LARGEST_W)
    w, g, room = line(store, W), line(store, G), line(store, ROOM)
    slope_room, y = grid(store, SLOPE_ROOM), line(store, Y)
    points, inverse = grid(store, POINTS), grid(store, INVERSE)
    by_column, slope_right = cube(store, BY_COLUMN)[level], grid(store, SLOPE_RIGHT)
    states, seen_count, channels = len(x), len(w), len(laws)
    slopes, first = slope.shape[1], big.shape[1] - 3 * channels
    for r in range(3 * channels):
        g[first + r] = y[r]
        c = r % channels
        largest_y[c] = max(largest_y[c], abs(y[r]))
    for o in range(seen_count):
        largest_w[o] = max(largest_w[o], abs(points[2, o]))
    for k in range(0, states, ROUND):
        rows = address(by_column, first, k)
        found, start = x.ctypes.data + 8 * k, room.ctypes.data + 8 * k
        sum_rows(found, start, y.ctypes.data, 3 * channels, rows, by_column.shape[1])
    if slopes == 0:
        return
    by_linear(store, g, slope_big)
    carry(store, big, slope_big.shape[1] // len(room), slope, slope_room)
    # Most inputs do not hang on any parameter.
    if len(driven) > 0:
        drive(store, level)
    for point in range(3):
        at = states + point * seen_count
        slopes_of_laws(store, points[point], t + RADAU[point] * h, point)
        spread_slopes(store, point, slope_room, at, slope_right, point * channels)
        for i in range(len(table)):
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                r, speed = point * channels + table[i, CHANNEL], at + table[i, SEEN] + 1
                for j in range(slopes):
                    share = slope_room[speed, j] / big[speed, first + r]
                    slope_right[r, j] = -share
    if channels > 0:
        newton_inverse(store, level)
    # The forces have done their work: their place takes what the inverse makes of a row.
    for k in range(states):
        for q in range(3 * channels):
            total = 0.0
            for r in range(3 * channels):
                total += big[k, first + r] * inverse[r, q]
            y[q] = total
        for j in range(0, slopes, ROUND):
            rows, start = address(slope_right, plain(0), j), address(slope_room, k, j)
            sum_rows(address(slope, k, j), start, y.ctypes.data, 3 * channels, rows, slopes)


@compiled
def shift(coefficients: Reals, s: float, width: float, part: Reals) -> None:
    """Turn polynomials over the sample interval into those over a part of it.

    Parameters
    ----------
    coefficients
        Polynomials of the inputs over the sample interval [input, power].
    s
        Beginning of the part, over the sample interval [1].
    width
        Length of the part, over the sample interval [1].
    part
        Polynomials over the part [input, power]; written.
    """
    inputs, powers = coefficients.shape
    for i in range(inputs):
        for j in range(powers):
            part[i, j] = coefficients[i, j]
        if width == 1.0:
            continue
        # Horner's scheme, once for each power.
        for j in range(powers):
            for k in range(powers - 2, j - 1, -1):
                part[i, k] += s * part[i, k + 1]
        scale = 1.0
        for j in range(powers):
            part[i, j] *= scale
            scale *= width


@compiled
def march(
    store: Whole,
    eventful: bool | None,
    coefficients: Reals,
    start_s: float,
    interval: float,
    tolerance: float,
    states: Reals,
    rates: Reals,
    held: Reals,
    readouts: Whole,
    scale: Reals,
    target: Whole,
    heard: Reals,
) -> int:
    """Run over all samples.

    Of the slopes only those are kept that a sensor hears.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `places`.
    eventful
        True where friction or laws that jump make events; None leaves out what events need,
        which is then not even compiled.
    coefficients
        Polynomials of the inputs over each sample interval [time, input, power].
    start_s
        Campaign time of the first sample [s].
    interval
        Sample interval [s].
    tolerance
        Miss of a step that is accepted, over the largest force so far [1].
    states, rates
        States and their rates at the samples [time, state]; written.
    held
        Forces at the samples [time, channel]; written.
    readouts
        Index of the number of the state (of the rate where the second column is 1) that each
        sensor hears; -1 for none [sensor, 2].
    scale
        Factor of each sensor [sensor].
    target
        Column of `heard` of each slope [slope].
    heard
        Slopes of the outputs [sensor, time, column]; written.

    Returns
    -------
    Number of steps; negative where the run was given up.
    """
    laws, jumps = whole_line(store, LAWS), line(store, JUMPS)
    matrix, big = grid(store, MATRIX), cube(store, BIG)
    x, slope = line(store, X), grid(store, S)
    v, rate, slope_rate = grid(store, V), grid(store, RATE), grid(store, SLOPE_RATE)
    part = grid(store, PART)
    samples, channels, slopes = len(coefficients), len(laws), len(target)
    quick = plain(0)
    for k in range(len(readouts)):
        if readouts[k, 0] >= 0:
            quick = max(quick, readouts[k, 1])
    deepest = len(big) - 1
    whole, level, steps = 1 << deepest, 0 * deepest, 0
    first = matrix.shape[1] - channels
    if eventful is not None:
        settle(store, start_s, coefficients[0], 0.0)
    for sample in range(samples):
        t = start_s + sample * interval
        flow(store, x, t, coefficients[sample], 0.0)
        for k in range(len(x)):
            states[sample, k], rates[sample, k] = x[k], rate[k, 0]
        for c in range(channels):
            held[sample, c] = v[first + c, 0]
        if slopes > 0:
            if quick == 1:
                slopes_of_flow(store, slope, t, coefficients[sample], 0.0)
            for k in range(len(readouts)):
                row = readouts[k, 0]
                if row >= 0:
                    told = slope_rate if readouts[k, 1] == 1 else slope
                    for j in range(slopes):
                        heard[k, sample, target[j]] += scale[k] * told[row, j]
        done = whole if sample + 1 == samples else 0
        while done < whole:
            wide = whole >> level
            s, width = done / whole, wide / whole
            at, h = t + s * interval, width * interval
            miss = 0.0
            if eventful is not None:
                for j in range(len(jumps)):
                    ahead = jumps[j] - at
                    if HAIR * h < ahead and ahead <= h * (1.0 + HAIR):
                        miss = np.inf
            if miss == 0.0:
                shift(coefficients[sample], s, width, part)
                miss = collocate(store, level, at, h, tolerance)
            steps += 1
            if steps > GIVE_UP * samples or not abs(x[0]) < BOUND:
                return -sample - 1
            if miss > 1.0 and level < deepest:
                level += 1
                continue
            if eventful is not None and miss == np.inf:
                creep(store, at, h, coefficients[sample], s, width)
            else:
                advance(store, level, at, h)
            done += wide
            if miss < 0.2 and level > 0 and done % (2 * wide) == 0:
                level -= 1
    return steps
