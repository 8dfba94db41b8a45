"""The laws that are tried: their names, which shapes they have, and over which range."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from . import shapes
from .history import Filled, Scaled, Series

Shape = tuple[float, ...]
Draw = Callable[[Series, Filled | None, Shape], shapes.Columns]

_DAYS = {
    "s": 1 / 86400.0,
    "min": 1 / 1440.0,
    "h": 1 / 24.0,
    "day": 1.0,
    "d": 1.0,
    "year": 365.25,
}
CALENDAR = {"daily": 1.0, "weekly": 7.0, "yearly": 365.25}
_LEAST_CYCLES = 1.5
_TEETH = 40.0
_SIDE = 0.04  # share of the readings that must lie on either side of a kink
_EDGE = 0.03  # share of the history at either end where no step is sought


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """One shape parameter: its range, where to look first, and what is too fine to matter."""

    name: str
    low: float
    high: float
    grid: Float[np.ndarray, " grid"]
    finest: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A law, for one covariate or for time alone.

    Parameters
    ----------
    name
        What it is called; several kinds may share one, as with and without lag.
    family
        Confusing two of one family costs less.
    variant
        Which of those that share the name.
    covariate
        Index of the covariate, or None.
    axes
        Shape parameters.
    draw
        Columns from times, covariate and shape.
    width
        Number of columns; 0 for a law of the noise, which `loudness` gives.
    loudness
        Factor of the variance of readings.
    jagged
        Whether the evidence has so many narrow peaks over the shapes that the neighbourhood
        of the best on the grid needs grids of its own.
    grain
        What is too fine to matter of each shape parameter, where that is not always the same.
    allowed
        Whether readings can tell of a shape at all; None where they always can.
    """

    name: str
    family: str
    variant: str
    covariate: int | None
    axes: tuple[Axis, ...]
    draw: Draw
    width: int = 1
    loudness: Callable[[Series, Shape], Series] | None = None
    jagged: bool = False
    grain: Callable[[Shape], tuple[float, ...]] | None = None
    allowed: Callable[[Series, Filled | None, Shape], bool] | None = None

    @property
    def grid(self) -> list[Shape]:
        """Every shape to look at first."""
        return list(itertools.product(*(axis.grid.tolist() for axis in self.axes)))

    @no_type_check
    def columns(self, time: Series, covariates: tuple[Filled, ...], shape: Shape) -> np.ndarray:
        """Columns at epochs."""
        return self.draw(
            time, None if self.covariate is None else covariates[self.covariate], shape
        )

    @no_type_check
    def allows(self, time: Series, covariates: tuple[Filled, ...], shape: Shape) -> bool:
        """Whether readings at these epochs can tell of a shape at all."""
        if self.allowed is None:
            return True
        return self.allowed(
            time, None if self.covariate is None else covariates[self.covariate], shape
        )

    @no_type_check
    def factor(self, time: Series, shape: Shape) -> Series | float:
        """Factor of the variance of readings."""
        return 1.0 if self.loudness is None else self.loudness(time, shape)


def days(time_unit: str) -> float | None:
    """Days in one unit of slow time; None where the unit is no time, as for cycles."""
    return _DAYS.get(time_unit)


def kinds(past: Scaled, time_unit: str) -> tuple[Kind, ...]:
    """All laws for a history."""
    found = list(_of_time(past, time_unit))
    for index, covariate in enumerate(past.covariates):
        if covariate.role == "vibration":
            found += _of_vibration(past, index, covariate)
        else:
            found += _of_covariate(past, index, covariate)
        found.append(_breathing(past, index))
    return tuple(found)


def _of_time(past: Scaled, time_unit: str) -> tuple[Kind, ...]:
    onset = Axis("onset", 0.05, 0.9, np.linspace(0.1, 0.85, 12), past.gap)
    rates = np.concatenate([-np.geomspace(0.7, 14.0, 6)[::-1], np.geomspace(0.7, 14.0, 6)])
    rate = Axis("rate", -20.0, 20.0, rates)
    exponent = Axis(
        "exponent", np.log(0.2), np.log(6.0), np.log([0.25, 0.4, 0.6, 1.5, 2.0, 3.0, 5.0])
    )
    return (
        Kind("step", "step", "", None, (_moment(past),), lambda t, c, p: shapes.step(t, p[0])),
        Kind("drift_linear", "drift", "", None, (), lambda t, c, p: shapes.ramp(t, 0.0)),
        Kind(
            "drift_linear", "drift", "onset", None, (onset,),
            lambda t, c, p: shapes.ramp(t, p[0]),
        ),
        Kind(
            "drift_exponential", "drift", "", None, (rate,),
            lambda t, c, p: shapes.exponential(t, p[0] if abs(p[0]) > 1e-3 else 1e-3),
        ),
        Kind(
            "drift_power", "drift", "", None, (exponent,),
            lambda t, c, p: shapes.power_law(t, float(np.exp(p[0]))),
        ),
        _noise(past),
        _sawtooth(past),
        *_periodic(past, time_unit),
    )  # fmt: skip


def _moment(past: Scaled) -> Axis:
    """Instants between epochs, where something may have happened."""
    between = 0.5 * (past.time[1:] + past.time[:-1])[np.diff(past.time) > 0.0]
    inner = between[(between > _EDGE) & (between < 1.0 - _EDGE)]
    every = max(1, len(inner) // 300)
    return Axis("time", _EDGE, 1.0 - _EDGE, inner[::every], 0.5 * past.gap)


def _noise(past: Scaled) -> Kind:
    """Let the scatter of readings change without their stated standard deviation saying so."""
    moments = _moment(past)
    inner = moments.grid[(moments.grid > 0.08) & (moments.grid < 0.92)]
    time = dataclasses.replace(
        moments, low=0.08, high=0.92, grid=inner[:: max(1, len(inner) // 30)]
    )
    ratio = Axis("log ratio", -2.0, 2.0, np.array([-1.2, -0.6, 0.6, 1.2]))

    @no_type_check
    def loudness(time: Series, shape: Shape) -> Series:
        return np.where(time >= shape[0], np.exp(2.0 * shape[1]), 1.0)

    return Kind("sensor_noise", "sensor", "", None, (time, ratio), _no_column, 0, loudness)


@no_type_check
def _no_column(time: Series, covariate: Filled | None, shape: Shape) -> shapes.Columns:
    return np.empty((len(time), 0))


def _sawtooth(past: Scaled) -> Kind:
    most = min(_TEETH, len(past.time) / 8.0)
    cycles = np.arange(1.2, max(most, 1.3), 0.2)
    return Kind(
        "sawtooth", "sawtooth", "", None,
        (
            Axis("cycles", 1.2, max(most, 1.4), cycles),
            Axis("phase", 0.0, 1.0, np.arange(0.05, 1.0, 0.1)),
        ),
        lambda t, c, p: shapes.sawtooth(t, p[0], p[1]),
        jagged=True,
        # Teeth at the ends, or all of them, may move by a step from epoch to epoch.
        grain=lambda p: (past.gap * p[0], 0.5 * past.gap * p[0]),
    )  # fmt: skip


def _periodic(past: Scaled, time_unit: str) -> list[Kind]:
    most = min(0.5 / past.gap, 0.5 * len(past.time))
    cycles = np.arange(_LEAST_CYCLES, max(most, _LEAST_CYCLES + 0.5), 0.35)
    axis = Axis("log cycles", np.log(_LEAST_CYCLES), np.log(cycles[-1] + 0.5), np.log(cycles))
    found = [_wave("", axis)]
    day = days(time_unit)
    for name, period in CALENDAR.items() if day is not None else ():
        turns = past.span * (day or 1.0) / period
        if 0.8 <= turns <= 3.0 * most:
            at = np.log(turns)
            found.append(_wave(name, Axis("log cycles", at - 1e-4, at + 1e-4, np.array([at]))))
    return found


def _wave(variant: str, axis: Axis) -> Kind:
    return Kind(
        "periodic", "periodic", variant, None, (axis,),
        lambda t, c, p: shapes.wave(t, float(np.exp(p[0]))), 2,
    )  # fmt: skip


def _of_covariate(past: Scaled, index: int, covariate: Filled) -> list[Kind]:
    role = covariate.role if covariate.role != "other" else "covariate"
    low, high = np.quantile(covariate.values, [0.05, 0.95])
    kink = Axis("kink", low, high, np.linspace(low, high, 13))
    lag = Axis("log lag", np.log(0.5 * past.gap), np.log(0.3), _lags(past))
    freezing = -covariate.centre / covariate.scale
    laws: list[Kind] = []

    def add(name: str, variant: str, axes: tuple[Axis, ...], draw: Draw, width: int) -> None:
        laws.append(
            Kind(
                f"{role}_{name}", role, variant, index, axes, draw, width,
                allowed=_on_both_sides(draw) if width == 2 else None,
            )
        )  # fmt: skip

    add("linear", "", (), lambda t, c, p: shapes.straight(_values(c)), 1)
    add("linear", "lag", (lag,), lambda t, c, p: shapes.straight(_lag(t, c, p[0])), 1)
    add("linear", "delay", (lag,), lambda t, c, p: shapes.straight(_delay(t, c, p[0])), 1)
    add("bilinear", "", (kink,), lambda t, c, p: shapes.bent(_values(c), p[0]), 2)
    add("bilinear", "lag", (kink, lag), lambda t, c, p: shapes.bent(_lag(t, c, p[1]), p[0]), 2)
    if covariate.role == "temperature" and low < freezing < high:
        add("bilinear", "freezing", (), lambda t, c, p: shapes.bent(_values(c), freezing), 2)
        add(
            "bilinear", "freezing lag", (lag,),
            lambda t, c, p: shapes.bent(_lag(t, c, p[0]), freezing), 2,
        )  # fmt: skip
    add("curved", "", (), lambda t, c, p: shapes.curved(_values(c)), 6)
    return laws


def _on_both_sides(draw: Draw) -> Callable[[Series, Filled | None, Shape], bool]:
    """Ask for readings below a kink and above it: a lag may carry all of them to one side."""

    @no_type_check
    def allowed(time: Series, covariate: Filled | None, shape: Shape) -> bool:
        seen = np.mean(draw(time, covariate, shape) != 0.0, axis=0)
        return bool(seen.min() >= _SIDE)

    asked: Callable[[Series, Filled | None, Shape], bool] = allowed
    return asked


def _of_vibration(past: Scaled, index: int, covariate: Filled) -> list[Kind]:
    exponent = Axis("exponent", np.log(0.3), np.log(4.0), np.log([0.35, 0.5, 1.5, 3.0]))

    @no_type_check
    def level(c: Filled | None) -> Series:
        # In units of the mean level, so that powers of it stay of order one.
        filled = _given(c)
        unit = covariate.centre or covariate.scale
        return (filled.centre + filled.scale * filled.values) / unit

    def fixed(exponent: float) -> Draw:
        return lambda t, c, p: shapes.power(level(c), exponent)

    free: Draw = lambda t, c, p: shapes.power(level(c), float(np.exp(p[0])))  # noqa: E731
    named = "amplitude_dependence"
    return [
        Kind(named, "amplitude", "quadratic", index, (), fixed(2.0)),
        Kind(named, "amplitude", "linear", index, (), fixed(1.0)),
        Kind(named, "amplitude", "power", index, (exponent,), free),
        Kind(
            "amplitude_curved", "amplitude", "", index, (),
            lambda t, c, p: shapes.curved(_values(c)), 6,
        ),
    ]  # fmt: skip


def _breathing(past: Scaled, index: int) -> Kind:
    return Kind(
        "breathing_crack", "crack", "", index, (_moment(past),),
        lambda t, c, p: shapes.breathing(t, _values(c), p[0]), 2,
    )  # fmt: skip


def _lags(past: Scaled) -> Float[np.ndarray, " grid"]:
    return np.log(np.geomspace(0.7 * past.gap, 0.25, 8))


@no_type_check
def _given(covariate: Filled | None) -> Filled:
    assert covariate is not None, "a law of a covariate is drawn with it"
    return covariate


@no_type_check
def _values(covariate: Filled | None) -> Series:
    return _given(covariate).values


@no_type_check
def _lag(time: Series, covariate: Filled | None, log_lag: float) -> Series:
    return shapes.lagged(time, _values(covariate), float(np.exp(log_lag)))


@no_type_check
def _delay(time: Series, covariate: Filled | None, log_delay: float) -> Series:
    return shapes.delayed(time, _values(covariate), float(np.exp(log_delay)))
