r"""Regressors of the candidate laws, as functions of slow time or of a covariate.

Times are scaled to 0 at the first epoch of the history and 1 at its last; later epochs lie
beyond 1. Covariates are scaled to zero mean and unit standard deviation. All arguments and
results are therefore without unit. Each function of a law returns one column for each
coefficient, shape (time, column).
"""

import inspect
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis.data.history import Series

Columns = Float[np.ndarray, "time column"]


@no_type_check
def lagged(time: Series, values: Series, lag: float) -> Series:
    r"""Return a covariate behind a first-order lag (thermal inertia).

    .. math:: \tau \dot z = x - z, \quad z(0) = x(0)

    with x linear between its readings, for which the steps are exact.

    Parameters
    ----------
    lag
        :math:`\tau`, in the unit of `time`.

    Examples
    --------
    >>> lagged(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 1.0).round(4)
    array([0.    , 0.3679])
    """
    followed: Series = _lag(np.diff(time) / lag, np.ascontiguousarray(values))
    return followed


@no_type_check
def delayed(time: Series, values: Series, delay: float) -> Series:
    """Return a covariate as it was `delay` earlier, interpolated linearly."""
    earlier: Series = np.interp(time - delay, time, values)
    return earlier


@no_type_check
def linear(values: Series) -> Columns:
    """Return the covariate itself: one slope."""
    return values[:, None]


@no_type_check
def bilinear(values: Series, kink: float) -> Columns:
    """Return the distances below and above a kink: a slope for each side."""
    return np.column_stack([np.minimum(values - kink, 0.0), np.maximum(values - kink, 0.0)])


@no_type_check
def level_power(level: Series, exponent: float) -> Columns:
    """Return a power of the vibration level; negative levels count as 0."""
    column: Columns = (np.maximum(level, 0.0) ** exponent)[:, None]
    return column


def free_curve(values: Series) -> Columns:
    """Return six Legendre polynomials of a covariate that is squashed into (-1, 1) by tanh."""
    # The squashing, at 2.5 standard deviations, bounds the curve beyond the history.
    tame = np.tanh(values / 2.5)
    return np.polynomial.legendre.legvander(tame, 6)[:, 1:]


@no_type_check
def step(time: Series, at: float) -> Columns:
    """Return 0 before an instant and 1 from then on."""
    return (time >= at).astype(float)[:, None]


@no_type_check
def ramp(time: Series, onset: float) -> Columns:
    """Return the time since an onset; 0 before it."""
    return np.maximum(time - onset, 0.0)[:, None]


@no_type_check
def exponential(time: Series, rate: float) -> Columns:
    r"""Return :math:`(e^{r t} - 1) / (e^r - 1)`: from 0 to 1 over the history; `rate` not 0."""
    with np.errstate(over="ignore"):
        grown: Columns = np.minimum(np.expm1(rate * time) / np.expm1(rate), 1e6)[:, None]
    return grown


@no_type_check
def power_law(time: Series, exponent: float) -> Columns:
    """Return a power of the time since the start."""
    column: Columns = (np.maximum(time, 0.0) ** exponent)[:, None]
    return column


@no_type_check
def sawtooth(time: Series, cycles: float, phase: float) -> Columns:
    """Return a sawtooth between -1/2 and 1/2."""
    return (np.mod((time - 0.5) * cycles + phase, 1.0) - 0.5)[:, None]


@no_type_check
def irregular_sawtooth(time: Series, falls: list[float]) -> Columns:
    """Return the time since the last fall, and whether none has happened yet."""
    last = np.concatenate([[0.0], np.sort(falls)])
    tooth = np.searchsorted(last[1:], time, side="right")
    # The second column is the level of the first tooth, whose beginning is not known.
    return np.column_stack([time - last[tooth], (tooth == 0).astype(float)])


@no_type_check
def harmonic(time: Series, cycles: float) -> Columns:
    """Return cosine and sine of `cycles` periods in the history, zero phase at its middle."""
    angle = 2.0 * np.pi * cycles * (time - 0.5)
    return np.column_stack([np.cos(angle), np.sin(angle)])


@no_type_check
def breathing_crack(time: Series, values: Series, onset: float) -> Columns:
    """Return a step at an onset, and its product with a covariate that opens the crack."""
    open_ = (time >= onset).astype(float)
    return np.column_stack([open_, open_ * values])


def _lag_loop(steps, values):  # type: ignore[no-untyped-def]
    out = np.empty_like(values)
    out[0] = values[0]
    for i in range(len(steps)):
        h = steps[i]
        if h <= 0.0:
            out[i + 1] = out[i]
            continue
        slope = (values[i + 1] - values[i]) / h
        out[i + 1] = values[i + 1] - slope + (out[i] - values[i] + slope) * np.exp(-h)
    return out


_lag = numba.njit(cache=True)(inspect.unwrap(_lag_loop))
