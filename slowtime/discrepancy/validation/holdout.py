"""A fit and records it never saw, in; whether its model and its numbers are true there, out.

A neighbour of the right law goes its own way where motion is larger than it ever was. So does
the right one, where a motion tips over and what is left open of its numbers tells when.
"""

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.stats

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS

from .free_run import refit_on_record

MAX_EXCESS = 0.05
"""[1] By which an error on records that were held out may exceed that of noise alone.
Source: of 170 right models that leave noise, two exceed 2 %: a pendulum that turns over, and
a self-excited oscillation."""
MAX_EXCESS_SDS = 5.0
"""[standard deviations of the noise's own error] The same for short records. Source:
five-sigma rule."""
SAME_P_VALUE = 1e-3
"""[probability] p-value below which parameters of two records differ. Source: one false
alarm in a thousand."""
SD_FACTOR = 2.0
"""[1] On the standard deviations of these parameters, which linearisation understates near
an instability. Source: judgement; no study is recorded."""


def is_confirmed_on_holdout(fit: Fit, error: float, tests: Sequence[Trial]) -> bool:
    """Whether records that were not fitted say nothing against a model that leaves noise.

    Either the error there is that of noise; or the model, refitted to each, leaves no more, and
    its numbers are those it had, as far as both are known.

    Parameters
    ----------
    error
        On these records, over what the noise alone would be.
    """
    samples = sum(len(trial.outputs) for trial in tests)
    if error < 1 + max(MAX_EXCESS, MAX_EXCESS_SDS / np.sqrt(2 * samples)):
        return True
    if fit.noise.drift is not None:
        return True  # what floats goes its own way by whatever pushes it
    for trial in tests:
        again = refit_on_record(fit, trial)
        if (
            again is None
            or again.chi2_in_band > LIMITS.explained_chi2
            or not are_parameters_equal(fit, again)
        ):
            return False
    return True


def are_parameters_equal(one: Fit, other: Fit) -> bool:
    """Whether fits of one model to other records differ by no more than is open of both."""
    apart = one.free - other.free
    spread = SD_FACTOR**2 * (one.covariance + other.covariance)
    scale = np.sqrt(np.diag(spread))
    known = scipy.linalg.pinvh(spread / np.outer(scale, scale))
    distance = (apart / scale) @ known @ (apart / scale)
    return bool(scipy.stats.chi2.sf(distance, len(apart)) > SAME_P_VALUE)
