"""Detection of outliers: readings that no smooth course and no covariate accounts for."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular

from slowtime.history_diagnosis.data.history import ScaledHistory, Series
from slowtime.history_diagnosis.laws.laplace import process_grid
from slowtime.history_diagnosis.laws.terms import design_priors
from slowtime.history_diagnosis.likelihood.evidence import (
    CoefficientPosterior,
    coefficient_posterior,
)
from slowtime.history_diagnosis.likelihood.whitening import (
    MaternProcess,
    one_step_errors,
    whiten,
)

_OUTLIER_SDS = 4.0
"""[robust standard deviations] From the predictions of both sides of time. Source:
docs/what_decides.md, which has the cases where it decides."""
_UNCERTAIN_RATIO = 1.3
"""[1] Times the smaller predictive spread, beyond which a side is ignored. Source:
docs/what_decides.md, which has the cases where it decides."""
_PASSES = 4
"""[passes] Of fitting and masking at most. Source: docs/what_decides.md: half and double change
no answer."""
_MOST_OUTLIERS = 0.25
"""[share of the readings] Called outliers at most. Source: docs/what_decides.md, which has the
cases where it decides."""


def inlier_mask(
    past: ScaledHistory,
    known: Float[np.ndarray, "time column"],
    barred: Bool[np.ndarray, " time"],
) -> Bool[np.ndarray, " time"]:
    """Return which readings agree with those before them or with those after."""
    # Flexible functions of all covariates are fitted along, so that a rare cold day or a strong
    # vibration is not mistaken for a wrong reading. A lasting change agrees with one side.
    columns = np.column_stack([_flexible_design(past), known])
    mask = ~barred
    for _ in range(_PASSES):
        score = _scores(past, columns, mask)
        # By the scatter of the middle half: outliers have widened what the fit calls noise.
        # And by that nearby, for a sensor that has become noisy reads no outliers.
        unit = 1.4826 * np.maximum(float(np.median(score)), _running_median(score))
        limit = np.maximum(_OUTLIER_SDS * unit, float(np.quantile(score, 1.0 - _MOST_OUTLIERS)))
        kept = (score <= limit) & ~barred
        if (kept == mask).all():
            break
        mask = kept
    return mask


def covariate_residual(past: ScaledHistory, mask: Bool[np.ndarray, " time"]) -> Series:
    """Return the readings without a flexible function of the covariates [scale]."""
    columns = _flexible_design(past)
    residual: Series = past.value - columns @ _fit(past, columns, mask)[0].mean
    return residual


def _running_median(score: Series) -> Series:
    half = max(15, len(score) // 20)
    if half >= len(score):
        return np.full(len(score), float(np.median(score)))
    padded = np.pad(score, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    nearby: Series = np.median(windows, axis=1)
    return nearby


def _flexible_design(past: ScaledHistory) -> Float[np.ndarray, "time coefficient"]:
    """Constant, and of each covariate a parabola with five kinks."""
    columns = [np.ones((len(past.time), 1))]
    for covariate in past.covariates:
        x = covariate.values
        bends = np.quantile(x, [0.1, 0.25, 0.5, 0.75, 0.9])
        columns.append(np.column_stack([x, x**2, *(np.maximum(x - b, 0.0) for b in bends)]))
    stacked: Float[np.ndarray, "time coefficient"] = np.column_stack(columns)
    return stacked


def _fit(
    past: ScaledHistory,
    columns: Float[np.ndarray, "time column"],
    mask: Bool[np.ndarray, " time"],
) -> tuple[CoefficientPosterior, MaternProcess]:
    """Fit columns with the most probable random process of a few."""
    stacked = np.column_stack([past.value, columns])
    variance = np.where(mask, past.sd**2, np.inf)
    priors = design_priors(columns, mask)
    found = [
        (
            coefficient_posterior(
                whiten(process, past.time, variance, stacked), priors, int(mask.sum())
            ),
            process,
        )
        for process in process_grid(past)
    ]
    return max(found, key=lambda one: one[0].log_evidence)


def _scores(
    past: ScaledHistory,
    columns: Float[np.ndarray, "time column"],
    mask: Bool[np.ndarray, " time"],
) -> Float[np.ndarray, " time"]:
    """Least standardised residual of each reading, predicted from before and from after."""
    found, process = _fit(past, columns, mask)
    stacked = np.column_stack([past.value - columns @ found.mean, columns])
    forward = _predicted(process, past.time, stacked, past.sd, mask, found)
    backward = _predicted(
        process, -past.time[::-1], stacked[::-1], past.sd[::-1], mask[::-1], found
    )
    score = np.abs([forward[0], backward[0][::-1]])
    spread = np.array([forward[1], backward[1][::-1]])
    score[spread > _UNCERTAIN_RATIO * spread.min(axis=0)] = np.inf
    least: Float[np.ndarray, " time"] = score.min(axis=0)
    return least


def _predicted(
    process: MaternProcess,
    time: Series,
    stacked: Float[np.ndarray, "time column"],
    sd: Series,
    mask: Bool[np.ndarray, " time"],
    found: CoefficientPosterior,
) -> tuple[Series, Series]:
    """Prediction errors over their standard deviations, and these."""
    errors, variance = one_step_errors(process, time, sd**2, mask, stacked)
    spread = np.sqrt(variance)
    # A reading that was used has drawn the coefficients towards itself, the more the rarer its
    # covariates: its residual is studentised by its leverage.
    pull = solve_triangular(found.factor, errors[:, 1:].T / spread, lower=True)
    leverage = np.sum(pull**2, axis=0)
    unit = np.where(mask, np.sqrt(np.maximum(1.0 - leverage, 0.02)), np.sqrt(1.0 + leverage))
    return errors[:, 0] / (spread * unit), spread
