r"""Compiled time stepping of a plant.

Between events the state obeys :math:`\dot x = A x + B_u u(t) + B_y y(t)`, where the forces
:math:`y = f(w, t)` depend on observations of the state, :math:`w = H x`. In a step, y is the
parabola through three Radau points (Hairer and Wanner 1996, section IV.5: order 5). The linear
part is solved exactly for it; Newton's method finds y. A step is a sample interval, halved
until the parabola meets the force at the step's beginning within the tolerance; so steps
become short at kinks. In the shortest steps, events are located: friction begins to stick or
to slide, or a law jumps. There the derivatives jump (Leine and Nijmeijer 2004, chapter 7).

"Slopes" are derivatives with respect to parameters and to the first state. A "channel" is the
force of one effect, or the rate of one of its internal states.

All of it is in one file: the compiler caches code by file, and would not notice a change in
another.

Several functions share these parameters:

- `store`: addresses and shapes of all arrays of a run; see `memory_table`.
- `t`: time [s].
- `coefficients`: polynomials of the inputs over the sample interval [input, power].
- `s`: share of the sample interval that has passed [1].
- `h`: length of the step [s].
- `level`: how often the sample interval is halved.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from slowtime.dynamics.effects.compilation import (
    BLOCK,
    ROUND,
    Routines,
    call_law,
    compiled,
    sum_block,
    sum_rows,
    view_of,
)

Reals = np.ndarray[Any, np.dtype[np.float64]]
Whole = np.ndarray[Any, np.dtype[np.int64]]

RADAU = ((4 - math.sqrt(6)) / 10, (4 + math.sqrt(6)) / 10, 1.0)
_C1, _C2 = RADAU[0], RADAU[1]
_LEFT_1 = _C2 / ((_C1 - _C2) * (_C1 - 1.0))
_LEFT_2 = _C1 / ((_C2 - _C1) * (_C2 - 1.0))
_LEFT_3 = _C1 * _C2 / ((1.0 - _C1) * (1.0 - _C2))

FRICTION, CHANNEL, FIRST_OBSERVATION, STATES, FIRST_PARAMETER, PARAMETERS = 0, 1, 2, 3, 4, 5
"""Columns of the table of effects: 1 for friction, else 0; first channel; first observation;
number of internal states; first parameter; number of parameters."""

NEWTON_TOLERANCE = 1e-9
"""[1] Change of a force, over the largest so far, at which Newton's method has converged."""
DIFFERENCE_STEP = 1e-5
"""[1] Step of central differences, over the largest value so far."""
TIME_RESOLUTION = 1e-9
"""[1] Share of a step; instants that are nearer to each other count as one."""
MAX_EVENTS = 24
"""Events located in one shortest step; the rest of the step is taken without."""
MAX_STEPS_PER_SAMPLE = 2000
"""Mean number of steps per sample at which a run is given up."""

MAX_STATE = 1e60
"""Value of the first state beyond which a run is given up, in any unit."""


class KernelArrays(NamedTuple):
    """Arrays that a run does not change: laws, matrices, and their slopes.

    Parameters
    ----------
    effect_table
        Row of each effect [effect, column]; see the names of its columns above.
    laws
        Address of the compiled law of each channel [channel].
    p
        Parameters of all laws [parameter].
    parameter_slope
        Index of the slope that belongs to each of these; -1 for none [parameter].
    jump_times, jump_slopes
        Campaign times at which laws jump [s], and the slope that belongs to each, or -1.
    driven_inputs
        Inputs that are derivatives with respect to a parameter: the slope, and the input
        through which each acts [driven, 2].
    observation
        H: observations that laws take from the state [observation, state].
    rate_matrix
        Rate of the state from (state; input; channel).
    rate_matrix_slopes
        Its slopes to linear parameters; see `system.slopes_by_column`.
    step_matrices
        For each number of halvings of the sample interval [level, row, column]. Rows: state
        at the end of the step, then the observations at its three points. Columns: state;
        each input's polynomial by power; channels by point.
    step_matrix_slopes
        Their slopes to linear parameters.
    step_columns, rate_columns, observation_columns
        `step_matrices`, `rate_matrix` and `observation` transposed, each row padded with zeros.
    """

    effect_table: Whole
    laws: Whole
    p: Reals
    parameter_slope: Whole
    jump_times: Reals
    jump_slopes: Whole
    driven_inputs: Whole
    observation: Reals
    rate_matrix: Reals
    rate_matrix_slopes: Reals
    step_matrices: Reals
    step_matrix_slopes: Reals
    step_columns: Reals
    rate_columns: Reals
    observation_columns: Reals


class Workspace(NamedTuple):
    """Arrays that a run changes.

    The number of slopes is padded to whole rounds (`padded_count`) by zeros.

    Parameters
    ----------
    state, state_slopes
        State, and its slopes [state, slope].
    modes
        Of each effect: 1 or -1 for friction that slides, by direction, and 0 where it sticks.
    largest_forces, largest_observed
        Largest values so far, by channel and by observation.
    combined, combined_slopes
        (state; input; channel) at one instant, and slopes.
    rate, rate_slopes
        Rate of the state, and slopes.
    observed, observed_slopes
        Observations at one instant, and slopes.
    friction_limits
        Largest force that friction holds, by channel.
    observation_derivatives, parameter_derivatives
        Derivatives of laws to observations [point, channel, number] and to their own
        parameters [channel, number].
    step_vector
        (state; input by power; channel by point) of a step.
    step_result, step_result_slopes
        State at the end and observations at the points without the forces, and slopes.
    point_forces, point_observed
        Channels and observations at the three points.
    jacobian, inverse_jacobian
        Of Newton's method [point and channel, point and channel].
    right_side, right_side_slopes
        Its right side, and slopes.
    part_coefficients
        Polynomials of the inputs over the step [input, power].
    sticking_matrix, sticking_right_side, sticking_slopes
        Equations of the forces of friction that sticks.
    stage_state, stage_slopes, next_state, next_slopes
        State within and after a Runge-Kutta step, and slopes.
    rate_before, instant_slopes
        Rate of the state before an event, and slopes of the instant of the event.
    linear_slope_product
        Slopes of a matrix to linear parameters, times a column.
    zeros
        A round of zeros.
    needed_rates
        1 for each state whose rate's slopes are needed at the samples: those that sensors
        measure, and those that laws see.
    """

    state: Reals
    state_slopes: Reals
    modes: Reals
    largest_forces: Reals
    largest_observed: Reals
    combined: Reals
    combined_slopes: Reals
    rate: Reals
    rate_slopes: Reals
    observed: Reals
    observed_slopes: Reals
    friction_limits: Reals
    observation_derivatives: Reals
    parameter_derivatives: Reals
    step_vector: Reals
    step_result: Reals
    step_result_slopes: Reals
    point_forces: Reals
    point_observed: Reals
    jacobian: Reals
    inverse_jacobian: Reals
    right_side: Reals
    right_side_slopes: Reals
    part_coefficients: Reals
    sticking_matrix: Reals
    sticking_right_side: Reals
    sticking_slopes: Reals
    stage_state: Reals
    stage_slopes: Reals
    next_state: Reals
    next_slopes: Reals
    rate_before: Reals
    instant_slopes: Reals
    linear_slope_product: Reals
    zeros: Reals
    needed_rates: Whole


def padded_count(count: int) -> int:
    """Round a number of slopes up to whole rounds."""
    return -(-count // ROUND) * ROUND


def has_events(system: KernelArrays) -> bool:
    """Whether friction, or laws that jump, make events."""
    return bool(len(system.jump_times) or system.effect_table[:, FRICTION].any())


def memory_table(system: KernelArrays, now: Workspace) -> Whole:
    """Return address and shape of each array, one row per array, then addresses of routines."""
    # Compiled functions take this one table as `store`; with the arrays as arguments, compiling
    # takes five times as long. The arrays must outlive the table.
    arrays = len(system) + len(now)
    found = np.zeros((arrays + len(ROUTINES), 5), dtype=np.int64)
    found[arrays:, 0] = ROUTINES.addresses(rare=has_events(system))
    for row, array in zip(found[:arrays], (*system, *now), strict=True):
        assert array.flags.c_contiguous
        assert array.dtype in (np.float64, np.int64)
        row[0] = array.ctypes.data
        row[1 : 1 + array.ndim] = array.shape
    return found


ARRAYS = 51
"""[arrays] Of a system and a workspace; one row each of that table."""
(
    EFFECT_TABLE,
    LAWS,
    P,
    PARAMETER_SLOPE,
    JUMP_TIMES,
    JUMP_SLOPES,
    DRIVEN_INPUTS,
    OBSERVATION,
    RATE_MATRIX,
    RATE_MATRIX_SLOPES,
    STEP_MATRICES,
    STEP_MATRIX_SLOPES,
    STEP_COLUMNS,
    RATE_COLUMNS,
    OBSERVATION_COLUMNS,
    STATE,
    STATE_SLOPES,
    MODES,
    LARGEST_FORCES,
    LARGEST_OBSERVED,
    COMBINED,
    COMBINED_SLOPES,
    RATE,
    RATE_SLOPES,
    OBSERVED,
    OBSERVED_SLOPES,
    FRICTION_LIMITS,
    OBSERVATION_DERIVATIVES,
    PARAMETER_DERIVATIVES,
    STEP_VECTOR,
    STEP_RESULT,
    STEP_RESULT_SLOPES,
    POINT_FORCES,
    POINT_OBSERVED,
    JACOBIAN,
    INVERSE_JACOBIAN,
    RIGHT_SIDE,
    RIGHT_SIDE_SLOPES,
    PART_COEFFICIENTS,
    STICKING_MATRIX,
    STICKING_RIGHT_SIDE,
    STICKING_SLOPES,
    STAGE_STATE,
    STAGE_SLOPES,
    NEXT_STATE,
    NEXT_SLOPES,
    RATE_BEFORE,
    INSTANT_SLOPES,
    LINEAR_SLOPE_PRODUCT,
    ZEROS,
    NEEDED_RATES,
) = range(ARRAYS)
"""Rows of that table."""


line, grid = view_of(numba.float64, 1), view_of(numba.float64, 2)
cube = view_of(numba.float64, 3)
whole_line, whole_grid = view_of(numba.int64, 1), view_of(numba.int64, 2)
"""Views of an array, from that table and a row: real numbers by axes, and integers."""

NOTHING, REAL, WHOLE, TRUTH = numba.void, numba.float64, numba.int64, numba.boolean
LINE, GRID, STORE = numba.float64[::1], numba.float64[:, ::1], numba.int64[:, ::1]
"""Types of what routines take: numbers, real arrays of one and two axes, and that table."""

ROUTINES = Routines(ARRAYS)
"""What is compiled by itself, and called by the address in that table."""


@compiled
def opaque(number: int) -> int:
    """Hide a constant from the compiler, which else compiles the called function for it."""
    return number * 1


@compiled
def address(matrix: Reals, row: int, column: int) -> int:
    """Memory address of an entry of a matrix [bytes]."""
    return int(matrix.ctypes.data + 8 * (row * matrix.shape[1] + column))


@ROUTINES.define(NOTHING(STORE, LINE, GRID))
def linear_slopes(store: Whole, shares: Reals, slopes: Reals) -> None:
    """Multiply slopes of a matrix to linear parameters by a column.

    Slopes are laid out by column [column, row and parameter]; there is a share for each column.
    """
    found = line(store, LINEAR_SLOPE_PRODUCT)
    width = slopes.shape[1]
    for i in range(width):
        found[i] = 0.0
    # Four columns at once: the sums are read and written a quarter as often.
    whole = len(slopes) - len(slopes) % 4
    for c in range(0, whole, 4):
        one, two, three, four = shares[c], shares[c + 1], shares[c + 2], shares[c + 3]
        for i in range(width):
            found[i] += (one * slopes[c, i] + two * slopes[c + 1, i]) + (
                three * slopes[c + 2, i] + four * slopes[c + 3, i]
            )
    for c in range(whole, len(slopes)):
        share = shares[c]
        for i in range(width):
            found[i] += share * slopes[c, i]


@ROUTINES.define(NOTHING(STORE, GRID, WHOLE, GRID, GRID))
def propagate_slopes(
    store: Whole, matrix: Reals, linear: int, slope: Reals, found: Reals
) -> None:
    """Compute the slopes of a matrix times the state, and add those of `linear_slopes`.

    The first columns of the matrix belong to the state; `linear` is the number of slopes to
    linear parameters, in whole rounds; `found` [row, slope] is written.
    """
    own, zeros = line(store, LINEAR_SLOPE_PRODUCT), line(store, ZEROS)
    states, width = slope.shape
    whole = len(found) - len(found) % BLOCK
    # A round of columns stays in the cache while all rows are done.
    for j in range(0, width, ROUND):
        rows = address(slope, opaque(0), j)
        start, step = zeros.ctypes.data, opaque(0)
        if j < linear:
            start, step = own.ctypes.data + 8 * j, linear
        for r in range(0, whole, BLOCK):
            sum_block(
                address(found, r, j),
                width,
                start + 8 * r * step,
                step,
                address(matrix, r, opaque(0)),
                matrix.shape[1],
                states,
                rows,
                width,
            )
        for r in range(whole, len(found)):
            shares = address(matrix, r, opaque(0))
            sum_rows(address(found, r, j), start + 8 * r * step, shares, states, rows, width)


@ROUTINES.define(NOTHING(STORE, GRID, GRID, WHOLE))
def solve(store: Whole, matrix: Reals, right: Reals, size: int) -> None:
    """Solve a system of linear equations in place, by elimination with scaled pivoting.

    Each row counts relative to its largest element: the row of a law that is silent, as before
    it begins, stays a row of the unit matrix beside one whose slopes are large.

    Both are overwritten, the right sides by the solutions; `size` leading rows make the system.
    """
    sides = right.shape[1]
    for k in range(size):
        best, share = k, 0.0
        for i in range(k, size):
            largest = 0.0
            for j in range(k, size):
                largest = max(largest, abs(matrix[i, j]))
            if abs(matrix[i, k]) > share * largest:
                best, share = i, abs(matrix[i, k]) / largest
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
def law_value(law: int, row: Whole, mode: float, w: Reals, t: float, p: Reals) -> float:
    """Evaluate one channel of one effect; that of sliding friction has its sign.

    Gives a force [N], or the rate of an internal state. The mode of friction is 1 or -1 where
    it slides, 0 where it sticks.
    """
    seen = row[FIRST_OBSERVATION]
    z, own = w.ctypes.data + 8 * (seen + 2), p.ctypes.data + 8 * row[FIRST_PARAMETER]
    if row[FRICTION] == 1:
        sign = 1.0 if mode == 0.0 else mode
        speed = max(mode * w[seen + 1], 0.0)
        return float(sign * call_law(law, w[seen], speed, t, z, own))
    return float(call_law(law, w[seen], w[seen + 1], t, z, own))


@ROUTINES.define(NOTHING(STORE, LINE, LINE, REAL, GRID, WHOLE))
def law_values(store: Whole, modes: Reals, w: Reals, t: float, y: Reals, first: int) -> None:
    """Evaluate all channels; of friction that sticks, the largest force that it holds.

    Column `y` takes the channels from row `first` on.
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    p = line(store, P)
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        for c in range(channel, channel + 1 + table[i, STATES]):
            y[first + c, 0] = law_value(laws[c], table[i], modes[i], w, t, p)


@ROUTINES.define(NOTHING(STORE, LINE, REAL, WHOLE, TRUTH))
def law_slopes(store: Whole, w: Reals, t: float, point: int, every: bool) -> None:
    """Differentiate all channels to observations and parameters, by central differences.

    Slopes of the Radau point are written; those to parameters only where `every` is set.
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    column, modes = whole_line(store, PARAMETER_SLOPE), line(store, MODES)
    largest_w, by_seen = line(store, LARGEST_OBSERVED), cube(store, OBSERVATION_DERIVATIVES)
    by_parameter, p = grid(store, PARAMETER_DERIVATIVES), line(store, P)
    for i in range(len(table)):
        channel, seen, first = (
            table[i, CHANNEL],
            table[i, FIRST_OBSERVATION],
            table[i, FIRST_PARAMETER],
        )
        observed_count = 2 + table[i, STATES]
        for c in range(channel, channel + 1 + table[i, STATES]):
            for k in range(observed_count + table[i, PARAMETERS]):
                at = seen + k if k < observed_count else first + k - observed_count
                if k >= observed_count and (not every or column[at] < 0):
                    continue
                varied = w if k < observed_count else p
                kept = varied[at]
                step = DIFFERENCE_STEP * abs(kept)
                if k < observed_count:
                    step = max(step, DIFFERENCE_STEP * largest_w[at])
                if step == 0.0:
                    step = 1e-8
                varied[at] = kept + step
                slope = law_value(laws[c], table[i], modes[i], w, t, p)
                varied[at] = kept - step
                slope -= law_value(laws[c], table[i], modes[i], w, t, p)
                varied[at] = kept
                if k < observed_count:
                    by_seen[point, c, k] = slope / (2.0 * step)
                else:
                    by_parameter[c, k - observed_count] = slope / (2.0 * step)


@ROUTINES.define(NOTHING(STORE, WHOLE, GRID, WHOLE, GRID, WHOLE))
def apply_chain_rule(
    store: Whole, point: int, slope_w: Reals, at: int, slope_y: Reals, first: int
) -> None:
    """Apply the chain rule from observations to forces; zero for friction that sticks.

    Observations begin at row `at` of `slope_w`, forces at row `first` of `slope_y`, which is
    written.
    """
    table, column = whole_grid(store, EFFECT_TABLE), whole_line(store, PARAMETER_SLOPE)
    modes, by_seen = line(store, MODES), cube(store, OBSERVATION_DERIVATIVES)
    by_parameter, zeros = grid(store, PARAMETER_DERIVATIVES), line(store, ZEROS)
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        for c in range(channel, channel + 1 + table[i, STATES]):
            count = 2 + table[i, STATES]
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                count = 0
            shares = by_seen.ctypes.data + 8 * (point * by_seen.shape[1] + c) * by_seen.shape[2]
            for j in range(0, slope_y.shape[1], ROUND):
                rows = address(slope_w, at + table[i, FIRST_OBSERVATION], j)
                found = address(slope_y, first + c, j)
                sum_rows(found, zeros.ctypes.data, shares, count, rows, slope_y.shape[1])
            if count == 0:
                continue
            for k in range(table[i, PARAMETERS]):
                j = column[table[i, FIRST_PARAMETER] + k]
                if j >= 0:
                    slope_y[first + c, j] += by_parameter[c, k]


@ROUTINES.define(NOTHING(STORE, GRID, GRID, GRID))
def add_sticking_forces(store: Whole, rates: Reals, v: Reals, right: Reals) -> None:
    """Add the forces that keep the speeds of sticking friction, and their effect on the rates.

    Rates [state, side] are changed, forces in `v` [row, side] are written.
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    seeing, matrix = grid(store, OBSERVATION), grid(store, RATE_MATRIX)
    modes, stuck = line(store, MODES), grid(store, STICKING_MATRIX)
    first = matrix.shape[1] - len(laws)
    row = opaque(0)
    for i in range(len(table)):
        if table[i, FRICTION] == 0 or modes[i] != 0.0:
            continue
        speed, col = table[i, FIRST_OBSERVATION] + 1, 0
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
    solve(store, stuck, right, row)
    row = opaque(0)
    for i in range(len(table)):
        if table[i, FRICTION] == 1 and modes[i] == 0.0:
            column = first + table[i, CHANNEL]
            for j in range(right.shape[1]):
                v[column, j] = right[row, j]
                for k in range(len(rates)):
                    rates[k, j] += matrix[k, column] * right[row, j]
            row += 1


@ROUTINES.define(NOTHING(STORE, LINE))
def observe(store: Whole, x: Reals) -> None:
    """Compute the observations that laws take from a state."""
    seeing, w, zeros = (
        grid(store, OBSERVATION_COLUMNS),
        line(store, OBSERVED),
        line(store, ZEROS),
    )
    width = seeing.shape[1]
    for o in range(0, len(w), ROUND):
        found, rows = w.ctypes.data + 8 * o, address(seeing, opaque(0), o)
        sum_rows(found, zeros.ctypes.data, x.ctypes.data, len(x), rows, width)


@ROUTINES.define(NOTHING(STORE, LINE, REAL, GRID, REAL))
def state_rate(store: Whole, x: Reals, t: float, coefficients: Reals, s: float) -> None:
    """Compute all forces at one instant, those of sticking too, and the rate of the state."""
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    matrix, modes = grid(store, RATE_COLUMNS), line(store, MODES)
    v, rate, zeros = grid(store, COMBINED), grid(store, RATE), line(store, ZEROS)
    w, stuck_right = line(store, OBSERVED), grid(store, STICKING_RIGHT_SIDE)
    states, all_of = len(x), len(matrix)
    first = all_of - len(laws)
    observe(store, x)
    law_values(store, modes, w, t, v, first)
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
        found, rows = rate.ctypes.data + 8 * k, address(matrix, opaque(0), k)
        sum_rows(found, zeros.ctypes.data, v.ctypes.data, all_of, rows, width)
    add_sticking_forces(store, rate, v, stuck_right)


@ROUTINES.define(NOTHING(STORE, GRID, GRID))
def needed_rate_slopes(store: Whole, slope: Reals, found: Reals) -> None:
    """Compute slopes of the needed rates, as `linear_slopes` and `propagate_slopes` would.

    They are written to `found` where they are needed.
    """
    needed, matrix = whole_line(store, NEEDED_RATES), grid(store, RATE_MATRIX)
    slopes, shares = grid(store, RATE_MATRIX_SLOPES), line(store, COMBINED)
    own, zeros = line(store, LINEAR_SLOPE_PRODUCT), line(store, ZEROS)
    states, width = slope.shape
    linear = slopes.shape[1] // states
    for r in range(states):
        if needed[r] == 0:
            continue
        for i in range(r * linear, (r + 1) * linear):
            own[i] = 0.0
        for c in range(len(slopes)):
            for i in range(r * linear, (r + 1) * linear):
                own[i] += shares[c] * slopes[c, i]
        row = address(matrix, r, opaque(0))
        for j in range(0, width, ROUND):
            start = zeros.ctypes.data
            if j < linear:
                start = own.ctypes.data + 8 * (r * linear + j)
            rows = address(slope, opaque(0), j)
            sum_rows(address(found, r, j), start, row, states, rows, width)


@ROUTINES.define(NOTHING(STORE, GRID, REAL, GRID, REAL, TRUTH))
def state_rate_slopes(
    store: Whole, slope: Reals, t: float, coefficients: Reals, s: float, every: bool
) -> None:
    """Compute the slopes of the forces and rates that `state_rate` has just computed.

    Rates of all states are wanted where `every` is set, and not only those of `needed_rates`.
    """
    laws, driven = whole_line(store, LAWS), whole_grid(store, DRIVEN_INPUTS)
    seeing, matrix = grid(store, OBSERVATION), grid(store, RATE_MATRIX)
    needed = whole_line(store, NEEDED_RATES)
    slope_matrix = grid(store, RATE_MATRIX_SLOPES)
    slope_v, slope_rate = grid(store, COMBINED_SLOPES), grid(store, RATE_SLOPES)
    w, slope_w = line(store, OBSERVED), grid(store, OBSERVED_SLOPES)
    stuck_slope = grid(store, STICKING_SLOPES)
    states, slopes = slope.shape
    channels, all_of = len(laws), matrix.shape[1]
    first = all_of - channels
    if every:
        linear_slopes(store, line(store, COMBINED), slope_matrix)
        propagate_slopes(store, matrix, slope_matrix.shape[1] // states, slope, slope_rate)
    else:
        needed_rate_slopes(store, slope, slope_rate)
    if len(driven) > 0:
        for k in range(states, first):
            for j in range(slopes):
                slope_v[k, j] = 0.0
    for i in range(len(driven)):
        value = 0.0
        for j in range(coefficients.shape[1] - 1, -1, -1):
            value = value * s + coefficients[first - states + i, j]
        slope_v[states + driven[i, 1], driven[i, 0]] += value
    law_slopes(store, w, t, opaque(0), True)
    for o in range(len(w)):
        for j in range(slopes):
            slope_w[o, j] = 0.0
        for k in range(states):
            share = seeing[o, k]
            if share != 0.0:
                for j in range(slopes):
                    slope_w[o, j] += share * slope[k, j]
    apply_chain_rule(store, opaque(0), slope_w, opaque(0), slope_v, first)
    # Most inputs do not depend on any parameter.
    moving = opaque(states) if len(driven) > 0 else first
    for k in range(states):
        if not every and needed[k] == 0:
            continue
        for r in range(moving, all_of):
            share = matrix[k, r]
            if share != 0.0:
                for j in range(slopes):
                    slope_rate[k, j] += share * slope_v[r, j]
    add_sticking_forces(store, slope_rate, slope_v, stuck_slope)


@ROUTINES.define(NOTHING(STORE, REAL, GRID, REAL), rare=True)
def choose_friction_modes(store: Whole, t: float, coefficients: Reals, s: float) -> None:
    """Let friction whose mode is 0 slide where its limit is exceeded."""
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    matrix, x = grid(store, RATE_MATRIX), line(store, STATE)
    modes, v = line(store, MODES), grid(store, COMBINED)
    w, limit = line(store, OBSERVED), grid(store, FRICTION_LIMITS)
    first = matrix.shape[1] - len(laws)
    for _ in range(2 * len(table)):
        state_rate(store, x, t, coefficients, s)
        law_values(store, modes, w, t, limit, opaque(0))
        worst, over, sign = opaque(-1), 1.0, 1.0
        for i in range(len(table)):
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                c = table[i, CHANNEL]
                forces, most = v[first + c, 0], limit[c, 0]
                if abs(forces) > over * most:
                    worst, sign = i, math.copysign(1.0, forces)
                    over = abs(forces) / most if most > 0.0 else np.inf
        if worst < 0:
            return
        modes[worst] = sign


@ROUTINES.define(NOTHING(STORE, REAL, REAL, GRID, REAL, REAL, WHOLE), rare=True)
def runge_kutta_step(
    store: Whole,
    t: float,
    h: float,
    coefficients: Reals,
    s: float,
    width: float,
    slopes: int,
) -> None:
    """Take a step by the classical Runge-Kutta rule of order 4; the result is in `next_state`.

    `width` is the length of the step over the sample interval [1]; `slopes` are carried along.
    """
    x, slope = line(store, STATE), grid(store, STATE_SLOPES)
    rate, slope_rate = grid(store, RATE), grid(store, RATE_SLOPES)
    x_0, s_0 = line(store, STAGE_STATE), grid(store, STAGE_SLOPES)
    x_1, s_1 = line(store, NEXT_STATE), grid(store, NEXT_SLOPES)
    states = len(x)
    for k in range(states):
        x_0[k] = x_1[k] = x[k]
        for j in range(slopes):
            s_0[k, j] = s_1[k, j] = slope[k, j]
    for stage in range(4):
        # Just before the end, so that a law that jumps there has not jumped yet.
        share = (0.0, 0.5, 0.5, 1.0 - TIME_RESOLUTION)[stage]
        weight, ahead = (h / 6, h / 3, h / 3, h / 6)[stage], (h / 2, h / 2, h, 0.0)[stage]
        state_rate(store, x_0, t + share * h, coefficients, s + share * width)
        if slopes > 0:
            state_rate_slopes(store, s_0, t + share * h, coefficients, s + share * width, True)
        for k in range(states):
            x_1[k] += weight * rate[k, 0]
            x_0[k] = x[k] + ahead * rate[k, 0]
            for j in range(slopes):
                s_1[k, j] += weight * slope_rate[k, j]
                s_0[k, j] = slope[k, j] + ahead * slope_rate[k, j]


@ROUTINES.define(REAL(STORE, WHOLE, LINE, REAL, GRID, REAL), rare=True)
def event_distance(
    store: Whole, i: int, x: Reals, t: float, coefficients: Reals, s: float
) -> float:
    """Distance of friction from its next event.

    Speed in its direction [m/s] while it slides, force to spare [N] while it sticks.
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    p, matrix = line(store, P), grid(store, RATE_MATRIX)
    modes, v = line(store, MODES), grid(store, COMBINED)
    w = line(store, OBSERVED)
    c = table[i, CHANNEL]
    state_rate(store, x, t, coefficients, s)
    if modes[i] != 0.0:
        return float(modes[i] * w[table[i, FIRST_OBSERVATION] + 1])
    most = law_value(laws[c], table[i], 0.0, w, t, p)
    forces = v[matrix.shape[1] - len(laws) + c, 0]
    return float(most * (1.0 + 1e-9) - abs(forces))


@ROUTINES.define(NOTHING(STORE, REAL, GRID, REAL, WHOLE, WHOLE, REAL), rare=True)
def pass_event(
    store: Whole,
    t: float,
    coefficients: Reals,
    s: float,
    which: int,
    jump: int,
    resolution: float,
) -> None:
    """Change the mode of one friction, or pass a jump; slopes jump with the rate.

    `which` is the effect whose friction changes its mode, `jump` the instant at which a law
    jumps; -1 for none.
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    jump_columns, seeing = whole_line(store, JUMP_SLOPES), grid(store, OBSERVATION)
    matrix, x = grid(store, RATE_MATRIX), line(store, STATE)
    slope, modes = grid(store, STATE_SLOPES), line(store, MODES)
    rate, w = grid(store, RATE), line(store, OBSERVED)
    before, moved = line(store, RATE_BEFORE), line(store, INSTANT_SLOPES)
    states, slopes = slope.shape
    state_rate(store, x, t - resolution, coefficients, s)
    for k in range(states):
        before[k] = rate[k, 0]
    for j in range(slopes):
        moved[j] = 0.0
    if which >= 0 and modes[which] != 0.0:
        speed = table[which, FIRST_OBSERVATION] + 1
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
    choose_friction_modes(store, t + resolution, coefficients, s)
    state_rate(store, x, t + resolution, coefficients, s)
    for k in range(states):
        change = before[k] - rate[k, 0]
        for j in range(slopes):
            slope[k, j] += change * moved[j]


@ROUTINES.define(NOTHING(STORE, REAL, REAL, GRID, REAL, REAL), rare=True)
def step_through_events(
    store: Whole, t: float, h: float, coefficients: Reals, s: float, width: float
) -> None:
    """Take a shortest step, and locate every event within it."""
    table, jumps = whole_grid(store, EFFECT_TABLE), line(store, JUMP_TIMES)
    x, slope = line(store, STATE), grid(store, STATE_SLOPES)
    x_1, s_1 = line(store, NEXT_STATE), grid(store, NEXT_SLOPES)
    states, slopes = slope.shape
    left, pace = h, width / h
    for count in range(MAX_EVENTS):
        step, which, jump = left, opaque(-1), opaque(-1)
        for j in range(len(jumps)):
            ahead = jumps[j] - t
            if TIME_RESOLUTION * h < ahead and ahead <= step * (1.0 + TIME_RESOLUTION):
                step, jump = min(ahead, left), j
        runge_kutta_step(store, t, step, coefficients, s, pace * step, opaque(0))
        for i in range(len(table)):
            if table[i, FRICTION] == 0 or count == MAX_EVENTS - 1:
                continue
            above = event_distance(store, i, x_1, t + step, coefficients, s + pace * step)
            if above >= 0.0:
                continue
            low, high = 0.0, step
            below = event_distance(store, i, x, t, coefficients, s)
            while high - low > 1e-12 * h and below > 0.0:
                # Regula falsi, one end halved where the other lags.
                guess = low + (high - low) * min(max(below / (below - above), 0.02), 0.98)
                runge_kutta_step(store, t, guess, coefficients, s, pace * guess, opaque(0))
                found = event_distance(store, i, x_1, t + guess, coefficients, s + pace * guess)
                if found < 0.0:
                    high, above, below = guess, found, 0.5 * below
                else:
                    low, below, above = guess, found, 0.5 * above
            step, which, jump = high, i, opaque(-1)
            runge_kutta_step(store, t, step, coefficients, s, pace * step, opaque(0))
        runge_kutta_step(store, t, step, coefficients, s, pace * step, slopes)
        for k in range(states):
            x[k] = x_1[k]
            for j in range(slopes):
                slope[k, j] = s_1[k, j]
        t, s, left = t + step, s + pace * step, left - step
        if which >= 0 or jump >= 0:
            pass_event(store, t, coefficients, s, which, jump, TIME_RESOLUTION * h)
        if left <= TIME_RESOLUTION * h:
            return


@ROUTINES.define(NOTHING(STORE, WHOLE))
def newton_inverse(store: Whole, level: int) -> None:
    """Invert the Jacobian of (force - law) at the three points to the forces there."""
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    big, x = cube(store, STEP_MATRICES)[level], line(store, STATE)
    modes, w = line(store, MODES), line(store, OBSERVED)
    by_seen, newton = cube(store, OBSERVATION_DERIVATIVES), grid(store, JACOBIAN)
    inverse = grid(store, INVERSE_JACOBIAN)
    channels = len(laws)
    first = big.shape[1] - 3 * channels
    for point in range(3):
        at = len(x) + point * len(w)
        for i in range(len(table)):
            channel, seen = table[i, CHANNEL], at + table[i, FIRST_OBSERVATION]
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
    solve(store, newton, inverse, 3 * channels)


@ROUTINES.define(REAL(STORE, WHOLE, REAL, REAL, REAL))
def collocation_step(store: Whole, level: int, t: float, h: float, tolerance: float) -> float:
    """Try one step: write the forces at its three points into `point_forces`.

    The error is that of the forces at the beginning, over the largest so far, in units of the
    tolerance; infinity stands for an event, or for no convergence.

    The tolerance is an error over the largest force so far [1].
    """
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    p, matrix = line(store, P), grid(store, RATE_MATRIX)
    big, x = cube(store, STEP_MATRICES)[level], line(store, STATE)
    modes, largest_y = line(store, MODES), line(store, LARGEST_FORCES)
    v, w = grid(store, COMBINED), line(store, OBSERVED)
    g, room = line(store, STEP_VECTOR), line(store, STEP_RESULT)
    y, points = line(store, POINT_FORCES), grid(store, POINT_OBSERVED)
    inverse, right = grid(store, INVERSE_JACOBIAN), grid(store, RIGHT_SIDE)
    by_column, zeros = cube(store, STEP_COLUMNS)[level], line(store, ZEROS)
    part = grid(store, PART_COEFFICIENTS)
    states, observed_count, channels = len(x), len(w), len(laws)
    first, width = big.shape[1] - 3 * channels, by_column.shape[1]
    for k in range(states):
        g[k] = x[k]
    powers = part.shape[1]
    for i in range((first - states) // powers if powers > 0 else 0):
        for k in range(powers):
            g[states + i * powers + k] = part[i, k]
    for r in range(0, len(room), ROUND):
        found, rows = room.ctypes.data + 8 * r, address(by_column, opaque(0), r)
        sum_rows(found, zeros.ctypes.data, g.ctypes.data, first, rows, width)
    if channels == 0:
        return 0.0
    state_rate(store, x, t, part, 0.0)
    left = matrix.shape[1] - channels
    for r in range(3 * channels):
        y[r] = v[left + r % channels, 0]
    most = np.inf
    for trial in range(12):
        for o in range(0, 3 * observed_count, ROUND):
            found, start = points.ctypes.data + 8 * o, room.ctypes.data + 8 * (states + o)
            rows = address(by_column, first, states + o)
            sum_rows(found, start, y.ctypes.data, 3 * channels, rows, width)
        for point in range(3):
            if trial == 0 or trial == 4:
                law_slopes(store, points[point], t + RADAU[point] * h, point, False)
            law_values(
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
                    r, speed = (
                        point * channels + table[i, CHANNEL],
                        table[i, FIRST_OBSERVATION] + 1,
                    )
                    row = states + point * observed_count + speed
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
        if most <= NEWTON_TOLERANCE or not most < np.inf:
            break
    if not most <= NEWTON_TOLERANCE:
        return np.inf
    error = 0.0
    for i in range(len(table)):
        channel = table[i, CHANNEL]
        if table[i, FRICTION] == 1:
            for point in range(3):
                if modes[i] * points[point, table[i, FIRST_OBSERVATION] + 1] < 0.0:
                    return np.inf
                if modes[i] == 0.0 and abs(y[point * channels + channel]) > law_value(
                    laws[channel], table[i], 0.0, points[point], t + RADAU[point] * h, p
                ):
                    return np.inf
        for c in range(channel, channel + 1 + table[i, STATES]):
            begin, end = v[left + c, 0], y[2 * channels + c]
            at_left = _LEFT_1 * y[c] + _LEFT_2 * y[channels + c] + _LEFT_3 * end
            largest = max(largest_y[c], abs(begin), abs(end))
            if largest > 0.0:
                error = max(error, abs(at_left - begin) / largest)
    return error / tolerance


@ROUTINES.define(NOTHING(STORE, WHOLE))
def add_driven_inputs(store: Whole, level: int) -> None:
    """Add the contribution of inputs that depend on parameters to the slopes of a step."""
    driven, big = whole_grid(store, DRIVEN_INPUTS), cube(store, STEP_MATRICES)[level]
    part, slope_room = grid(store, PART_COEFFICIENTS), grid(store, STEP_RESULT_SLOPES)
    states, powers = len(line(store, STATE)), part.shape[1]
    inputs = len(part) - len(driven)
    for i in range(len(driven)):
        at = states + driven[i, 1] * powers
        for r in range(len(slope_room)):
            for k in range(powers):
                slope_room[r, driven[i, 0]] += big[r, at + k] * part[inputs + i, k]


@ROUTINES.define(NOTHING(STORE, WHOLE, REAL, REAL))
def accept_step(store: Whole, level: int, t: float, h: float) -> None:
    """Take the step that `collocation_step` found: state and slopes."""
    table, laws = whole_grid(store, EFFECT_TABLE), whole_line(store, LAWS)
    driven, big = whole_grid(store, DRIVEN_INPUTS), cube(store, STEP_MATRICES)[level]
    slope_big, x = cube(store, STEP_MATRIX_SLOPES)[level], line(store, STATE)
    slope, modes = grid(store, STATE_SLOPES), line(store, MODES)
    largest_y, largest_w = line(store, LARGEST_FORCES), line(store, LARGEST_OBSERVED)
    w, g, room = line(store, OBSERVED), line(store, STEP_VECTOR), line(store, STEP_RESULT)
    slope_room, y = grid(store, STEP_RESULT_SLOPES), line(store, POINT_FORCES)
    points, inverse = grid(store, POINT_OBSERVED), grid(store, INVERSE_JACOBIAN)
    by_column, slope_right = cube(store, STEP_COLUMNS)[level], grid(store, RIGHT_SIDE_SLOPES)
    states, observed_count, channels = len(x), len(w), len(laws)
    slopes, first = slope.shape[1], big.shape[1] - 3 * channels
    for r in range(3 * channels):
        g[first + r] = y[r]
        c = r % channels
        largest_y[c] = max(largest_y[c], abs(y[r]))
    for o in range(observed_count):
        largest_w[o] = max(largest_w[o], abs(points[2, o]))
    for k in range(0, states, ROUND):
        rows = address(by_column, first, k)
        found, start = x.ctypes.data + 8 * k, room.ctypes.data + 8 * k
        sum_rows(found, start, y.ctypes.data, 3 * channels, rows, by_column.shape[1])
    if slopes == 0:
        return
    linear_slopes(store, g, slope_big)
    propagate_slopes(store, big, slope_big.shape[1] // len(room), slope, slope_room)
    # Most inputs do not depend on any parameter.
    if len(driven) > 0:
        add_driven_inputs(store, level)
    for point in range(3):
        at = states + point * observed_count
        law_slopes(store, points[point], t + RADAU[point] * h, point, True)
        apply_chain_rule(store, point, slope_room, at, slope_right, point * channels)
        for i in range(len(table)):
            if table[i, FRICTION] == 1 and modes[i] == 0.0:
                r, speed = (
                    point * channels + table[i, CHANNEL],
                    at + table[i, FIRST_OBSERVATION] + 1,
                )
                for j in range(slopes):
                    share = slope_room[speed, j] / big[speed, first + r]
                    slope_right[r, j] = -share
    if channels > 0:
        newton_inverse(store, level)
    # The forces are not needed any more: their array takes products with the inverse.
    for k in range(states):
        for q in range(3 * channels):
            total = 0.0
            for r in range(3 * channels):
                total += big[k, first + r] * inverse[r, q]
            y[q] = total
        for j in range(0, slopes, ROUND):
            rows, start = address(slope_right, opaque(0), j), address(slope_room, k, j)
            sum_rows(address(slope, k, j), start, y.ctypes.data, 3 * channels, rows, slopes)


@compiled
def restrict_polynomials(coefficients: Reals, s: float, width: float, part: Reals) -> None:
    """Convert polynomials over the sample interval to polynomials over a part of it.

    The part begins at `s`, and is `width` long, over the sample interval [1].
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
def simulate(
    store: Whole,
    events: bool,
    coefficients: Reals,
    start_s: float,
    interval: float,
    tolerance: float,
    states: Reals,
    rates: Reals,
    forces: Reals,
    readouts: Whole,
    scale: Reals,
    slope_columns: Whole,
    output_slopes: Reals,
) -> int:
    """Simulate all samples; keep slopes of the sensors' outputs only.

    Parameters
    ----------
    store
        Addresses and shapes of all arrays of a run; see `memory_table`.
    events
        Whether friction or laws that jump make events.
    coefficients
        Polynomials of the inputs over each sample interval [time, input, power].
    start_s
        Campaign time of the first sample [s].
    interval
        Sample interval [s].
    tolerance
        Error of a step that is accepted, over the largest force so far [1].
    states, rates
        States and their rates at the samples [time, state]; written.
    held
        Forces at the samples [time, channel]; written.
    readouts
        Index of the state (of its rate where the second column is 1) that each sensor
        measures; -1 for none [sensor, 2].
    scale
        Factor of each sensor [sensor].
    target
        Column of `output_slopes` of each slope [slope].
    output_slopes
        Slopes of the outputs [sensor, time, column]; written.

    Returns
    -------
    Number of steps; negative where the run was given up.
    """
    laws, jumps = whole_line(store, LAWS), line(store, JUMP_TIMES)
    matrix, big = grid(store, RATE_MATRIX), cube(store, STEP_MATRICES)
    x, slope = line(store, STATE), grid(store, STATE_SLOPES)
    v, rate, slope_rate = grid(store, COMBINED), grid(store, RATE), grid(store, RATE_SLOPES)
    part = grid(store, PART_COEFFICIENTS)
    samples, channels, slopes = len(coefficients), len(laws), len(slope_columns)
    needs_rates = opaque(0)
    for k in range(len(readouts)):
        if readouts[k, 0] >= 0:
            needs_rates = max(needs_rates, readouts[k, 1])
    last_level = len(big) - 1
    parts, level, steps = 1 << last_level, 0 * last_level, 0
    first = matrix.shape[1] - channels
    if events:
        choose_friction_modes(store, start_s, coefficients[0], 0.0)
    for sample in range(samples):
        t = start_s + sample * interval
        state_rate(store, x, t, coefficients[sample], 0.0)
        for k in range(len(x)):
            states[sample, k], rates[sample, k] = x[k], rate[k, 0]
        for c in range(channels):
            forces[sample, c] = v[first + c, 0]
        if slopes > 0:
            if needs_rates == 1:
                state_rate_slopes(store, slope, t, coefficients[sample], 0.0, False)
            for k in range(len(readouts)):
                row = readouts[k, 0]
                if row >= 0:
                    source = slope_rate if readouts[k, 1] == 1 else slope
                    for j in range(slopes):
                        output_slopes[k, sample, slope_columns[j]] += scale[k] * source[row, j]
        parts_done = parts if sample + 1 == samples else 0
        while parts_done < parts:
            parts_of_step = parts >> level
            s, width = parts_done / parts, parts_of_step / parts
            at, h = t + s * interval, width * interval
            error = 0.0
            if events:
                for j in range(len(jumps)):
                    ahead = jumps[j] - at
                    if TIME_RESOLUTION * h < ahead and ahead <= h * (1.0 + TIME_RESOLUTION):
                        error = np.inf
            if error == 0.0:
                restrict_polynomials(coefficients[sample], s, width, part)
                error = collocation_step(store, level, at, h, tolerance)
            steps += 1
            if steps > MAX_STEPS_PER_SAMPLE * samples or not abs(x[0]) < MAX_STATE:
                return -sample - 1
            if error > 1.0 and level < last_level:
                level += 1
                continue
            if events and error == np.inf:
                step_through_events(store, at, h, coefficients[sample], s, width)
            else:
                accept_step(store, level, at, h)
            parts_done += parts_of_step
            if error < 0.2 and level > 0 and parts_done % (2 * parts_of_step) == 0:
                level -= 1
    return steps
