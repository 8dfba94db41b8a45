"""Prediction errors, curves of effects, and series for the plots of a report."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc

from slowtime.history_diagnosis.data.history import FilledCovariate, Series
from slowtime.history_diagnosis.forecasting.mixture import MixtureModel
from slowtime.history_diagnosis.laws.terms import Term, design, solve, stated_variance
from slowtime.history_diagnosis.likelihood.whitening import one_step_errors

from .parameters import columns_of
from .report import EffectCurve, PlotSeries, ScatterGap

_GRID_POINTS = 121
"""[points] Of a curve over a covariate; four times as many over time. Source: the resolution of
a plot."""
_LAGS = 12
"""[readings] Longest lag of the test of whiteness. Source: docs/what_decides.md: half and
double change no answer."""


def plot_series(nominal: MixtureModel, augmented: MixtureModel) -> PlotSeries:
    """Return the readings, and what each model predicted of them."""
    past = augmented.readings.past
    value = past.centre + past.scale * past.value
    predicted = (value - past.scale * _prediction_errors(m)[0] for m in (nominal, augmented))
    return PlotSeries(augmented.past.time, augmented.past.value, *predicted)


def scatter_gap(nominal: MixtureModel, augmented: MixtureModel) -> ScatterGap:
    """Return the scatter that remains before and after adoption."""
    readings, best = augmented.readings, augmented.members[0]
    past, mask = readings.past, readings.mask
    whole = float(np.std(past.value[mask]))
    found, _ = solve(readings, best.terms, best.process)
    rest = past.value - _effects(augmented).sum(axis=0)
    steps = [
        float(np.sqrt(np.mean(_prediction_errors(model)[0][mask] ** 2))) / whole
        for model in (nominal, augmented)
    ]
    noise = float(np.sqrt(found.noise_variance * np.mean(readings.variance[mask])))
    return ScatterGap(1.0, float(np.std(rest[mask])) / whole, steps[0], steps[1], noise / whole)


def ljung_box_p_value(model: MixtureModel) -> float:
    """Return the p-value of the autocorrelation of the prediction errors [1].

    Source: G. M. Ljung and G. E. P. Box, Biometrika 65 (1978), 297-303.
    """
    residual, sd = _prediction_errors(model)
    residual = (residual / sd)[model.readings.mask]
    count = len(residual)
    lags = min(_LAGS, count // 5)
    power = float(residual @ residual)
    rho = np.array([residual[k:] @ residual[:-k] / power for k in range(1, lags + 1)])
    statistic = count * (count + 2.0) * float(np.sum(rho**2 / (count - np.arange(1, lags + 1))))
    return float(chdtrc(lags, statistic))


def effect_curve(model: MixtureModel, place: int) -> EffectCurve | None:
    """Return one effect as a function of what it follows, and the readings without all others.

    A term of the noise has no curve.
    """
    readings, best = model.readings, model.members[0]
    past, term = readings.past, best.terms[place]
    if not term.law.width:
        return None
    followed = None if term.law.covariate is None else past.covariates[term.law.covariate]
    x, columns = _regressors_along(term, past.time, followed)
    found, _ = solve(readings, best.terms, best.process)
    own = columns_of(best.terms, place)
    away = columns - term.columns(past.time, past.covariates)[readings.mask].mean(axis=0)
    value = away @ found.mean[own]
    sd = np.sqrt(np.einsum("gi,ij,gj->g", away, found.covariance[own, own], away))
    effects = _effects(model)
    points = past.value - found.mean[0] - (effects.sum(axis=0) - effects[place])
    points = points - points[readings.mask].mean()
    if followed is None:
        label, unit, at, start, size = "slow time", "", past.time, past.start, past.span
    else:
        label, unit, at = followed.name, followed.unit, followed.values
        start, size = followed.centre, followed.scale
    return EffectCurve(
        start + size * x,
        label,
        unit,
        past.scale * value,
        past.scale * (value - 1.96 * sd),
        past.scale * (value + 1.96 * sd),
        (start + size * at)[readings.mask],
        past.scale * points[readings.mask],
    )


def _prediction_errors(
    model: MixtureModel,
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Errors of predicting each reading from those before it, and their expected sd [scale]."""
    readings, best = model.readings, model.members[0]
    past = readings.past
    # By the best member, with coefficients that know all readings; outliers are predicted too,
    # but not learnt from.
    found, _ = solve(readings, best.terms, best.process)
    residual = past.value - design(best.terms, past.time, past.covariates) @ found.mean
    stated = stated_variance(readings, best.terms)
    errors, variance = one_step_errors(
        best.process, past.time, stated, readings.mask, residual[:, None]
    )
    return errors[:, 0], np.sqrt(found.noise_variance * variance)


def _regressors_along(
    term: Term, time: Series, followed: FilledCovariate | None
) -> tuple[Float[np.ndarray, " grid"], Float[np.ndarray, "grid column"]]:
    """Regressors along the axis of a term: in steady state, where it lags."""
    if followed is None:
        x = np.linspace(time[0], time[-1], 4 * _GRID_POINTS)
        return x, term.columns(x, ())
    x = np.linspace(followed.values.min(), followed.values.max(), _GRID_POINTS)
    count = (term.law.covariate or 0) + 1

    def columns(at: Series, values: Series) -> np.ndarray:
        held = dataclasses.replace(followed, values=values, sd=np.zeros(len(values)))
        return term.columns(at, (held,) * count)

    if any("lag" in axis.name for axis in term.law.axes):
        steady = [columns(np.array([0.0, 1.0]), np.full(2, value))[-1] for value in x]
        return x, np.array(steady)
    return x, columns(np.ones(_GRID_POINTS), x)


def _effects(model: MixtureModel) -> Float[np.ndarray, "effect time"]:
    """Each term of the best member at each epoch, zero on average [scale]."""
    readings, best = model.readings, model.members[0]
    past = readings.past
    found, _ = solve(readings, best.terms, best.process)
    parts = []
    for place, term in enumerate(best.terms):
        own = columns_of(best.terms, place)
        part = term.columns(past.time, past.covariates) @ found.mean[own]
        parts.append(part - part[readings.mask].mean())
    return np.array(parts).reshape(len(parts), len(past.time))
