"""Bayesian inversion of surrogate models: frequencies to changes of a structure.

Where no formula leads from a change to a frequency, a surrogate learnt from a few runs of the
model does, and says how well it knows (chapter 6 of the book). Its uncertainty widens the
answer as the error of the reading does.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from slowtime.evolution.change import Change, check_level
from slowtime.evolution.reasons import FAR_OUTSIDE, Reason

DRAWS = 4096
"""Number of draws of the importance sampling."""

ENOUGH = 400.0
"""Least effective sample size."""

ROUNDS = 8
"""Rounds of adaptation, at most."""

FEW, TEMPERED = 40.0, 40
WIDER = 1.5
"""Factor on the width of the proposal, so that its tails cover the posterior."""

LEARNT = 0.9
"""Ratio of posterior to prior standard deviation above which a change counts as not
determined."""


@runtime_checkable
class FrequencySurrogate(Protocol):
    """What foretells a frequency: mean and standard deviation at changes of the structure."""

    def predict(self, X: np.ndarray, return_std: bool = False) -> Any:
        """Predict the frequency at changes of the structure.

        Parameters
        ----------
        X
            Points [point, change].
        return_std
            Whether to return the standard deviation as well.

        Returns
        -------
        Mean, or mean and standard deviation, at each point [Hz].
        """


@dataclasses.dataclass(frozen=True, slots=True)
class Changes:
    """What changed, one `Change` for each input of the surrogates."""

    each: tuple[Change, ...]
    correlation: Float[np.ndarray, "time change change"]
    posterior_to_prior: Float[np.ndarray, "time change"]
    """Standard deviation left over that believed beforehand: 1 where nothing was learnt."""


def changes_from_frequencies(
    surrogates: Sequence[FrequencySurrogate],
    frequency_hz: Float[np.ndarray, "time mode"],
    frequency_sd_hz: Float[np.ndarray, "time mode"],
    *,
    prior: Sequence[Any],
    level: float = 0.95,
    draws: int = DRAWS,
) -> Changes:
    r"""Estimate changes of a structure from readings of its frequencies, by Bayes' rule.

    .. math:: p(\Delta \mid f) \propto p(\Delta) \prod_j
              N(f_j; m_j(\Delta), s_j(\Delta)^2 + \sigma_j^2)

    with mean :math:`m_j` and standard deviation :math:`s_j` of the surrogate of mode
    :math:`j`. The integral is over even draws of the prior, moved to where the posterior is
    until enough of them count.

    Parameters
    ----------
    surrogates
        One for each mode, all of the same inputs, in the same unit as the readings.
    frequency_hz, frequency_sd_hz
        Readings and their standard deviations [Hz]; a NaN is a mode that was not seen.
    prior
        A frozen distribution of `scipy.stats` for each input: what the change may be. Not
        wider than the design of the surrogates.
    level
        Of the intervals.
    draws
        For each reading.

    Returns
    -------
    Changes whose `reasons` say ``OUTSIDE_BOUNDS`` where no change that the prior allows gives
    the reading, and ``NOT_SEPARABLE`` where the readings tell next to nothing of that input.
    """
    check_level(level)
    if len(surrogates) != frequency_hz.shape[1]:
        raise ValueError(
            f"{len(surrogates)} surrogates for {frequency_hz.shape[1]} modes. Give one for "
            "each column of frequency_hz."
        )
    even = scipy.stats.qmc.Halton(len(prior), scramble=False).random(draws + 1)[1:]
    normal = np.asarray(ndtri(even))
    first = _foretold(surrogates, prior, normal)
    believed = first.changes.std(axis=0)
    found = [
        _invert_one(surrogates, prior, normal, first, f, sd, level)
        for f, sd in zip(frequency_hz, frequency_sd_hz, strict=True)
    ]
    ratios = np.array([one.sd for one in found]) / believed
    each = []
    for k in range(len(prior)):
        reasons = np.array([one.reasons for one in found], dtype=np.uint32)
        reasons |= np.where(ratios[:, k] > LEARNT, int(Reason.NOT_SEPARABLE), 0).astype(
            np.uint32
        )
        value, sd, lo, hi = np.array([[o.mean[k], o.sd[k], o.lo[k], o.hi[k]] for o in found]).T
        each.append(Change(value, sd, lo, hi, reasons == 0, reasons))
    return Changes(tuple(each), np.array([one.correlation for one in found]), ratios)


@dataclasses.dataclass(frozen=True, slots=True)
class _Foretold:
    changes: np.ndarray
    mean: np.ndarray
    sd: np.ndarray


@dataclasses.dataclass(frozen=True, slots=True)
class _Turned:
    mean: np.ndarray
    sd: np.ndarray
    lo: np.ndarray
    hi: np.ndarray
    correlation: np.ndarray
    reasons: int


def _foretold(
    surrogates: Sequence[FrequencySurrogate], prior: Sequence[Any], normal: np.ndarray
) -> _Foretold:
    probability = np.clip(ndtr(normal), 1e-12, 1.0 - 1e-12)
    changes = np.stack([law.ppf(probability[:, k]) for k, law in enumerate(prior)], axis=1)
    told = [one.predict(changes, return_std=True) for one in surrogates]
    return _Foretold(
        changes, np.stack([m for m, _ in told], axis=1), np.stack([s for _, s in told], axis=1)
    )


def _invert_one(
    surrogates: Sequence[FrequencySurrogate],
    prior: Sequence[Any],
    even: np.ndarray,
    first: _Foretold,
    frequency: np.ndarray,
    sd: np.ndarray,
    level: float,
) -> _Turned:
    seen = np.isfinite(frequency)
    if not (np.isfinite(sd[seen]).all() and (sd[seen] >= 0.0).all()) or not seen.any():
        nothing = np.full(first.changes.shape[1], np.nan)
        reason = Reason.NEGATIVE_SD if (sd[seen] < 0.0).any() else Reason.NOT_FINITE
        empty = np.full((len(nothing), len(nothing)), np.nan)
        return _Turned(nothing, nothing, nothing, nothing, empty, int(reason))
    normal, told, proposed = even, first, -0.5 * np.sum(even**2, axis=1)
    weight = away = np.empty(0)
    for _ in range(ROUNDS):
        variance = told.sd[:, seen] ** 2 + sd[seen] ** 2
        away = (frequency[seen] - told.mean[:, seen]) ** 2 / np.maximum(variance, 1e-300)
        likelihood = -0.5 * np.sum(away + np.log(np.maximum(variance, 1e-300)), axis=1)
        log = likelihood - 0.5 * np.sum(normal**2, axis=1) - proposed
        weight = _normalised(log)
        if _effective(weight) >= ENOUGH:
            break
        normal, proposed = _proposal_draws(even, normal, log)
        told = _foretold(surrogates, prior, normal)
    nearest = float(np.sqrt(np.min(np.sum(away, axis=1))))
    return _summed(told.changes, weight, level, nearest)


def _normalised(log: np.ndarray) -> np.ndarray:
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum())


def _effective(weight: np.ndarray) -> float:
    """Draws that the weights are worth (Kish 1965)."""
    return float(1.0 / np.sum(weight**2))


def _proposal_draws(
    even: np.ndarray, normal: np.ndarray, log: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Draws where those of weight are, and the logarithm of their density."""
    # Sharper than any draw, a posterior is approached step by step: tempered to enough weight.
    weight = _normalised(log)
    for _ in range(TEMPERED):
        if _effective(weight) >= FEW:
            break
        log = 0.5 * log
        weight = _normalised(log)
    centre = weight @ normal
    around = normal - centre
    covariance = WIDER**2 * (around * weight[:, None]).T @ around
    factor = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(centre)))
    return centre + even @ factor.T, -0.5 * np.sum(even**2, axis=1) - np.sum(
        np.log(np.diag(factor))
    )


def _summed(changes: np.ndarray, weight: np.ndarray, level: float, nearest: float) -> _Turned:
    mean = weight @ changes
    around = changes - mean
    covariance = (around * weight[:, None]).T @ around
    sd = np.sqrt(np.diag(covariance))
    lo, hi = np.empty_like(mean), np.empty_like(mean)
    for k in range(len(mean)):
        order = np.argsort(changes[:, k])
        cumulated = np.cumsum(weight[order]) - 0.5 * weight[order]
        ends = np.interp([0.5 - 0.5 * level, 0.5 + 0.5 * level], cumulated, changes[order, k])
        lo[k], hi[k] = ends
    correlation = covariance / np.maximum(np.outer(sd, sd), 1e-300)
    reasons = int(Reason.OUTSIDE_BOUNDS) if nearest > FAR_OUTSIDE else 0
    return _Turned(mean, sd, lo, hi, correlation, reasons)
