"""Validation of a model and its parameters on records that were held out.

A law close to the right one fails where motion is larger than in the fitted records. So does
the right one near an instability, where small errors of its parameters decide; there its refit
to the other record must agree with the first one.
"""

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.special

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
"""[1] On the standard deviations of these parameters, which linearisation understates near an
instability. Source: docs/what_decides.md: half and double change no answer."""


def is_confirmed_on_holdout(fit: Fit, error: float, tests: Sequence[Trial]) -> bool:
    """Whether held-out records agree with a model that leaves noise only.

    Either the error of free runs there is that of noise; or the model, refitted to each record,
    leaves noise only and has the same parameters within their uncertainty.
    """
    samples = sum(len(trial.outputs) for trial in tests)
    if error < 1 + max(MAX_EXCESS, MAX_EXCESS_SDS / np.sqrt(2 * samples)):
        return True
    if fit.noise.drift is not None:
        return True  # runs with rigid modes drift by any error of the input
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
    """Whether two fits of one model agree within their covariances (Wald test)."""
    apart = one.free - other.free
    spread = SD_FACTOR**2 * (one.covariance + other.covariance)
    scale = np.sqrt(np.diag(spread))
    known = scipy.linalg.pinvh(spread / np.outer(scale, scale))
    distance = (apart / scale) @ known @ (apart / scale)
    return bool(scipy.special.chdtrc(len(apart), distance) > SAME_P_VALUE)
