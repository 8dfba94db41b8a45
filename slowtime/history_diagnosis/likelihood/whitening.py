r"""Kalman filter of a Matérn process, applied to readings and regressors at once.

.. math:: y(t_i) = x(t_i)^T \beta + g(t_i) + \varepsilon_i, \qquad
          g \sim \text{Matérn}(\nu, \ell, \sigma_g), \quad \varepsilon_i \sim N(0, s_i^2)

For given :math:`\nu, \ell, \sigma_g` the filter is linear in its input and its gains do not
depend on it. Readings and regressors therefore share the gains and become innovations of unit
variance: least squares on these is the exact likelihood, in a time proportional to the number
of readings [1]_. The process is that of `slowtime.estimation.kernels`.

References
----------
.. [1] A. C. Harvey, "Forecasting, structural time series models and the Kalman filter",
   Cambridge University Press (1989), section 3.4.
"""

import dataclasses
import inspect
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float

from slowtime.estimation import kernels

_IGNORED_VARIANCE = 1e8
"""[variances of the readings] Noise given to a reading that is predicted but not used. Source:
its gain vanishes, and its variance still keeps eight of the sixteen digits."""


@dataclasses.dataclass(frozen=True, slots=True)
class MaternProcess:
    """A stationary Matérn process; none at all if `sd` is 0.

    Parameters
    ----------
    smoothness
        0.5 (continuous) or 1.5 (once differentiable) [1].
    """

    smoothness: float
    length: float
    sd: float

    @property
    def start(self) -> Float[np.ndarray, "state state"]:
        """Covariance before any reading."""
        return self.sd**2 * kernels.stationary(self.smoothness)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """Innovations of each column, and the state after the last reading.

    Parameters
    ----------
    white
        Innovations scaled to unit variance [1]; 0 where the reading was not used.
    log_determinant
        Of the covariance of the readings used [nats].
    mean, covariance
        State at that time; one mean for each column.
    """

    white: Float[np.ndarray, "time column"]
    spread: Float[np.ndarray, " time"]
    log_determinant: float
    time: float
    mean: Float[np.ndarray, "state column"]
    covariance: Float[np.ndarray, "state state"]


def whiten(
    process: MaternProcess,
    time: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> FilterResult:
    """Filter each column as if it were the readings.

    Parameters
    ----------
    time
        Ascending, in the unit of its length; equal times are allowed.
    variance
        Of the noise of each reading; infinite for one that is not used.

    Examples
    --------
    Without a process, whitening is weighting:

    >>> none = MaternProcess(0.5, 1.0, 0.0)
    >>> two = np.array([0.0, 1.0])
    >>> whiten(none, two, np.array([4.0, 1.0]), np.array([[2.0], [3.0]])).white.ravel()
    array([1., 3.])
    """
    mean = np.zeros((len(process.start), columns.shape[1]))
    state = FilterResult(columns[:0], time[:0], 0.0, float(time[0]), mean, process.start)
    return continue_whitening(process, state, time, variance, columns)


def continue_whitening(
    process: MaternProcess,
    state: FilterResult,
    time: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> FilterResult:
    """Filter later rows, starting from the state at which an earlier call ended."""
    step = np.diff(time, prepend=state.time)
    mean, covariance = state.mean.copy(), state.covariance.copy()
    white, spread, log_determinant = _filter(process, step, variance, columns, mean, covariance)
    return FilterResult(white, spread, log_determinant, float(time[-1]), mean, covariance)


def one_step_errors(
    process: MaternProcess,
    time: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    used: Bool[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> tuple[Float[np.ndarray, "time column"], Float[np.ndarray, " time"]]:
    """Predict each reading from the used ones before it."""
    filtered = whiten(process, time, np.where(used, variance, _IGNORED_VARIANCE), columns)
    ignored = filtered.spread - _IGNORED_VARIANCE + variance
    expected = np.maximum(np.where(used, filtered.spread, ignored), variance)
    return filtered.white * np.sqrt(filtered.spread)[:, None], expected


@no_type_check
def whitened_gram(
    process: MaternProcess,
    step: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
) -> tuple[Float[np.ndarray, "column column"], float]:
    """Products of the whitened columns with each other, and the log-determinant."""
    # Unchecked, because a search for the best process calls it thousands of times.
    start = process.start
    mean = np.zeros((len(start), columns.shape[1]))
    white, _, log_determinant = _filter(process, step, variance, columns, mean, start)
    return white.T @ white, log_determinant


@no_type_check
def _filter(
    process: MaternProcess,
    step: Float[np.ndarray, " time"],
    variance: Float[np.ndarray, " time"],
    columns: Float[np.ndarray, "time column"],
    mean: Float[np.ndarray, "state column"],
    covariance: Float[np.ndarray, "state state"],
) -> tuple[Float[np.ndarray, "time column"], Float[np.ndarray, " time"], float]:
    """Run the filter; writes the last state into `mean` and `covariance`."""
    run = _matern12 if process.smoothness == 0.5 else _matern32
    rate = float(np.sqrt(2.0 * process.smoothness) / process.length)
    columns = np.ascontiguousarray(columns)
    white, spread, log_determinant = run(
        rate, process.sd**2, step, variance, columns, mean, covariance
    )
    return white, spread, float(log_determinant)


def gram_of_each(
    white: Float[np.ndarray, "time candidate column"],
) -> Float[np.ndarray, "candidate column column"]:
    """Products of the whitened columns of each candidate with each other."""
    products: Float[np.ndarray, "candidate column column"] = _gram_of_each(white)
    return products


def _gram_of_each_loop(white):  # type: ignore[no-untyped-def]
    count, each, width = white.shape
    out = np.zeros((each, width, width))
    for n in range(count):
        for k in range(each):
            for i in range(width):
                for j in range(width):
                    out[k, i, j] += white[n, k, i] * white[n, k, j]
    return out


def _matern12_loop(rate, level, step, variance, columns, mean, covariance):  # type: ignore[no-untyped-def]
    white, spreads = np.empty(columns.shape), np.empty(len(step))
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
    return white, spreads, total


def _matern32_loop(rate, level, step, variance, columns, mean, covariance):  # type: ignore[no-untyped-def]
    white, spreads = np.empty(columns.shape), np.empty(len(step))
    count = columns.shape[1]
    total = 0.0
    # Propagates the difference from the stationary covariance: long steps lose no digits.
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
    return white, spreads, total


# Unwrapped, because tests wrap every function in a checker of array shapes.
_gram_of_each = numba.njit(cache=True)(inspect.unwrap(_gram_of_each_loop))
_matern12 = numba.njit(cache=True)(inspect.unwrap(_matern12_loop))
_matern32 = numba.njit(cache=True)(inspect.unwrap(_matern32_loop))
