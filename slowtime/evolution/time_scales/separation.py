r"""Separation of a series into two slow time scales (Chapter 8).

.. math:: y(t_s) = \underbrace{a(t_s) + f(t_s)}_{\text{long}} +
          \underbrace{g(t_s)}_{\text{short}} + \varepsilon

An additive Gaussian process by default: a trend and a smooth process for the long scale, and
for the short one whichever is likelier: a rough process, a function that repeats itself, or
teeth. The mixture of experts of the book's authors stands beside it (`experts`); `choose`
compares both by what each foretells of every reading from all the others.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from slowtime.estimation import filtering
from slowtime.estimation.hyperparameters import HyperparameterPrior
from slowtime.estimation.processes import Matern, Sum, Trend, quasi_periodic
from slowtime.evolution.change import Series
from slowtime.evolution.forecasting import forecast, periodicity, wave_choice
from slowtime.evolution.forecasting.parameter_posterior import (
    ParameterPosterior,
    learn_parameters,
)

from . import mixture_of_experts

Kind: TypeAlias = Literal["rough", "repeating", "teeth"]

_HARMONICS = 8
"""Harmonics of the periodic component."""

_MEMBERS = 6
"""Processes, the most probable ones, whose bands are put together."""


@dataclasses.dataclass(frozen=True, slots=True)
class SeparatedScales:
    """A series taken apart.

    Parameters
    ----------
    slow_time
        Where it was read, ascending.
    mean, sd
        Of both scales together, without the noise of readings.
    long, long_sd, short, short_sd
        Of each by itself.
    kind
        What the short scale is.
    process
        The likeliest process: trend, long, and what is short.
    log_predictive
        Sum over the readings of the logarithm of the density at which the others foretell
        each [1].
    """

    slow_time: Series
    mean: Series
    sd: Series
    long: Series
    long_sd: Series
    short: Series
    short_sd: Series
    kind: Kind
    process: Sum
    log_predictive: float


@dataclasses.dataclass(frozen=True, slots=True)
class SeparationChoice:
    """Both models of a series, and which foretells it better.

    Parameters
    ----------
    best
        ``"additive"`` or ``"mixture"``.
    log_odds
        Logarithm of how much better the additive one foretells the readings [1].
    """

    best: Literal["additive", "mixture"]
    log_odds: float
    additive: SeparatedScales
    mixture: mixture_of_experts.ExpertMixture


def additive(slow_time: Series, value: Series, sd: Series) -> SeparatedScales:
    """Split a series into a long and a short scale by an additive process.

    Parameters
    ----------
    slow_time, value, sd
        Slow times, ascending, values, and their known standard deviations.

    Returns
    -------
    Both parts, in the unit of the readings.

    Examples
    --------
    >>> t = np.arange(60.0)
    >>> y = -0.01 * t + 0.2 * np.sin(2.0 * t)
    >>> parts = additive(t, y, np.full(60, 0.05))
    >>> bool(np.abs(parts.long + 0.01 * t).max() < 0.1)
    True
    """
    _check(slow_time, value, sd)
    found: dict[Kind, tuple[ParameterPosterior, HyperparameterPrior]] = {}
    rough, waving = _rough_prior(slow_time, value), _repeating_prior(slow_time, value, sd)
    makers: dict[Kind, Callable[[Series, Series, np.ndarray], Sum]] = {
        "rough": _rough,
        "repeating": _repeating,
    }

    def likelihood(kind: Kind, points: np.ndarray) -> np.ndarray:
        family = makers[kind](slow_time, value, points)
        return np.asarray(filtering.log_likelihood(family, slow_time, value, sd))

    found["rough"] = learn_parameters(lambda points: likelihood("rough", points), rough), rough
    if waving is not None:
        learnt = learn_parameters(
            lambda points: likelihood("repeating", points), waving, iterations=6
        )
        found["repeating"] = learnt, waving
    kind: Kind = max(found, key=lambda name: found[name][0].log_evidence)
    learnt = found[kind][0]
    chosen = np.argsort(-learnt.weights)[:_MEMBERS]
    members = [makers[kind](slow_time, value, learnt.points[i]) for i in chosen]
    weights = learnt.weights[chosen] / learnt.weights[chosen].sum()
    toothed = _teeth(slow_time, value, sd)
    if toothed is not None and toothed.log_evidence > learnt.log_evidence:
        # All members are as probable, and ordered by their sizes.
        places = np.linspace(0, len(toothed.weights) - 1, _MEMBERS).round().astype(int)
        kind, members = "teeth", [toothed.family.member(int(i)) for i in places]
        weights = np.full(_MEMBERS, 1.0 / _MEMBERS)
    whole, long, short = (
        _averaged(members, weights, parts, slow_time, value, sd)
        for parts in (range(len(members[0].terms)), (0, 1), range(2, len(members[0].terms)))
    )
    foretold, spread = filtering.leave_one_out(members[0], slow_time, value, sd)
    score = mixture_of_experts.log_density(value, foretold, np.hypot(spread, sd))
    return SeparatedScales(
        slow_time, *whole, *long, *short, kind, members[0], float(np.sum(score))
    )


def choose(slow_time: Series, value: Series, sd: Series) -> SeparationChoice:
    """Fit the additive process and the mixture of experts, and compare their predictions.

    Parameters
    ----------
    slow_time
        Times of the readings [slow time].
    value
        Readings; NaN where there is none.
    sd
        Standard deviations of the readings, in their unit.

    Returns
    -------
    Both models, and the better one.
    """
    both = additive(slow_time, value, sd), mixture_of_experts.fit(slow_time, value, sd)
    odds = both[0].log_predictive - both[1].log_predictive
    return SeparationChoice("additive" if odds >= 0.0 else "mixture", float(odds), *both)


def _averaged(
    members: list[Sum],
    weights: Float[np.ndarray, " member"],
    parts: Sequence[int],
    slow_time: Series,
    value: Series,
    sd: Series,
) -> tuple[Series, Series]:
    found = []
    for one in members:
        taken = np.sum([one.part(i) for i in parts], axis=0) != 0.0
        asked = one.observation_row(slow_time) * taken
        found.append(filtering.smooth(one, slow_time, value, sd, part=asked))
    means, sds = np.array([f.mean for f in found]), np.array([f.sd for f in found])
    mean = weights @ means
    return mean, np.sqrt(weights @ (sds**2 + (means - mean) ** 2))


def _teeth(slow_time: Series, value: Series, sd: Series) -> periodicity.Repeating | None:
    """Learn a short scale that falls at once; None where least squares find no such."""
    prior, base = forecast.prior_of(slow_time, value)
    return wave_choice.learn_periodic_process(
        (slow_time, value, sd), value, prior, base, (), prior.centre, only_teeth=True
    )


def _sizes(slow_time: Series, value: Series) -> tuple[float, float, float]:
    span = float(slow_time[-1] - slow_time[0])
    return span, float(np.median(np.diff(slow_time))), max(float(np.std(value)), 1e-300)


def _rough_prior(slow_time: Series, value: Series) -> HyperparameterPrior:
    span, gap, scatter = _sizes(slow_time, value)
    centre = np.log([0.4 * span, 0.5 * scatter, max(3.0 * gap, 0.02 * span), 0.5 * scatter])
    return HyperparameterPrior(centre, np.array([0.7, 1.2, 0.8, 1.0]))


def _repeating_prior(
    slow_time: Series, value: Series, sd: Series
) -> HyperparameterPrior | None:
    span, _, scatter = _sizes(slow_time, value)
    period = periodicity.period_of(slow_time, value, sd)
    if period is None:
        return None
    centre = np.log(
        [0.4 * span, 0.5 * scatter, period, 0.5 * scatter, 0.6, 3.0 * span, 0.1 * scatter]
    )
    width = max(0.15 * period / span, 1e-3)
    return HyperparameterPrior(centre, np.array([0.7, 1.2, width, 1.0, 0.6, 1.2, 1.0]))


def _long(slow_time: Series, value: Series, points: np.ndarray) -> tuple[Trend, Matern]:
    span, _, scatter = _sizes(slow_time, value)
    length, sd = np.exp(points[..., 0]), np.exp(points[..., 1])
    vague = 10.0 * (scatter + float(np.abs(value).max()))
    trend = Trend(level_sd=vague, slope_sd=10.0 * scatter / span)
    return trend, Matern(smoothness=2.5, length=length, sd=sd)


def _rough(slow_time: Series, value: Series, points: np.ndarray) -> Sum:
    length, sd = np.exp(points[..., 2]), np.exp(points[..., 3])
    short = Matern(smoothness=0.5, length=length, sd=sd)
    return Sum((*_long(slow_time, value, points), short))


def _repeating(slow_time: Series, value: Series, points: np.ndarray) -> Sum:
    period, sd, roughness, memory, left = np.exp(np.moveaxis(points[..., 2:], -1, 0))
    short = quasi_periodic(
        period=period, length=roughness, sd=sd, memory=memory, harmonics=_HARMONICS
    )
    # What jumps has more harmonics than are kept; the rest is rough.
    gap = _sizes(slow_time, value)[1]
    rest = Matern(smoothness=0.5, length=gap + 0.0 * left, sd=left, fixed=("length",))
    return Sum((*_long(slow_time, value, points), short, rest))


def _check(slow_time: Series, value: Series, sd: Series) -> None:
    if len(slow_time) < 8 or not np.all(np.diff(slow_time) >= 0.0):
        raise ValueError(
            f"{len(slow_time)} readings, or not in ascending order, are no series to take "
            "apart. Give at least 8, ascending in slow time."
        )
    if not (np.isfinite(value).all() and np.isfinite(sd).all() and (sd > 0.0).all()):
        raise ValueError(
            "A value or its standard deviation is missing or zero. Leave out readings that "
            "are not there, and give the others the standard deviation they have."
        )
