"""Catalogue of candidate laws: their names, shape parameters, ranges and search grids."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis.data.history import FilledCovariate, ScaledHistory, Series

from . import regressors

Shape = tuple[float, ...]
"""Values of the nonlinear (shape) parameters of a law."""
RegressorFunction = Callable[[Series, FilledCovariate | None, Shape], regressors.Columns]

_DAYS = {
    "s": 1 / 86400.0,
    "min": 1 / 1440.0,
    "h": 1 / 24.0,
    "day": 1.0,
    "d": 1.0,
    "year": 365.25,
}
_CALENDAR_DAYS = (1.0, 7.0, 365.25)
"""[days] Periods of the calendar. Source: day, week and Julian year."""
_LEAST_CYCLES = 1.5
"""[cycles in a history] Fewest of a periodic law; fewer cannot be told from a drift. Source:
docs/what_decides.md: half and double change no answer."""
_MOST_TEETH = 40.0
"""[teeth in a history] Most of a sawtooth. Source: a bound on computing time."""
_LEAST_SIDE = 0.04
"""[share of the readings] That must lie on either side of a kink. Source: docs/what_decides.md:
half and double change no answer."""
_MARGIN = 0.03
"""[histories] At either end, within which no step is sought. Source: docs/what_decides.md: half
and double change no answer."""
_NOISE_MARGIN = 0.08
"""[histories] The same for a change of noise, which takes more readings. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapeAxis:
    """Range of one shape parameter.

    Differences below `finest` do not matter.
    """

    name: str
    low: float
    high: float
    grid: Float[np.ndarray, " grid"]
    finest: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class HistoryLaw:
    """A law, for one covariate or for time alone.

    Parameters
    ----------
    name
        Name in the report; several laws may share one, as with and without lag.
    covariate
        Index of the covariate; None for time alone.
    regressors
        Function of times, covariate and shape.
    width
        Number of regressors; 0 for a law of the noise.
    noise_factor
        Factor of the variance of readings, for a law of the noise.
    multimodal
        Whether the evidence has so many narrow peaks that the best grid points need finer
        grids around them.
    grain
        Differences of shape that do not matter, where they depend on the shape.
    allowed
        Whether the readings can determine a shape; None where they always can.
    """

    name: str
    family: str
    variant: str
    covariate: int | None
    axes: tuple[ShapeAxis, ...]
    regressors: RegressorFunction
    width: int = 1
    noise_factor: Callable[[Series, Shape], Series] | None = None
    multimodal: bool = False
    grain: Callable[[Shape], tuple[float, ...]] | None = None
    allowed: Callable[[Series, FilledCovariate | None, Shape], bool] | None = None

    @property
    def grid(self) -> list[Shape]:
        """Every shape of the first scan."""
        return list(itertools.product(*(axis.grid.tolist() for axis in self.axes)))

    @no_type_check
    def columns(
        self, time: Series, covariates: tuple[FilledCovariate, ...], shape: Shape
    ) -> np.ndarray:
        """Return the regressors at epochs, shape (time, width)."""
        return self.regressors(time, self._followed(covariates), shape)

    @no_type_check
    def allows(
        self, time: Series, covariates: tuple[FilledCovariate, ...], shape: Shape
    ) -> bool:
        """Tell whether readings at these epochs can determine a shape."""
        return self.allowed is None or self.allowed(time, self._followed(covariates), shape)

    @no_type_check
    def variance_factor(self, time: Series, shape: Shape) -> Series | float:
        """Return the factor of the variance of readings [1]."""
        return 1.0 if self.noise_factor is None else self.noise_factor(time, shape)

    @no_type_check
    def _followed(self, covariates: tuple[FilledCovariate, ...]) -> FilledCovariate | None:
        return None if self.covariate is None else covariates[self.covariate]


def candidate_laws(past: ScaledHistory, time_unit: str) -> tuple[HistoryLaw, ...]:
    """List all laws that can be tried on a history.

    Calendar periods are added if the unit is one of time.
    """
    found = list(_time_laws(past, time_unit))
    for index, covariate in enumerate(past.covariates):
        if covariate.role == "vibration":
            found += _vibration_laws(index, covariate)
        else:
            found += _covariate_laws(past, index, covariate)
        found.append(_crack_law(past, index))
    return tuple(found)


def _time_laws(past: ScaledHistory, time_unit: str) -> tuple[HistoryLaw, ...]:
    def law(
        name: str, variant: str, axes: tuple[ShapeAxis, ...], drawn: RegressorFunction
    ) -> HistoryLaw:
        return HistoryLaw(name, name.split("_")[0], variant, None, axes, drawn)

    onset = ShapeAxis("onset", 0.05, 0.9, np.linspace(0.1, 0.85, 12), past.gap)
    rates = np.concatenate([-np.geomspace(0.7, 14.0, 6)[::-1], np.geomspace(0.7, 14.0, 6)])
    rate = ShapeAxis("rate", -20.0, 20.0, rates)
    exponents = np.log([0.25, 0.4, 0.6, 1.5, 2.0, 3.0, 5.0])
    exponent = ShapeAxis("exponent", np.log(0.2), np.log(6.0), exponents)
    return (
        law("step", "", (_instant_axis(past),), lambda t, c, p: regressors.step(t, p[0])),
        law("drift_linear", "", (), lambda t, c, p: regressors.ramp(t, 0.0)),
        law("drift_linear", "onset", (onset,), lambda t, c, p: regressors.ramp(t, p[0])),
        law(
            "drift_exponential", "", (rate,),
            lambda t, c, p: regressors.exponential(t, p[0] if abs(p[0]) > 1e-3 else 1e-3),
        ),
        law(
            "drift_power", "", (exponent,),
            lambda t, c, p: regressors.power_law(t, float(np.exp(p[0]))),
        ),
        _noise_law(past),
        _sawtooth_law(past),
        *_periodic_laws(past, time_unit),
    )  # fmt: skip


def _instant_axis(past: ScaledHistory) -> ShapeAxis:
    """Axis of instants, on a grid of fewer than 600 midpoints between epochs."""
    between = 0.5 * (past.time[1:] + past.time[:-1])[np.diff(past.time) > 0.0]
    inner = between[(between > _MARGIN) & (between < 1.0 - _MARGIN)]
    every = max(1, len(inner) // 300)
    return ShapeAxis("time", _MARGIN, 1.0 - _MARGIN, inner[::every], 0.5 * past.gap)


def _noise_law(past: ScaledHistory) -> HistoryLaw:
    """Law of a scatter that changes while the stated standard deviation does not."""
    instants = _instant_axis(past)
    low, high = _NOISE_MARGIN, 1.0 - _NOISE_MARGIN
    inner = instants.grid[(instants.grid > low) & (instants.grid < high)]
    grid = inner[:: max(1, len(inner) // 30)]
    time = dataclasses.replace(instants, low=low, high=high, grid=grid)
    ratio = ShapeAxis("log ratio", -2.0, 2.0, np.array([-1.2, -0.6, 0.6, 1.2]))

    @no_type_check
    def noise_factor(time: Series, shape: Shape) -> Series:
        return np.where(time >= shape[0], np.exp(2.0 * shape[1]), 1.0)

    @no_type_check
    def none(time: Series, covariate: FilledCovariate | None, shape: Shape) -> np.ndarray:
        return np.empty((len(time), 0))

    return HistoryLaw("sensor_noise", "sensor", "", None, (time, ratio), none, 0, noise_factor)


def _sawtooth_law(past: ScaledHistory) -> HistoryLaw:
    most = min(_MOST_TEETH, len(past.time) / 8.0)
    cycles = np.arange(1.2, max(most, 1.3), 0.2)
    return HistoryLaw(
        "sawtooth", "sawtooth", "", None,
        (
            ShapeAxis("cycles", 1.2, max(most, 1.4), cycles),
            ShapeAxis("phase", 0.0, 1.0, np.arange(0.05, 1.0, 0.1)),
        ),
        lambda t, c, p: regressors.sawtooth(t, p[0], p[1]),
        multimodal=True,
        # Teeth at the ends, or all of them, may move by a step from epoch to epoch.
        grain=lambda p: (past.gap * p[0], 0.5 * past.gap * p[0]),
    )  # fmt: skip


def _periodic_laws(past: ScaledHistory, time_unit: str) -> list[HistoryLaw]:
    """Return a law of free period, and one for each calendar period that fits the history."""
    most = min(0.5 / past.gap, 0.5 * len(past.time))
    cycles = np.arange(_LEAST_CYCLES, max(most, _LEAST_CYCLES + 0.5), 0.35)
    axes = [
        ShapeAxis("log cycles", np.log(_LEAST_CYCLES), np.log(cycles[-1] + 0.5), np.log(cycles))
    ]
    day = _DAYS.get(time_unit)
    for period in _CALENDAR_DAYS if day is not None else ():
        turns = past.span * (day or 1.0) / period
        if 0.8 <= turns <= 3.0 * most:
            at = np.log(turns)
            axes.append(ShapeAxis("log cycles", at - 1e-4, at + 1e-4, np.array([at])))
    return [
        HistoryLaw(
            "periodic", "periodic", "calendar" if i else "", None, (axis,),
            lambda t, c, p: regressors.harmonic(t, float(np.exp(p[0]))), 2,
        )
        for i, axis in enumerate(axes)
    ]  # fmt: skip


def _covariate_laws(
    past: ScaledHistory, index: int, covariate: FilledCovariate
) -> list[HistoryLaw]:
    role = covariate.role if covariate.role != "other" else "covariate"
    low, high = np.quantile(covariate.values, [0.05, 0.95])
    kink = ShapeAxis("kink", low, high, np.linspace(low, high, 13))
    lags = np.log(np.geomspace(0.7 * past.gap, 0.25, 8))
    lag = ShapeAxis("log lag", np.log(0.5 * past.gap), np.log(0.3), lags)
    freezing = -covariate.centre / covariate.scale
    line, bend = regressors.linear, regressors.bilinear
    laws: list[HistoryLaw] = []

    def add(
        name: str, variant: str, axes: tuple[ShapeAxis, ...], drawn: RegressorFunction
    ) -> None:
        width = {"linear": 1, "bilinear": 2, "curved": 6}[name]
        allowed = _readings_on_both_sides(drawn) if name == "bilinear" else None
        laws.append(
            HistoryLaw(
                f"{role}_{name}", role, variant, index, axes, drawn, width, allowed=allowed
            )
        )

    add("linear", "", (), lambda t, c, p: line(_of(c)))
    add("linear", "lag", (lag,), lambda t, c, p: line(_lagged(t, c, p[0])))
    add("linear", "delay", (lag,), lambda t, c, p: line(_delayed(t, c, p[0])))
    add("bilinear", "", (kink,), lambda t, c, p: bend(_of(c), p[0]))
    add("bilinear", "lag", (kink, lag), lambda t, c, p: bend(_lagged(t, c, p[1]), p[0]))
    if covariate.role == "temperature" and low < freezing < high:
        add("bilinear", "freezing", (), lambda t, c, p: bend(_of(c), freezing))
        add(
            "bilinear", "freezing lag", (lag,),
            lambda t, c, p: bend(_lagged(t, c, p[0]), freezing),
        )  # fmt: skip
    add("curved", "", (), lambda t, c, p: regressors.free_curve(_of(c)))
    return laws


def _readings_on_both_sides(
    drawn: RegressorFunction,
) -> Callable[[Series, FilledCovariate | None, Shape], bool]:
    """Demand readings below and above a kink: a lag may carry all of them to one side."""

    @no_type_check
    def allowed(time: Series, covariate: FilledCovariate | None, shape: Shape) -> bool:
        seen = np.mean(drawn(time, covariate, shape) != 0.0, axis=0)
        return bool(seen.min() >= _LEAST_SIDE)

    typed: Callable[[Series, FilledCovariate | None, Shape], bool] = allowed
    return typed


def _vibration_laws(index: int, covariate: FilledCovariate) -> list[HistoryLaw]:
    # In units of the mean level, so that powers of it stay of order one.
    unit = covariate.centre or covariate.scale

    @no_type_check
    def level(c: FilledCovariate | None) -> Series:
        return (c.centre + c.scale * c.values) / unit

    def law(variant: str, axes: tuple[ShapeAxis, ...], drawn: RegressorFunction) -> HistoryLaw:
        return HistoryLaw("amplitude_dependence", "amplitude", variant, index, axes, drawn)

    exponents = np.log([0.35, 0.5, 1.5, 3.0])
    free = ShapeAxis("exponent", np.log(0.3), np.log(4.0), exponents)
    power = regressors.level_power
    return [
        law("quadratic", (), lambda t, c, p: power(level(c), 2.0)),
        law("linear", (), lambda t, c, p: power(level(c), 1.0)),
        law("power", (free,), lambda t, c, p: power(level(c), float(np.exp(p[0])))),
        HistoryLaw(
            "amplitude_curved", "amplitude", "", index, (),
            lambda t, c, p: regressors.free_curve(_of(c)), 6,
        ),
    ]  # fmt: skip


def _crack_law(past: ScaledHistory, index: int) -> HistoryLaw:
    return HistoryLaw(
        "breathing_crack", "crack", "", index, (_instant_axis(past),),
        lambda t, c, p: regressors.breathing_crack(t, _of(c), p[0]), 2,
    )  # fmt: skip


@no_type_check
def _of(covariate: FilledCovariate | None) -> Series:
    assert covariate is not None, "a law of a covariate is drawn with it"
    return covariate.values


@no_type_check
def _lagged(time: Series, covariate: FilledCovariate | None, log_lag: float) -> Series:
    return regressors.lagged(time, _of(covariate), float(np.exp(log_lag)))


@no_type_check
def _delayed(time: Series, covariate: FilledCovariate | None, log_delay: float) -> Series:
    return regressors.delayed(time, _of(covariate), float(np.exp(log_delay)))
