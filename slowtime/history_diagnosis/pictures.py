"""Curves and series that a report's plots are drawn from."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import stats

from .history import Filled, Series
from .law import Readings, Term, design, solve
from .model import Member, SlowModel, fitted
from .report import Curve, Gap, Picture

_GRID = 121
_LAGS = 12


def picture(nominal: SlowModel, augmented: SlowModel) -> Picture:
    """Put what was read beside what either model expected."""
    past, history = augmented.readings.past, augmented.past
    before, before_sd = fitted(nominal)
    after, after_sd = fitted(augmented)
    value = past.centre + past.scale * past.value
    return Picture(
        history.time,
        history.value,
        history.sd,
        augmented.readings.mask,
        value - past.scale * before,
        past.scale * before_sd,
        value - past.scale * after,
        past.scale * after_sd,
        past.scale * _parts(augmented.readings, augmented.members[0]),
        before / before_sd,
        after / after_sd,
    )


def gap(nominal: SlowModel, augmented: SlowModel) -> Gap:
    """Measure what adopting is worth."""
    past, mask = augmented.readings.past, augmented.readings.mask
    whole = float(np.std(past.value[mask]))
    best = augmented.members[0]
    found, _ = solve(augmented.readings, best.terms, best.wander)
    left = past.value - _parts(augmented.readings, best).sum(axis=0)
    steps = []
    for model in (nominal, augmented):
        residual = fitted(model)[0]
        steps.append(float(np.sqrt(np.mean(residual[mask] ** 2))) / whole)
    noise = float(np.sqrt(found.noise_variance * np.mean(augmented.readings.variance[mask])))
    return Gap(1.0, float(np.std(left[mask])) / whole, steps[0], steps[1], noise / whole)


def whiteness(model: SlowModel) -> float:
    """P-value of the memory that residuals still have (Ljung and Box, 1978)."""
    residual, sd = fitted(model)
    residual = (residual / sd)[model.readings.mask]
    count = len(residual)
    lags = min(_LAGS, count // 5)
    power = float(residual @ residual)
    rho = np.array([residual[k:] @ residual[:-k] / power for k in range(1, lags + 1)])
    statistic = count * (count + 2.0) * float(np.sum(rho**2 / (count - np.arange(1, lags + 1))))
    return float(stats.chi2.sf(statistic, lags))


def curve(model: SlowModel, place: int) -> Curve | None:
    """Draw one effect, and the readings with all others taken away."""
    readings, best = model.readings, model.members[0]
    past, term = readings.past, best.terms[place]
    if not term.kind.width:
        return None
    followed = None if term.kind.covariate is None else past.covariates[term.kind.covariate]
    x, columns = _along(term, past.time, followed)
    found, _ = solve(readings, best.terms, best.wander)
    first = 1 + sum(t.kind.width for t in best.terms[:place])
    own = slice(first, first + term.kind.width)
    own_past = design(best.terms, past.time, past.covariates)[:, own]
    level = own_past[readings.mask].mean(axis=0)
    value = (columns - level) @ found.mean[own]
    sd = np.sqrt(
        np.einsum("gi,ij,gj->g", columns - level, found.covariance[own, own], columns - level)
    )
    parts = _parts(readings, best)
    points = past.value - found.mean[0] - (parts.sum(axis=0) - parts[place])
    points = points - points[readings.mask].mean()
    at = past.time if followed is None else followed.values
    start, size = (
        (past.start, past.span) if followed is None else (followed.centre, followed.scale)
    )
    return Curve(
        start + size * x,
        "slow time" if followed is None else followed.name,
        "" if followed is None else followed.unit,
        past.scale * value,
        past.scale * (value - 1.96 * sd),
        past.scale * (value + 1.96 * sd),
        (start + size * at)[readings.mask],
        past.scale * points[readings.mask],
    )


def _along(
    term: Term, time: Series, followed: Filled | None
) -> tuple[Float[np.ndarray, " grid"], Float[np.ndarray, "grid column"]]:
    """Columns along the axis of what is followed: in steady state, where it lags."""
    if followed is None:
        x = np.linspace(time[0], time[-1], 4 * _GRID)
        return x, term.columns(x, ())
    x = np.linspace(followed.values.min(), followed.values.max(), _GRID)
    still = dataclasses.replace(followed, values=x, sd=np.zeros(len(x)))
    blank = [still] * ((term.kind.covariate or 0) + 1)
    if any("lag" in axis.name for axis in term.kind.axes):
        rows = []
        for value in x:
            held = dataclasses.replace(followed, values=np.full(2, value), sd=np.zeros(2))
            rows.append(term.columns(np.array([0.0, 1.0]), (held,) * len(blank))[-1])
        return x, np.array(rows)
    late = np.ones(_GRID)
    return x, term.columns(late, tuple(blank))


def _parts(readings: Readings, member: Member) -> Float[np.ndarray, "effect time"]:
    """Draw what each term does at each epoch, zero on average."""
    past = readings.past
    found, _ = solve(readings, member.terms, member.wander)
    parts, first = [], 1
    for term in member.terms:
        columns = term.columns(past.time, past.covariates)
        part = columns @ found.mean[first : first + term.kind.width]
        parts.append(part - part[readings.mask].mean())
        first += term.kind.width
    return np.array(parts).reshape(len(parts), len(past.time))
