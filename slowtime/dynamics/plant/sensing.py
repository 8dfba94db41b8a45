"""Sensor outputs from states, and applied inputs from recorded ones."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import BASE, Description
from slowtime.dynamics.effects import Effect, InputChange, Kind, Law, SensorChange
from slowtime.dynamics.transfer import QUANTITIES
from slowtime.dynamics.units import unit_factor
from slowtime.signals.interpolation import polynomials

from .parameter_names import Name

Series = Float[np.ndarray, " time"]
Values = Float[np.ndarray, " parameter"]
Several = Float[np.ndarray, "*any time"]
Act = Callable[[Several, Series, Values], Several]
Polynomials = Float[np.ndarray, "time input power"]
KEPT, LONG = 16, 100_000
"""Inputs whose polynomials are kept, and samples of one from which they are not."""
NUDGE = 1e-6
"""Relative step of central differences of what inputs and sensors do."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Base:
    """Motion of the base: displacement, velocity, acceleration, each over time and slope."""

    motion: tuple[Float[np.ndarray, "time slope"], ...]


def acting(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    values: Mapping[Name, float],
    inputs: Float[np.ndarray, "time input"],
    times: Series,
    free: Sequence[Name],
) -> tuple[Float[np.ndarray, "time input"], list[tuple[Name, int, Series]]]:
    """Convert recorded inputs to those that act, and differentiate these to free parameters.

    Effects of kind `InputChange` alter an input. Gives inputs in SI units, and for each
    derivative its parameter, column and series.
    """
    acts, slopes = np.empty_like(inputs, dtype=float), []
    for column, entry in enumerate(description.inputs):
        factor = unit_factor(entry.unit, entry.quantity, description.unit_of_coordinate)
        series = factor * np.asarray(inputs[:, column], dtype=float)
        directions: list[tuple[Name, Series]] = []
        for i, effect in enumerate(effects):
            action = kinds[i].action
            if not isinstance(action, InputChange) or effect.place.id != entry.channel:
                continue
            p = np.array([values["effect", i, name] for name in kinds[i].names])
            still = action.act(0 * series, times, p)
            directions = [(name, action.act(s, times, p) - still) for name, s in directions]
            for k, name in enumerate(kinds[i].names):
                if ("effect", i, name) in free:
                    slope = _by_parameter(action.act, series, times, p, k)
                    directions.append((("effect", i, name), slope))
            series = action.act(series, times, p)
        acts[:, column] = series
        slopes += [(name, column, direction) for name, direction in directions]
    return acts, slopes


def held(columns: Float[np.ndarray, "time input"], holds: Sequence[str]) -> Polynomials:
    """Compute the polynomials of inputs between samples, up to the powers that are used."""
    powers = max({"zero": 1, "first": 2}.get(hold, 6) for hold in holds)
    found = [
        _cached_polynomials(column.tobytes(), hold, powers)
        if len(column) < LONG
        else polynomials(np.ascontiguousarray(column), hold)[:, :powers]
        for column, hold in zip(columns.T, holds, strict=True)
    ]
    return np.ascontiguousarray(np.stack(found, axis=1))


@functools.lru_cache(maxsize=KEPT)
def _cached_polynomials(
    column: bytes, hold: str, powers: int
) -> Float[np.ndarray, "time power"]:
    """Find polynomials once for all runs of a record, with no more powers than are used."""
    return polynomials(np.frombuffer(column), hold)[:, :powers].copy()


def base_of(
    along: Float[np.ndarray, "time power slope"],
    interval: float,
    start: Float[np.ndarray, "2 slope"],
) -> Base:
    """Integrate a base acceleration that is polynomial between samples.

    Coefficients are over the share of the sample interval, with their slopes; displacement [m],
    velocity [m/s] and acceleration [m/s^2] at the samples have theirs.
    """
    powers = np.arange(along.shape[1])[:, None]
    gained = interval * np.sum(along / (powers + 1), axis=1)
    velocity = start[1] + np.cumsum(gained, axis=0) - gained
    moved = interval**2 * np.sum(along / ((powers + 1) * (powers + 2)), axis=1)
    moved = moved + interval * velocity
    return Base((start[0] + np.cumsum(moved, axis=0) - moved, velocity, along[:, 0]))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SensorReadout:
    """What one sensor reads.

    Parameters
    ----------
    coordinate
        Free coordinate whose motion it measures; None where it measures none.
    order
        Of the derivative; 2 of the integral of a measured force, too.
    absolute
        Whether the motion of the base is added.
    factor
        From SI to the unit of the sensor.
    support, gauge
        Number of the support or driven node, or of the force sensor; None for others.
    """

    coordinate: int | None
    order: int
    absolute: bool
    factor: float
    support: int | None = None
    gauge: int | None = None

    def row(self, free: int, states: int, moved: int, gauges: int) -> int | None:
        """Return the index of the state whose value or, from order 2, rate is read.

        None where nothing moves.
        """
        if self.gauge is not None:
            return states - gauges + self.gauge
        if self.support is not None:
            first = states - gauges - (moved if self.order else 2 * moved)
            return first + self.support
        if self.coordinate is None:
            return None
        return self.coordinate + (free if self.order else 0)


def sensor_readouts(
    description: Description, names: Sequence[str]
) -> tuple[SensorReadout, ...]:
    """Return the readout of each sensor of a description."""
    found: list[SensorReadout] = []
    moved, gauges = description.moved, 0
    for sensor in description.sensors:
        factor = unit_factor(sensor.unit, sensor.quantity, description.unit_of_coordinate)
        if sensor.quantity == "force":
            found.append(SensorReadout(None, 2, False, 1 / factor, gauge=gauges))
            gauges += 1
            continue
        # A node that is held, as at a pin, and the base itself do not move against the base.
        moves = sensor.node != BASE and sensor.node in names
        found.append(
            SensorReadout(
                coordinate=names.index(sensor.node) if moves else None,
                order=QUANTITIES.index(sensor.quantity),
                absolute=sensor.frame == "absolute",
                factor=1 / factor,
                support=moved.index(sensor.node) if sensor.node in moved else None,
            )
        )
    return tuple(found)


def apply_sensor_effects(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    values: Mapping[Name, float],
    outputs: Float[np.ndarray, "time sensor"],
    times: Series,
    slopes: Float[np.ndarray, "time sensor slope"],
    columns: Mapping[Name, int],
) -> None:
    """Apply the sensor effects to the outputs and to their slopes, in place.

    Slopes are empty where none are asked for; `columns` gives that of each free parameter.
    """
    for i, effect in enumerate(effects):
        action = kinds[i].action
        if not isinstance(action, SensorChange):
            continue
        k = [sensor.channel for sensor in description.sensors].index(effect.place.id)
        p = np.array([values["effect", i, name] for name in kinds[i].names])
        series = outputs[:, k].copy()
        outputs[:, k] = action.act(series, times, p)
        if slopes.size:
            slopes[:, k] = _directional_derivatives(action, series, slopes[:, k].T, times, p).T
        for which, name in enumerate(kinds[i].names):
            if ("effect", i, name) in columns:
                slopes[:, k, columns["effect", i, name]] += _by_parameter(
                    action.act, series, times, p, which
                )


def add_record_offsets(
    description: Description,
    effects: Sequence[Effect],
    kinds: Sequence[Kind],
    values: Mapping[Name, float],
    coordinates: int,
    states: Float[np.ndarray, "time state"],
    outputs: Float[np.ndarray, "time sensor"],
    slopes: Float[np.ndarray, "time sensor slope"],
    first: int,
) -> None:
    """Add to the outputs the offsets of sensors in this record, in place.

    Effects of action `RecordOffset` on sensors are read, from the internal states behind
    displacements and velocities. The first number of the state has the column `first` of the
    slopes.
    """
    channels = [sensor.channel for sensor in description.sensors]
    at = 2 * coordinates
    for i, (effect, kind) in enumerate(zip(effects, kinds, strict=True)):
        inner = len(kind.action.rates) if isinstance(kind.action, Law) else 0
        if kind.is_by_record and effect.place.kind == "sensor":
            k = channels.index(effect.place.id)
            outputs[:, k] += values["effect", i, kind.names[0]] + states[:, at]
            if slopes.size:
                slopes[:, k, first + at] += 1.0
        at += inner


def _directional_derivatives(
    action: SensorChange, series: Series, directions: Several, times: Series, p: Values
) -> Several:
    """Differentiate what a sensor does along directions, one a row."""
    if action.affine:
        still = action.act(0 * series, times, p)
        return np.asarray(action.act(directions, times, p) - still)
    size = np.abs(directions).max(axis=1, keepdims=True)
    step = NUDGE * max(float(np.abs(series).max()), 1e-30) / np.where(size > 0, size, 1.0)
    above = action.act(series + step * directions, times, p)
    below = action.act(series - step * directions, times, p)
    return np.asarray((above - below) / (2 * step))


def _by_parameter(act: Act, series: Series, times: Series, p: Values, which: int) -> Series:
    step = np.zeros(len(p))
    step[which] = NUDGE * abs(p[which]) or NUDGE * float(np.median(np.diff(times)))
    above, below = act(series, times, p + step), act(series, times, p - step)
    return np.asarray((above - below) / (2 * step[which]))
