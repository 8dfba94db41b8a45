r"""Readings and regressors through the Kalman filter of one wandering process, all at once.

.. math:: y(t_i) = x(t_i)^T \beta + g(t_i) + \varepsilon_i, \qquad
          g \sim \text{Matérn}(\nu, \ell, \sigma_g), \quad \varepsilon_i \sim N(0, s_i^2)

For given :math:`\nu, \ell, \sigma_g` the filter is linear in what it is fed with, and its gains
do not depend on it. So readings and columns of regressors share them, and come out as
innovations of unit variance: least squares on these is the exact likelihood, in a time
proportional to the number of readings (Harvey, "Forecasting, structural time series models and
the Kalman filter", 1989, section 3.4). The process is that of `slowtime.estimation.kernels`.
"""

import dataclasses
import inspect
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from slowtime.estimation import kernels


@dataclasses.dataclass(frozen=True, slots=True)
class Wander:
    """A Matérn process of smoothness 0.5 or 1.5; `sd` 0 for none at all.

    Parameters
    ----------
    smoothness
        0.5 (rough) or 1.5 (once differentiable).
    length
        Length scale, in the unit of time.
    sd
        Standard deviation, in the unit of the readings.
    """

    smoothness: float
    length: float
    sd: float

    @property
    def start(self) -> Float[np.ndarray, "state state"]:
        """Covariance before any reading."""
        return self.sd**2 * kernels.stationary(self.smoothness)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """What the filter gives back.

    Parameters
    ----------
    white
        Innovations of each column, of unit variance; 0 where the reading was not used.
    spread
        Variance of each innovation before it was scaled.
    log_determinant
        Of the covariance of the readings used.
    time
        Of the last reading.
    mean, covariance
        State after it: one mean for each column.
    """

    white: Float[np.ndarray, "time column"]
    spread: Float[np.ndarray, " time"]
    log_determinant: float
    time: float
    mean: Float[np.ndarray, "state column"]
    covariance: Float[np.ndarray, "state state"]


def whiten(
    wander: Wander,
    time: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> Filtered:
    """Filter columns as if each were the readings.

    Parameters
    ----------
    wander
        The process.
    time
        Ascending; equal times are allowed.
    variance
        Of the noise of each reading; infinite for one that is not to be used.
    columns
        Readings and regressors.

    Examples
    --------
    Without a process, whitening is weighting:

    >>> idle = Wander(0.5, 1.0, 0.0)
    >>> two = np.array([0.0, 1.0])
    >>> whiten(idle, two, np.array([4.0, 1.0]), np.array([[2.0], [3.0]])).white.ravel()
    array([1., 3.])
    """
    size = round(wander.smoothness + 0.5)
    mean = np.zeros((size, columns.shape[1]))
    state = Filtered(columns[:0], time[:0], 0.0, float(time[0]), mean, wander.start)
    return carry_on(wander, state, time, variance, columns)


def carry_on(
    wander: Wander,
    state: Filtered,
    time: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> Filtered:
    """Filter more rows, from where an earlier call ended."""
    step = np.diff(time, prepend=state.time)
    mean, covariance = state.mean.copy(), state.covariance.copy()
    white, spread = np.empty(columns.shape), np.empty(len(time))
    rate = float(kernels.rate(wander.smoothness, wander.length))
    run = _rough if wander.smoothness == 0.5 else _smooth
    columns = np.ascontiguousarray(columns)
    log_determinant = run(
        rate, wander.sd**2, step, variance, columns, mean, covariance, white, spread
    )
    return Filtered(white, spread, float(log_determinant), float(time[-1]), mean, covariance)


@no_type_check
def gram(
    smoothness: float,
    length: float,
    sd: float,
    step: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> tuple[Float[np.ndarray, "column column"], float]:
    """Products of the whitened columns with each other, and the logarithm of the determinant.

    What a search for the best process asks for over and over, so that it is neither wrapped in
    a class nor checked. `step` is the time since the
    reading before, 0 for the first.
    """
    size = round(smoothness + 0.5)
    mean, white = np.zeros((size, columns.shape[1])), np.empty(columns.shape)
    rate = np.sqrt(2.0 * smoothness) / length
    run = _rough if smoothness == 0.5 else _smooth
    covariance, spread = sd**2 * np.eye(size), np.empty(len(step))
    log_determinant = run(rate, sd**2, step, variance, columns, mean, covariance, white, spread)
    return white.T @ white, float(log_determinant)


def blocks(
    white: Float[np.ndarray, "time candidate column"],
) -> Float[np.ndarray, "candidate column column"]:
    """Products of the columns of each candidate with each other."""
    products: Float[np.ndarray, "candidate column column"] = _blocks(white)
    return products


def _blocks_loop(white):  # type: ignore[no-untyped-def]
    count, each, width = white.shape
    out = np.zeros((each, width, width))
    for n in range(count):
        for k in range(each):
            for i in range(width):
                for j in range(width):
                    out[k, i, j] += white[n, k, i] * white[n, k, j]
    return out


def _rough_loop(rate, level, step, variance, columns, mean, covariance, white, spreads):  # type: ignore[no-untyped-def]
    count = columns.shape[1]
    total = 0.0
    p = covariance[0, 0]
    for i in range(columns.shape[0]):
        kept = np.exp(-rate * step[i])
        p = level + (p - level) * kept * kept
        spread = p + variance[i]
        spreads[i] = spread
        if np.isinf(spread):
            for j in range(count):
                mean[0, j] *= kept
                white[i, j] = 0.0
            continue
        gain = p / spread
        scale = 1.0 / np.sqrt(spread)
        total += np.log(spread)
        for j in range(count):
            expected = mean[0, j] * kept
            residual = columns[i, j] - expected
            white[i, j] = residual * scale
            mean[0, j] = expected + gain * residual
        p -= gain * p
    covariance[0, 0] = p
    return total


def _smooth_loop(rate, level, step, variance, columns, mean, covariance, white, spreads):  # type: ignore[no-untyped-def]
    count = columns.shape[1]
    total = 0.0
    # What departs from the stationary covariance, so that a long step cannot lose digits.
    p00, p01, p11 = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    for i in range(columns.shape[0]):
        s = rate * step[i]
        fade = np.exp(-s)
        a, b, c, d = (1.0 + s) * fade, s * fade, -s * fade, (1.0 - s) * fade
        e00, e01, e11 = p00 - level, p01, p11 - level
        p00 = level + a * a * e00 + 2.0 * a * b * e01 + b * b * e11
        p01 = a * c * e00 + (a * d + b * c) * e01 + b * d * e11
        p11 = level + c * c * e00 + 2.0 * c * d * e01 + d * d * e11
        spread = p00 + variance[i]
        spreads[i] = spread
        if np.isinf(spread):
            for j in range(count):
                first, second = mean[0, j], mean[1, j]
                mean[0, j] = a * first + b * second
                mean[1, j] = c * first + d * second
                white[i, j] = 0.0
            continue
        gain0, gain1 = p00 / spread, p01 / spread
        scale = 1.0 / np.sqrt(spread)
        total += np.log(spread)
        for j in range(count):
            first, second = mean[0, j], mean[1, j]
            expected = a * first + b * second
            residual = columns[i, j] - expected
            white[i, j] = residual * scale
            mean[0, j] = expected + gain0 * residual
            mean[1, j] = c * first + d * second + gain1 * residual
        p11 -= gain1 * p01
        p01 -= gain0 * p01
        p00 -= gain0 * p00
    covariance[0, 0], covariance[0, 1], covariance[1, 0], covariance[1, 1] = p00, p01, p01, p11
    return total


# Compiled at the first call. Unwrapped, for in tests every function wears a checker of shapes.
_blocks = numba.njit(cache=True)(inspect.unwrap(_blocks_loop))
_rough = numba.njit(cache=True)(inspect.unwrap(_rough_loop))
_smooth = numba.njit(cache=True)(inspect.unwrap(_smooth_loop))
