"""Readings that no smooth course and no function of the covariates accounts for."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular

from . import evidence
from .history import Scaled, Series
from .law import prior_variance, settings
from .whitening import Wander, whiten

_OUTLIER = 4.0  # robust standard deviations, on both sides of time
_BLUNT = 1.3  # times the lesser spread of a foretold reading, beyond which a side has no say
_PASSES = 4
_MOST = 0.25
_DEAF = 1e8  # variance with which a reading is foretold but teaches nothing


def agreeing(
    past: Scaled,
    known: Float[np.ndarray, "time column"],
    barred: Bool[np.ndarray, " time"],
) -> Bool[np.ndarray, " time"]:
    """Which readings are in line with those before them or with those after.

    Parameters
    ----------
    past
        The history.
    known
        Columns of what it is known to follow.
    barred
        Readings that are known to be wrong.

    Notes
    -----
    Functions of the covariates are fitted along, many more than will be needed, so that a
    rare cold day or a strong shake is not mistaken for a wrong reading. What lasts has one
    side to agree with, so that steps stay.
    """
    columns = np.column_stack([np.ones(len(past.time)), *_anything(past), known])
    mask = ~barred
    for _ in range(_PASSES):
        score = _scores(past, columns, mask)
        # By the scatter of the middle half: outliers have widened what the fit calls noise.
        # And by that nearby, for a sensor that has become noisy reads no outliers.
        unit = 1.4826 * np.maximum(float(np.median(score)), _nearby(score))
        kept = score <= np.maximum(_OUTLIER * unit, float(np.quantile(score, 1.0 - _MOST)))
        kept &= ~barred
        if (kept == mask).all():
            break
        mask = kept
    return mask


def left_over(past: Scaled, mask: Bool[np.ndarray, " time"]) -> Series:
    """Take from the readings whatever may follow the covariates."""
    columns = np.column_stack([np.ones(len(past.time)), *_anything(past)])
    residual: Series = past.value - columns @ _best(past, columns, mask)[0].mean
    return residual


def _nearby(score: Series) -> Series:
    """Median over a window of readings about each."""
    half = max(15, len(score) // 20)
    padded = np.pad(score, half, mode="reflect") if half < len(score) else score
    if half >= len(score):
        return np.full(len(score), float(np.median(score)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    nearby: Series = np.median(windows, axis=1)
    return nearby


def _anything(past: Scaled) -> list[Float[np.ndarray, "time column"]]:
    columns = []
    for covariate in past.covariates:
        x = covariate.values
        bends = np.quantile(x, [0.1, 0.25, 0.5, 0.75, 0.9])
        columns.append(np.column_stack([x, x**2, *(np.maximum(x - b, 0.0) for b in bends)]))
    return columns


def _best(
    past: Scaled, columns: Float[np.ndarray, "time column"], mask: Bool[np.ndarray, " time"]
) -> tuple[evidence.Posterior, Wander]:
    """Fit columns with the most probable wandering part of a few."""
    together = np.column_stack([past.value, columns])
    variance = np.where(mask, past.sd**2, np.inf)
    prior = prior_variance(columns, mask)
    prior[0] = evidence.MEAN_SD**2
    best = None
    for wander in settings(past):
        filtered = whiten(wander, past.time, variance, together)
        found = evidence.posterior(filtered, prior, int(mask.sum()))
        if best is None or found.log_evidence > best[0].log_evidence:
            best = found, wander
    assert best is not None
    return best


def _scores(
    past: Scaled, columns: Float[np.ndarray, "time column"], mask: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " time"]:
    """Least standardised residual of each reading, from before and from after."""
    found, wander = _best(past, columns, mask)
    together = np.column_stack([past.value - columns @ found.mean, columns])
    forward = _foretold(wander, past.time, together, past.sd, mask, found)
    backward = _foretold(
        wander, -past.time[::-1], together[::-1], past.sd[::-1], mask[::-1], found
    )
    score = np.abs([forward[0], backward[0][::-1]])
    spread = np.array([forward[1], backward[1][::-1]])
    score[spread > _BLUNT * spread.min(axis=0)] = np.inf
    least: Float[np.ndarray, " time"] = score.min(axis=0)
    return least


def _foretold(
    wander: Wander,
    time: Series,
    together: Float[np.ndarray, "time column"],
    sd: Series,
    mask: Bool[np.ndarray, " time"],
    found: evidence.Posterior,
) -> tuple[Series, Series]:
    """Residuals in their predicted spreads, and these; readings left out do not teach.

    A reading that was learnt from has drawn the coefficients towards itself, the more the less
    common its covariates: its residual is made as large as if it had not been.
    """
    filtered = whiten(wander, time, np.where(mask, sd**2, _DEAF), together)
    innovations = filtered.white * np.sqrt(filtered.spread)[:, None]
    own = np.where(mask, filtered.spread, filtered.spread - _DEAF + sd**2)
    spread = np.sqrt(np.maximum(own, sd**2))
    pull = solve_triangular(found.factor, innovations[:, 1:].T / spread, lower=True)
    leverage = np.sum(pull**2, axis=0)
    unit = np.where(mask, np.sqrt(np.maximum(1.0 - leverage, 0.02)), np.sqrt(1.0 + leverage))
    return innovations[:, 0] / (spread * unit), spread
