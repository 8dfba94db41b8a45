r"""Imposed displacements and velocities, as accelerations that are polynomials between samples.

A plant is driven by accelerations. Those of a displacement are the second derivative of the
quintic spline through its samples. It is four times continuously differentiable, so that
integrating the acceleration twice from the first displacement and velocity gives every sample
back, to rounding: springs feel the displacement as it was measured, whatever its noise. The
relative error of the velocity of a sine is :math:`(\omega h)^6 / 5040`, 12 in a million at a
tenth of the sampling rate :math:`1/h`, three in a thousand at a quarter of it.
White noise of standard deviation :math:`\sigma` has a velocity of up to
:math:`\pi \sigma / (\sqrt{3} h)`, which dampers and laws of velocity feel, and nothing else.

References
----------
.. [1] C. de Boor, "A Practical Guide to Splines" (1978), chapters XII and XIII.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float

from slowtime.dynamics.description import Description
from slowtime.dynamics.transfer import QUANTITIES

from .sensing import held

DEGREE = 5
"""Of splines: their accelerations are smooth enough for a stepper of order 5."""
KEPT, LONG = 16, 100_000
"""Inputs whose splines are kept, and samples of one from which they are not."""

Polynomials = Float[np.ndarray, "time input power"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """Inputs that drive a plant.

    Parameters
    ----------
    start
        Displacement [m] and velocity [m/s] of each input at the first sample; zero where it
        does not tell them.
    """

    coefficients: Polynomials
    start: Float[np.ndarray, "2 input"]


def differentiations(description: Description) -> tuple[int, ...]:
    """How often each input is differentiated to a force or an acceleration: 0, 1 or 2."""
    return tuple(
        0 if entry.quantity == "force" else 2 - QUANTITIES.index(entry.quantity)
        for entry in description.inputs
    )


def driven_by(
    columns: Float[np.ndarray, "time input"],
    holds: Sequence[str],
    times: Sequence[int],
    interval: float,
) -> Driven:
    """Interpolate inputs, and differentiate those that are displacements or velocities.

    Columns are in SI units; `times` says how often each is differentiated: 0, 1 or 2.
    """
    start = np.zeros((2, len(times)))
    if not holds:
        return Driven(np.zeros((len(columns), 0, 1)), start)
    if not any(times):
        return Driven(held(columns, holds), start)
    found = np.zeros((*columns.shape, DEGREE + 1))
    held_columns = [k for k, (count, hold) in enumerate(zip(times, holds, strict=True))
                    if not count or hold != "band_limited"]  # fmt: skip
    if held_columns:
        known = held(columns[:, held_columns], [holds[k] for k in held_columns])
        found[:, held_columns, : known.shape[2]] = known
    for column in set(range(len(times))) - set(held_columns):
        found[:, column] = _spline(columns[:, column])
    powers = np.arange(1, found.shape[2])
    for column, count in enumerate(times):
        for order in range(2 - count, 2):
            start[order, column] = found[0, column, 0]
            found[:, column, :-1] = found[:, column, 1:] * (powers / interval)
            found[:, column, -1] = 0.0
        if count and len(found) > 1:
            # Beyond the last sample nothing is known: the acceleration stays.
            found[-1, column] = 0.0
            found[-1, column, 0] = found[-2, column].sum()
    used = np.flatnonzero(found.any(axis=(0, 1)))
    return Driven(
        np.ascontiguousarray(found[:, :, : (used[-1] + 1 if len(used) else 1)]), start
    )


def _spline(column: Float[np.ndarray, " time"]) -> Float[np.ndarray, "time power"]:
    """Coefficients of the spline through a signal; the last row stays at the last value."""
    if len(column) >= LONG:
        return _coefficients(column)
    return _cached_polynomials(np.ascontiguousarray(column, dtype=float).tobytes())


@functools.lru_cache(maxsize=KEPT)
def _cached_polynomials(column: bytes) -> Float[np.ndarray, "time power"]:
    return _coefficients(np.frombuffer(column))


def _coefficients(column: Float[np.ndarray, " time"]) -> Float[np.ndarray, "time power"]:
    found = np.zeros((len(column), DEGREE + 1))
    found[:, 0] = column
    degree = min(DEGREE, len(column) - 1)
    if degree < 1:
        return found
    # Of a parabola or a quartic there is no spline that is determined by samples alone.
    spline = scipy.interpolate.make_interp_spline(
        np.arange(len(column)), column, k=degree - (degree + 1) % 2
    )
    inside = np.arange(len(column) - 1)
    for power in range(1, spline.k + 1):
        # The highest derivative jumps at samples; that of the interval is meant.
        at = inside + (0.5 if power == spline.k else 0.0)
        found[:-1, power] = spline.derivative(power)(at) / math.factorial(power)
    return found
