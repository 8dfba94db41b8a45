"""Probabilities of names under the model's own inability to explain the records."""

import dataclasses
import math
from collections.abc import Sequence

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.diagnosis import NamedEffect
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.thresholds import LIMITS

CLOSED_SHARE = 0.8
"""[share of the logarithm of the gap] That a right model closes at least, from the first fit to
the noise. Source: laws that are known to be right on real rigs closed 0.80 to 0.82; a wrong one
that imitated dry friction closed 0.70."""
POWER = 2.0
"""[1] To which a smaller share is taken, relative to that one. Source: as above; the wrong name
is then given less than 0.8."""

MAX_AMPLITUDE_LEFT = 0.005
"""[share of the root mean square of the gap] That only a right law leaves. Source: the best
imitation of one law by another that was seen on measured or simulated rigs left 0.02, and laws
that are right but for their smoothing in another simulator left 0.001; half and double change
no answer of docs/what_decides.md."""


def _misfits(found: Hypothesis) -> tuple[float, float]:
    """Return the mean squares over the noise that the first and the last fit leave, from 1."""
    first, last = found.first, found.last
    if len(first.states) == len(last.states) == len(found.trials):
        before, after = (misfit(fit, last.noise, found.trials) for fit in (first, last))
        before, after = before / last.data, after / last.data
    else:
        before, after = first.chi2_in_band, last.chi2_in_band
    return max(before, 1.0), max(after, 1.0)


def closed_share(found: Hypothesis) -> float:
    """Return the share of the gap from the first fit to the noise that the last one closes."""
    # In logarithms of the mean square, each factor counts alike.
    before, after = _misfits(found)
    return math.log(before / after) / math.log(before) if before > after else 0.0


def amplitude_left(found: Hypothesis) -> float:
    """Return the share of the root mean square of the gap that the last fit leaves [1]."""
    before, after = _misfits(found)
    return math.sqrt((after - 1) / (before - 1)) if before > after else 1.0


def law_probability(found: Hypothesis) -> float:
    """Probability that the laws found are the right ones, by what they leave unexplained.

    It is 1 where what is left is near the noise, white, or hardly any of the gap; and where the
    last effect follows no law, so that no free run can leave less.
    """
    if found.final:
        return 1.0
    last = found.last
    if last.chi2_in_band < LIMITS.far_off_chi2 or chi2_p_value(last) > LIMITS.coloured_p_value:
        return 1.0
    if amplitude_left(found) < MAX_AMPLITUDE_LEFT:
        return 1.0
    return float(min(closed_share(found) / CLOSED_SHARE, 1.0) ** POWER)


def temper_unexplained(
    effects: Sequence[NamedEffect], found: Hypothesis
) -> tuple[NamedEffect, ...]:
    """Lower the probability of names where the rest is far above the noise and not white."""
    share = law_probability(found)
    return tuple(
        dataclasses.replace(one, probability=share * one.probability) for one in effects
    )
