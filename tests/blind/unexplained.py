"""How far an effect stands above the noise, once the linear model is bent as far as it may.

The measure is what the best linear refit leaves of the noiseless response, over the sensor
noise, in decibels. Each stiffness and damping may move by two of its stated standard
deviations; where records do not start from rest, each record's initial state is free.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import least_squares, lsq_linear

from .linear import linear_motion
from .rig import Rig
from .sensing import Sensor
from .signals import Signal

Array = NDArray[np.float64]
ROWS = 1200
"""Instants of a record that are looked at."""
REACH = 2.0
"""Standard deviations that a constant may move."""
NUDGE = 1e-4
STEPS_DOWN, SCAN = 12, 9
"""Steps to the best linear refit, at most; stiffnesses that are looked at beforehand."""
STEPS = 40
"""Runs at most, to the price."""


@dataclasses.dataclass(frozen=True, eq=False)
class Seen:
    """One record as the refit sees it."""

    forces: dict[int, Signal]
    base: Signal | None
    first_knot: int
    """Knot of the first sample."""
    stride: int
    """Knots a sample."""
    outputs: Array
    """Noiseless, with what is wrong with the sensors."""
    noise: Array
    """Standard deviation, one a sensor."""

    def rows(self) -> NDArray[np.intp]:
        return np.arange(0, len(self.outputs), max(1, len(self.outputs) // ROWS))


def unexplained(
    records: list[Seen],
    nominal: Rig,
    rig: Rig,
    sensors: tuple[Sensor, ...],
    tolerance: tuple[float, float],
    free_start: bool,
) -> tuple[float, Array]:
    """Give the ratio in decibels, and the factors of stiffness and damping that were found.

    The search begins at `rig`, the rig as it is without effects, and again where all springs
    together, harder or softer, leave least: a slip of phase makes minima of its own.
    """
    bound = REACH * np.repeat(tolerance, len(nominal.elements))
    begin = np.clip(_moved(rig, nominal), -bound, bound)
    known = (records, nominal, sensors)

    def left(theta: Array) -> float:
        residual, _ = _linearised(*known, theta, free_start, slopes=False)
        return float(residual @ residual)

    springs = np.arange(len(begin)) < len(nominal.elements)
    scan = [
        np.clip(np.where(springs, (1 + begin) * (1 + share) - 1, begin), -bound, bound)
        for share in REACH * tolerance[0] * np.linspace(-1, 1, SCAN)
    ]
    starts = (begin, min(scan, key=left))
    found = [_descended(*known, theta, bound, free_start, left) for theta in starts]
    least, theta = min(found, key=lambda pair: pair[0])
    seen = sum(record.rows().size * len(sensors) for record in records)
    return 10 * math.log10(max(least / seen, 1e-12)), 1 + theta


def _descended(
    records: list[Seen],
    nominal: Rig,
    sensors: tuple[Sensor, ...],
    theta: Array,
    bound: Array,
    free_start: bool,
    left: Callable[[Array], float],
) -> tuple[float, Array]:
    """Go down from a start by steps of Gauss and Newton, as long as they lead down."""
    least = left(theta)
    for _ in range(STEPS_DOWN):
        residual, slopes = _linearised(records, nominal, sensors, theta, free_start)
        step = lsq_linear(
            slopes, residual, (-bound - theta - 1e-12, bound - theta + 1e-12), method="bvls"
        ).x
        lower = left(theta + step)
        if lower > least * (1 - 1e-3):
            break
        least, theta = lower, theta + step
    return least, theta


def price(
    records: list[Seen],
    nominal: Rig,
    rig: Rig,
    sensors: tuple[Sensor, ...],
    tolerance: tuple[float, float],
    free_start: bool,
) -> float:
    """Give the least chi-squared at which constants alone explain the noiseless records.

    What they leave, of all samples, and the squares of how many tolerances each moved.
    """
    theta, sd = _moved(rig, nominal), np.repeat(tolerance, len(nominal.elements))
    seen = sum(record.rows().size for record in records)
    weight = math.sqrt(sum(len(record.outputs) for record in records) / seen)

    def left(bent: Array) -> Array:
        residual, _ = _linearised(records, nominal, sensors, bent, free_start, slopes=False)
        return np.concatenate([weight * residual, -bent / sd])

    def slopes(bent: Array) -> Array:
        matrix = _linearised(records, nominal, sensors, bent, free_start)[1]
        return -np.vstack([weight * matrix, np.diag(1 / sd)])

    found = least_squares(left, theta, slopes, bounds=(-0.9, 9.0), x_scale=sd, max_nfev=STEPS)
    return 2 * float(found.cost)


def _moved(rig: Rig, nominal: Rig) -> Array:
    """Shares by which stiffnesses, then dampings, are off."""
    pairs = list(zip(rig.elements, nominal.elements, strict=True))
    factors = [a.stiffness / b.stiffness for a, b in pairs]
    factors += [a.damping / b.damping for a, b in pairs]
    return np.array(factors) - 1


def _linearised(
    records: list[Seen],
    nominal: Rig,
    sensors: tuple[Sensor, ...],
    theta: Array,
    free_start: bool,
    *,
    slopes: bool = True,
) -> tuple[Array, Array]:
    """Residual over noise and its slopes, what initial states explain taken out of both."""
    residuals, matrices = [], []
    for record in records:
        rows, scale = record.rows(), 1.0 / record.noise
        base = _outputs(record, _bent(nominal, theta), sensors)
        columns = [((record.outputs[rows] - base) * scale).ravel()]
        for i in range(len(theta) if slopes else 0):
            nudged = theta + NUDGE * np.eye(len(theta))[i]
            there = _outputs(record, _bent(nominal, nudged), sensors)
            columns.append(((there - base) / NUDGE * scale).ravel())
        block = np.column_stack(columns)
        if free_start:
            decays = _decays(record, _bent(nominal, theta), sensors, rows) * scale
            basis = scipy.linalg.orth(decays.reshape(len(decays), -1).T)
            block = block - basis @ (basis.T @ block)
        residuals.append(block[:, 0])
        matrices.append(block[:, 1:])
    return np.concatenate(residuals), np.concatenate(matrices)


def _bent(nominal: Rig, theta: Array) -> Rig:
    half = len(theta) // 2
    return nominal.scaled((1 + theta[:half]).tolist(), (1 + theta[half:]).tolist())


def _outputs(record: Seen, rig: Rig, sensors: tuple[Sensor, ...]) -> Array:
    knots = record.first_knot + record.stride * (len(record.outputs) - 1) + 1
    at = record.first_knot + record.stride * record.rows()
    motion = linear_motion(rig, record.forces, record.base, knots)
    shaken = np.zeros(len(at))
    if record.base is not None:
        shaken = record.base.at(at / record.base.rate_hz)
    by_quantity = dict(zip(("displacement", "velocity", "acceleration"), motion, strict=True))
    return np.column_stack(
        [
            by_quantity[s.quantity][at, s.node]
            + (shaken if s.quantity == "acceleration" else 0 * shaken)
            for s in sensors
        ]
    )


def _decays(
    record: Seen, rig: Rig, sensors: tuple[Sensor, ...], rows: NDArray[np.intp]
) -> Array:
    """Responses to a unit of each initial state [state time sensor]."""
    signal = next(iter([*record.forces.values(), record.base]))
    assert signal is not None
    n, matrix = rig.size, rig.state_matrix()
    poles, shapes = np.linalg.eig(matrix)
    times = rows * record.stride / signal.rate_hz
    grown = np.exp(np.outer(times, poles))
    states = np.einsum("sm,tm,mi->its", shapes, grown, np.linalg.inv(shapes)).real
    rates = states @ matrix.T
    pick = {
        "displacement": states[:, :, :n],
        "velocity": states[:, :, n:],
        "acceleration": rates[:, :, n:],
    }
    return np.stack([pick[s.quantity][:, :, s.node] for s in sensors], axis=2)
