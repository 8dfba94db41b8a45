"""Faulty sensors: bias, drift, gain, clipping, dropout and timing errors.

Several functions share these parameters:

- `series`: true series, the last axis is time.
- `times`: campaign times [s]; not used.
"""

import math

import numpy as np

from slowtime.dynamics.effects.kind import (
    Kind,
    Parameter,
    SensorChange,
    Series,
    Several,
    Values,
)
from slowtime.signals.interpolation import at_instants

from .inputs import delayed


def biased(series: Several, times: Series, p: Values) -> Several:
    """Series with a constant added.

    `p`: the constant [unit of the series].
    """
    return np.asarray(series + p[0])


def unchanged(series: Several, times: Series, p: Values) -> Several:
    """Series of a sensor whose model already says where it sits."""
    return series


def drifting(series: Several, times: Series, p: Values) -> Several:
    """Series with a drift added, linear in campaign time.

    `p`: drift in the end [unit of the series]; campaign time at which it is reached [s].
    """
    return np.asarray(series + p[0] * times / p[1])


def gained(series: Several, times: Series, p: Values) -> Several:
    """Series times a factor."""
    return np.asarray(p[0] * series)


def clipped(series: Several, times: Series, p: Values) -> Several:
    """Series clipped at the range of the sensor.

    `p`: largest value that the sensor outputs [unit of the series].
    """
    return np.asarray(np.clip(series, -p[0], p[0]))


def dropped(series: Several, times: Series, p: Values) -> Several:
    """Series that stays at zero, or at its last value, for a while.

    `p`: campaign time at which it begins [s]; its duration [s]; 0 for zero, 1 for the last
    value.
    """
    told = series.copy()
    out = (times >= p[0]) & (times < p[0] + p[1])
    before = int(np.argmax(out)) - 1
    kept = p[2] and out.any() and before >= 0
    told[..., out] = series[..., before : before + 1] if kept else 0.0
    return told


def timed(series: Several, times: Series, p: Values) -> Several:
    """Series sampled by a clock that runs fast or slow from the first sample of a record on.

    `p`: relative error of the clock's rate [1].
    """
    if len(times) < 2:
        return series
    rate_hz = (len(times) - 1) / (times[-1] - times[0])
    return at_instants(series, (times - times[0]) * (1.0 + p[0]) * rate_hz)


def retimed(series: Several, times: Series, p: Values) -> Several:
    """Series as a correct clock would have sampled it.

    `p`: relative error of the clock's rate [1].
    """
    return timed(series, times, np.array([-p[0] / (1.0 + p[0])]))


def advanced(series: Several, times: Series, p: Values) -> Several:
    """Series as a sensor without the delay would have told it.

    `p`: the delay [s].
    """
    return delayed(series, times, -p)


def _kind(
    name: str,
    title: str,
    equation: str,
    sentence: str,
    action: SensorChange,
    *parameters: Parameter,
) -> Kind:
    return Kind(
        name=name,
        title=title,
        family="sensor",
        where="sensor",
        parameters=parameters,
        equation=equation,
        source="",
        sentence=sentence,
        action=action,
    )


_UNIT = "unit of the sensor"
MAX_DELAY_S = 1.0
"""Most that a channel may be late by [s]: loggers that start by hand are aligned before."""

KINDS = (
    _kind(
        "sensor_bias",
        "Constant error of a sensor",
        "reading = true + bias",
        "The sensor adds a constant.",
        SensorChange(act=biased),
        Parameter(name="bias", unit=_UNIT, meaning="constant added"),
    ),
    _kind(
        "sensor_drift",
        "Drift of a sensor",
        "reading = true + drift · t / span",
        "The error of the sensor grows steadily over the campaign.",
        SensorChange(act=drifting),
        Parameter(name="drift_total", unit=_UNIT, meaning="drift in the end"),
        Parameter(
            name="span_s",
            unit="s",
            meaning="campaign time at which it is reached; the end of the record where not "
            "given",
            low=0.0,
            nonzero=True,
            default=math.nan,
            fitted=False,
        ),
    ),
    _kind(
        "sensor_gain",
        "Sensor off by a factor",
        "reading = gain · true",
        "The readings are too large or too small by a constant factor.",
        SensorChange(act=gained),
        Parameter(name="gain", unit="", meaning="factor", nonzero=True),
    ),
    _kind(
        "sensor_saturation",
        "Clipping sensor",
        "reading = true, within ±clip",
        "Readings beyond a limit are cut off at it.",
        SensorChange(act=clipped, affine=False),
        Parameter(name="clip", unit=_UNIT, meaning="largest reading", low=0.0, nonzero=True),
    ),
    _kind(
        "sensor_dropout",
        "Silent sensor",
        "reading = 0, or the last value, for a while",
        "The sensor read zero, or its last value, for a while.",
        SensorChange(act=dropped),
        Parameter(
            name="from_s",
            unit="s",
            meaning="campaign time at which it falls silent",
            default=0.0,
            fitted=False,
        ),
        Parameter(
            name="for_s",
            unit="s",
            meaning="time for which it is silent",
            low=0.0,
            default=0.0,
            fitted=False,
        ),
        Parameter(
            name="held",
            unit="",
            meaning="what it reads meanwhile: 0, or the last value for 1",
            choices=(0.0, 1.0),
            default=0.0,
            fitted=False,
        ),
    ),
    _kind(
        "sensor_misplaced",
        "Sensor at another node",
        "reading = motion of another node",
        "The sensor reads the motion of another node than the model says.",
        SensorChange(act=unchanged),
        Parameter(
            name="node_number",
            unit="",
            meaning="number of that node in the model, from 1; in a model file, give the "
            "sensor that node",
            low=1.0,
            fitted=False,
        ),
    ),
    _kind(
        "sensor_delay",
        "Late sensor",
        "reading(t) = true(t − τ)",
        "The sensor tells everything later than the others do; earlier, where τ is negative.",
        SensorChange(act=delayed, undo=advanced),
        Parameter(
            name="delay_s",
            unit="s",
            meaning="delay behind the other channels",
            low=-MAX_DELAY_S,
            high=MAX_DELAY_S,
        ),
    ),
    _kind(
        "sensor_clock",
        "Sensor clock off",
        "reading(t) = true(t0 + (t − t0)(1 + skew))",
        "The sensor's clock runs fast or slow against the others.",
        SensorChange(act=timed, undo=retimed),
        Parameter(
            name="skew", unit="", meaning="relative error of its rate", low=-0.2, high=0.2
        ),
    ),
)
