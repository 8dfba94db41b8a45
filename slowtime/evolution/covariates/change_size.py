"""Size and onset of the change that an alarm reports."""

import dataclasses

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from slowtime.evolution.change import check_level
from slowtime.identification.estimates import Measured

from .change_onset import Entered, Onsets, onset_posterior


@dataclasses.dataclass(frozen=True, slots=True)
class ChangeEstimate:
    """A lasting change: how large, since when.

    Parameters
    ----------
    frequency, stiffness
        Relative changes [1], supposing for the second that no mass has changed.
    frequency_interval, stiffness_interval
        Their intervals.
    since
        Median of the slow time of onset.
    since_interval
        Its interval.
    """

    frequency: Measured
    frequency_interval: tuple[float, float]
    stiffness: Measured
    stiffness_interval: tuple[float, float]
    since: float
    since_interval: tuple[float, float]


def estimate_change(
    onsets: Onsets, size: float, entered: Entered, level: float = 0.95
) -> ChangeEstimate:
    """Size and onset of the change, supposing that there is one.

    Parameters
    ----------
    onsets
        Of the state of a watch.
    size, entered
        As in `Watch`.
    level
        Probability of the intervals [1].

    Returns
    -------
    Size and onset, with their uncertainty.
    """
    if not len(onsets.time):
        raise ValueError("Nothing has been judged yet. Step through readings first.")
    quantile = check_level(level)
    weight, mean, sd = onset_posterior(onsets, size)
    lower = 0.0 if entered == "gain" else -np.inf
    upper = 0.0 if entered == "loss" else np.inf
    outside = ndtr((lower - mean) / sd)
    share = np.maximum(ndtr((upper - mean) / sd) - outside, 1e-300)

    def below(log_change: float, probability: float) -> float:
        inside = np.clip(log_change, lower, upper)
        part = (ndtr((inside - mean) / sd) - outside) / share
        return float(weight @ part) - probability

    ends = float((mean - 9.0 * sd).min()), float((mean + 9.0 * sd).max())
    tails = 0.5 * (1.0 - level), 0.5, 0.5 * (1.0 + level)
    low, median, high = (float(brentq(below, *ends, args=(q,))) for q in tails)
    spread = 0.5 * (high - low) / quantile
    places = np.searchsorted(np.cumsum(weight), tails).clip(max=len(weight) - 1)
    first, since, last = onsets.time[places].tolist()
    return ChangeEstimate(
        Measured(float(np.expm1(median)), spread * float(np.exp(median))),
        (float(np.expm1(low)), float(np.expm1(high))),
        Measured(float(np.expm1(2 * median)), 2 * spread * float(np.exp(2 * median))),
        (float(np.expm1(2 * low)), float(np.expm1(2 * high))),
        since,
        (first, last),
    )
