"""Coefficients and shapes of a law in numbers people use, with units and their doubt."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification.estimates import Measured

from .history import Scaled
from .law import Readings, Term, solve
from .model import Member

Numbers = dict[str, tuple[float, float, str]]
"""Value, variance and unit of each parameter."""


@dataclasses.dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect.

    Parameters
    ----------
    name
        What it is.
    measured
        Value and standard deviation.
    unit
        Of both.
    """

    name: str
    measured: Measured
    unit: str


@dataclasses.dataclass(frozen=True, slots=True)
class Units:
    """How values and slow times are told.

    Parameters
    ----------
    value
        Unit of the values for people.
    factor
        From the unit of the values to that one: 100 for ratios in per cent.
    time
        Unit of slow time.
    """

    value: str
    factor: float
    time: str


def parameters(
    readings: Readings, members: tuple[Member, ...], place: int, units: Units
) -> tuple[Parameter, ...]:
    """Numbers of the term at a place, over all members: their spread is part of the sd."""
    told = []
    for member in members:
        found, _ = solve(readings, member.terms, member.wander)
        first = 1 + sum(term.kind.width for term in member.terms[:place])
        own = slice(first, first + member.terms[place].kind.width)
        told.append(
            _numbers(
                member.terms[place], found.mean[own], found.covariance[own, own],
                readings.past, units,
            )
        )  # fmt: skip
    weights = np.array([member.weight for member in members])
    best = []
    for name, (_, _, unit) in told[0].items():
        values = np.array([one[name][0] for one in told])
        variances = np.array([one[name][1] for one in told])
        mean = float(weights @ values)
        sd = float(np.sqrt(weights @ (variances + (values - mean) ** 2)))
        # What is given, as a kink at freezing, differs by rounding only.
        sd = sd if sd > 1e-9 * abs(mean) else 0.0
        best.append(Parameter(name, Measured(mean, sd), unit))
    return tuple(best)


def _numbers(
    term: Term,
    mean: Float[np.ndarray, " column"],
    covariance: Float[np.ndarray, "column column"],
    past: Scaled,
    units: Units,
) -> Numbers:
    kind, shape = term.kind, term.shape
    size = units.factor * past.scale
    first = (size * mean[0], size**2 * covariance[0, 0]) if len(mean) else (0.0, 0.0)
    whole = {"change": (*first, units.value)}
    if kind.name == "step":
        return whole | {"time": _instant(past, shape[0], units)}
    if kind.name == "breathing_crack":
        return (
            whole
            | {"time": _instant(past, shape[0], units)}
            | _slopes(
                ("opening_slope",), mean[1:], covariance[1:, 1:], past, kind.covariate, units
            )
        )
    if kind.family == "drift":
        return _drift(term, first, past, units)
    if kind.variant == "irregular":
        lengths = past.span * np.diff(np.sort(shape))
        period = float(np.mean(lengths))
        return {
            "height": (
                first[0] * period / past.span,
                first[1] * (period / past.span) ** 2,
                units.value,
            ),
            "rate": (
                first[0] / past.span,
                first[1] / past.span**2,
                f"{units.value}/{units.time}",
            ),
            "period": (period, float(np.var(lengths)), units.time),
            "last_reset_time": _instant(past, max(shape), units),
        }
    if kind.name == "sawtooth":
        reset = past.start + past.span * (0.5 + (1.0 - shape[1]) / shape[0])
        return {
            "height": (*first, units.value),
            "period": (past.span / shape[0], 0.0, units.time),
            "reset_time": (reset, 0.0, units.time),
        }
    if kind.name == "periodic":
        return _periodic(shape, mean, covariance, past, units)
    if kind.name == "sensor_noise":
        return {
            "factor": (float(np.exp(shape[1])), 0.0, "1"),
            "time": _instant(past, shape[0], units),
        }
    if kind.name == "amplitude_dependence":
        exponent = {"quadratic": 2.0, "linear": 1.0}.get(kind.variant)
        exponent = float(np.exp(shape[0])) if exponent is None else exponent
        return {
            "change_at_mean_level": (*first, units.value),
            "exponent": (exponent, 0.0, "1"),
        }
    if kind.name.endswith("curved"):
        return {}
    return _covariate(term, mean, covariance, past, units)


def _covariate(
    term: Term,
    mean: Float[np.ndarray, " column"],
    covariance: Float[np.ndarray, "column column"],
    past: Scaled,
    units: Units,
) -> Numbers:
    kind = term.kind
    assert kind.covariate is not None
    names = ("slope",) if kind.width == 1 else ("slope_below", "slope_above")
    found = _slopes(names, mean, covariance, past, kind.covariate, units)
    series = past.covariates[kind.covariate]
    named = dict(zip((axis.name for axis in kind.axes), term.shape, strict=True))
    if kind.width == 2:
        kink = series.centre + series.scale * named["kink"] if "kink" in named else 0.0
        found["kink"] = (kink, 0.0, series.unit)
    if "log lag" in named:
        word = "delay" if "delay" in kind.variant else "lag"
        found[word] = (float(np.exp(named["log lag"])) * past.span, 0.0, units.time)
    return found


def _slopes(
    names: tuple[str, ...],
    mean: Float[np.ndarray, " column"],
    covariance: Float[np.ndarray, "column column"],
    past: Scaled,
    covariate: int | None,
    units: Units,
) -> Numbers:
    assert covariate is not None
    series = past.covariates[covariate]
    size = units.factor * past.scale / series.scale
    per = units.value + ("" if not series.unit else "/" + series.unit.replace("°C", "K"))
    return {
        name: (size * mean[i], size**2 * covariance[i, i], per) for i, name in enumerate(names)
    }


def _drift(term: Term, first: tuple[float, float], past: Scaled, units: Units) -> Numbers:
    kind, shape = term.kind, term.shape
    if kind.name == "drift_linear":
        rate = (first[0] / past.span, first[1] / past.span**2, f"{units.value}/{units.time}")
        onset = {"onset": _instant(past, shape[0], units)} if shape else {}
        return {"rate": rate} | onset
    found: Numbers = {"change": (*first, units.value)}
    if kind.name == "drift_exponential":
        found["time_constant"] = (past.span / shape[0], 0.0, units.time)
    else:
        found["exponent"] = (float(np.exp(shape[0])), 0.0, "1")
    return found


def _periodic(
    shape: tuple[float, ...],
    mean: Float[np.ndarray, " column"],
    covariance: Float[np.ndarray, "column column"],
    past: Scaled,
    units: Units,
) -> Numbers:
    size = units.factor * past.scale
    amplitude = float(np.hypot(*mean))
    along, across = mean / amplitude, np.array([-mean[1], mean[0]]) / amplitude
    period = past.span / float(np.exp(shape[0]))
    turn = period / (2.0 * np.pi)
    peak = past.start + 0.5 * past.span + turn * float(np.arctan2(mean[1], mean[0]))
    return {
        "amplitude": (
            size * amplitude, size**2 * float(along @ covariance @ along), units.value,
        ),
        "period": (period, 0.0, units.time),
        "time_of_maximum": (
            peak, (turn / amplitude) ** 2 * float(across @ covariance @ across), units.time,
        ),
    }  # fmt: skip


def _instant(past: Scaled, at: float, units: Units) -> tuple[float, float, str]:
    # Anywhere between two epochs: as wide as a step from one to the next.
    return past.start + past.span * at, (past.span * past.gap) ** 2 / 12.0, units.time
