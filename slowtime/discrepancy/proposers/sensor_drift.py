"""A sensor that is off, slowly, on no course that a law would know: drift all the same."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.diagnosis import NamedEffect, Number
from slowtime.discrepancy.localization import Localization
from slowtime.discrepancy.quoting import quoted, unit_at
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import assemble
from slowtime.dynamics.effects import Effect, Kind, Place
from slowtime.dynamics.modes import undamped_modes

from .sensor_bias import QUASI_STATIC_RATIO

T = TypeVar("T")

KIND = "sensor_drift"
MIN_SLOW_SHARE = 0.9
"""[share of the power of an error] That lies below that frequency in a drift; also that of its
mean, above which it is constant. Source: docs/what_decides.md: half and double change no
answer."""
SIZE_RELATIVE_SD = 0.1
"""[1] Relative standard deviation of the size of a drift that follows no law. Source:
docs/what_decides.md: half and double change no answer."""
MAX_RATE_SCATTER = 0.2
"""[1] Relative standard deviation of the rates of drift of all records, below which they are
one rate. Source: docs/what_decides.md: half and double change no answer."""


def sensor_drift(
    before: Fit, located: Localization, kinds: Mapping[str, Kind]
) -> NamedEffect | None:
    """Name the drift of a sensor whose error is slow, where no law of a drift explains it."""
    # A structure answers slow forces by slow motion, too; but that shows in all of its sensors,
    # and not in accelerations. So the sensor must be where one unknown error explains the most.
    first = located.groups[0]
    place = next((p for p in (*first.places, *first.twins) if p.kind == "sensor"), None)
    if place is None or KIND not in kinds or located.p_value > LIMITS.false_alarm_p_value:
        return None
    if first.places[0].kind != "sensor" and not _accelerometer(located, place):
        return None
    lowest = float(undamped_modes(assemble(located.linear.description)).frequency_hz[0])
    slow = whole = 0.0
    errors = []
    for number, trial in enumerate(located.trials):
        off = located.latent(place, number).force
        errors.append(off)
        power = np.abs(np.fft.rfft(off)) ** 2
        power[0] /= 2
        frequency = np.fft.rfftfreq(len(off), 1 / trial.rate_hz)
        slow += float(power[frequency < QUASI_STATIC_RATIO * lowest].sum()) / len(off)
        whole += float(power.sum()) / len(off)
    if not slow > MIN_SLOW_SHARE * whole:
        return None
    every = np.concatenate(errors)
    if float(every.mean()) ** 2 > MIN_SLOW_SHARE * float(np.mean(every**2)):
        return None  # the same at all times: that is no course, and a law knows it
    return drifting(before, located.trials, place, kinds)


def drifting(
    before: Fit, trials: Sequence[Trial], place: Place, kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Name the drift of a sensor, whatever its course.

    Its size is in the unit of the sensor: over the campaign, with its span [s], if it grows at
    one rate in every record; otherwise what it comes to in a record.
    """
    channels = [sensor.channel for sensor in before.plant.description.sensors]
    at = channels.index(place.id)
    told = list(zip(before.residual, trials, strict=True))
    rates = np.array([_rate(left[:, at], t.used[:, at], t.rate_hz) for left, t in told])
    kind = kinds[KIND]
    name = next(p.name for p in kind.parameters if p.fitted)
    unit = unit_at(before.plant.description, place, kind.parameter(name).unit)
    spans = np.array([trial.duration_s for trial in trials])
    steady = len(rates) > 1 and float(np.std(rates)) < MAX_RATE_SCATTER * abs(
        float(np.mean(rates))
    )
    if steady:
        spans = np.full(len(trials), max(t.start_s + t.duration_s for t in trials))
    size = float(np.mean(rates * spans))
    spread = float(np.hypot(SIZE_RELATIVE_SD * size, np.std(rates * spans)))
    numbers = {name: Number(size, spread, unit)}
    if steady:
        numbers["span_s"] = Number(float(spans[0]), 0.0, "s")
    return quoted(Effect(KIND, place, {name: size}), numbers, kind, 0.95)


def _rate(left: np.ndarray, used: np.ndarray, rate_hz: float) -> float:
    """Give the slope of a line through what is left of a channel, a second."""
    times = np.flatnonzero(used) / rate_hz
    return float(np.polyfit(times, left[used], 1)[0]) if len(times) > 1 else 0.0


def _accelerometer(located: Localization, place: Place) -> bool:
    sensors = located.linear.description.sensors
    return next(s for s in sensors if s.channel == place.id).quantity == "acceleration"


def without_sensor(fit: Fit, trials: Sequence[Trial], channel: str) -> tuple[Trial, ...]:
    """Take what one sensor says out of records."""
    heard = np.array([s.channel != channel for s in fit.plant.description.sensors])
    return tuple(dataclasses.replace(trial, use=trial.used & heard) for trial in trials)


def with_sensor_again(fit: Fit, before: Fit, channel: str) -> Fit:
    """Give a sensor that was not heard the noise that it had before."""
    own = [s.channel == channel for s in fit.plant.description.sensors]
    noise = dataclasses.replace(
        fit.noise,
        colours=_mixed(fit.noise.colours, before.noise.colours, own),
        relative_sd=_mixed(fit.noise.relative_sd, before.noise.relative_sd, own),
    )
    return dataclasses.replace(fit, noise=noise)


def _mixed(
    rows: tuple[tuple[T, ...], ...], others: tuple[tuple[T, ...], ...], own: Sequence[bool]
) -> tuple[tuple[T, ...], ...]:
    """Take some columns of one table, and the rest of another."""
    return tuple(
        tuple(b if other else a for a, b, other in zip(*pair, own, strict=True))
        for pair in zip(rows, others, strict=True)
    )
