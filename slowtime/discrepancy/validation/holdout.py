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

ASTRAY, ASTRAY_SD = 0.05, 5.0
"""By how much an error may be over that of noise alone, and by how many standard deviations of
that, on records that were never seen, before laws that explain the others are doubted. Of 170
right ones that leave noise, two are more than 2 % over it: a pendulum that turns over, and what
sings by itself."""
SAME, SLACK = 1e-3, 2.0
"""Chance below which numbers that other records give are others; standard deviations of them
being worth so many, where motion is on the verge of another."""


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
    if error < 1 + max(ASTRAY, ASTRAY_SD / np.sqrt(2 * samples)):
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
    spread = SLACK**2 * (one.covariance + other.covariance)
    scale = np.sqrt(np.diag(spread))
    known = scipy.linalg.pinvh(spread / np.outer(scale, scale))
    distance = (apart / scale) @ known @ (apart / scale)
    return bool(scipy.stats.chi2.sf(distance, len(apart)) > SAME)
