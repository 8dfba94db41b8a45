r"""What a history may follow, as functions of slow time or of a covariate.

Times are scaled to 0 at the first epoch of the history and 1 at its last; later epochs lie
beyond 1. Each function gives one column for each coefficient.
"""

import inspect
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from .history import Series

Columns = Float[np.ndarray, "time column"]


@no_type_check
def lagged(time: Series, values: Series, lag: float) -> Series:
    r"""Follow a covariate as a body of thermal inertia does.

    .. math:: \tau \dot z = x - z, \quad z(0) = x(0)

    with x straight between its readings, for which the steps are exact.

    Examples
    --------
    >>> lagged(np.array([0.0, 1.0]), np.array([0.0, 1.0]), 1.0).round(4)
    array([0.    , 0.3679])
    """
    followed: Series = _follow(np.diff(time) / lag, np.ascontiguousarray(values))
    return followed


@no_type_check
def delayed(time: Series, values: Series, delay: float) -> Series:
    """Give the covariate as it was a while ago."""
    earlier: Series = np.interp(time - delay, time, values)
    return earlier


@no_type_check
def straight(values: Series) -> Columns:
    """One slope."""
    return values[:, None]


@no_type_check
def bent(values: Series, kink: float) -> Columns:
    """One slope below the kink, another above it."""
    return np.column_stack([np.minimum(values - kink, 0.0), np.maximum(values - kink, 0.0)])


@no_type_check
def power(level: Series, exponent: float) -> Columns:
    """Level of vibration, not negative, to a power."""
    column: Columns = (np.maximum(level, 0.0) ** exponent)[:, None]
    return column


def curved(values: Series) -> Columns:
    """Draw a free curve: polynomials orthogonal over its middle, tamed beyond it."""
    tame = np.tanh(values / 2.5)
    return np.polynomial.legendre.legvander(tame, 6)[:, 1:]


@no_type_check
def step(time: Series, at: float) -> Columns:
    """0 before, 1 from then on."""
    return (time >= at).astype(float)[:, None]


@no_type_check
def ramp(time: Series, onset: float) -> Columns:
    """Growing steadily from its onset."""
    return np.maximum(time - onset, 0.0)[:, None]


@no_type_check
def exponential(time: Series, rate: float) -> Columns:
    r"""Grow as :math:`(e^{r t} - 1) / (e^r - 1)`: from 0 to 1 over the history."""
    with np.errstate(over="ignore"):
        grown: Columns = np.minimum(np.expm1(rate * time) / np.expm1(rate), 1e6)[:, None]
    return grown


@no_type_check
def power_law(time: Series, exponent: float) -> Columns:
    """Power of the time since the start."""
    column: Columns = (np.maximum(time, 0.0) ** exponent)[:, None]
    return column


@no_type_check
def sawtooth(time: Series, cycles: float, phase: float) -> Columns:
    """Ramp from -1/2 to 1/2, `cycles` times in a history; `phase` at its middle."""
    return (np.mod((time - 0.5) * cycles + phase, 1.0) - 0.5)[:, None]


@no_type_check
def since(time: Series, falls: list[float]) -> Columns:
    """Time since the last of the falls; before the first, since an instant not known."""
    last = np.concatenate([[0.0], np.sort(falls)])
    tooth = np.searchsorted(last[1:], time, side="right")
    return np.column_stack([time - last[tooth], (tooth == 0).astype(float)])


@no_type_check
def wave(time: Series, cycles: float) -> Columns:
    """Cosine and sine."""
    angle = 2.0 * np.pi * cycles * (time - 0.5)
    return np.column_stack([np.cos(angle), np.sin(angle)])


@no_type_check
def breathing(time: Series, values: Series, onset: float) -> Columns:
    """Draw a loss from its onset on, and what of it opens and closes with the covariate."""
    open_ = (time >= onset).astype(float)
    return np.column_stack([open_, open_ * values])


def _follow_loop(steps, values):  # type: ignore[no-untyped-def]
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


_follow = numba.njit(cache=True)(inspect.unwrap(_follow_loop))
