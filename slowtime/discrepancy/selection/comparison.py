"""Two accounts of the same records, in; the likelier, out."""

import dataclasses
import math
from collections.abc import Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    evidence,
    misfit,
    rescored,
)
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.state import Found
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

from .probabilities import hardly_any


def explains_all(found: Found) -> bool:
    """Whether an account leaves nothing that is worth beginning again for."""
    first, last = found.fits[0], found.fits[-1]
    enough = (
        last.chi2_in_band < LIMITS.explained_chi2
        or chi2_p_value(last) > LIMITS.coloured_p_value
    )
    return found.ended or enough or (bool(found.answers) and hardly_any(last, first))


def better(
    found: Found,
    branch: Found,
    kinds: Mapping[str, Kind],
    enough: float = LIMITS.least_log_evidence,
) -> Found:
    """Give the likelier of two accounts, by the noise of the one that leaves least.

    One that under another hold of the inputs would explain all is looked at there.

    Parameters
    ----------
    enough
        Log evidence that the second has to bring.
    """
    if branch.otherwise is not None:
        return branch
    if branch.unheard or found.unheard:
        return found  # what one of them does not hear, it does not leave either
    if len(found.trials) != len(branch.trials):
        # One of them is judged by pieces of records: nothing less would have explained them.
        return branch if explains_all(branch) else found
    if not branch.answers:
        return found
    one, other = found.fits[-1], branch.fits[-1]
    least = min((one, other), key=unexplained_by)
    scores = [
        evidence(fit, kinds)
        if fit is least
        else rescored(
            FittedCandidate(branch.answers[-1].effect, fit.plant.description, fit, 0.0),
            least,
            found.trials,
            kinds,
        ).score
        for fit in (one, other)
    ]
    lead = scores[1] - scores[0]
    more = len(branch.answers) > len(found.answers)
    if lead < enough or (more and _by_a_fleck(found, one, other, least)):
        return found
    share = 1 / (
        1 + math.exp(-min(LIMITS.evidence_power * lead / max(least.chi2_in_band, 1.0), 50.0))
    )
    head, *rest = branch.answers
    head = dataclasses.replace(head, probability=share * head.probability)
    return dataclasses.replace(
        branch, answers=[head, *rest], named=found.named, tried=found.tried
    )


def _by_a_fleck(found: Found, one: Fit, other: Fit, least: Fit) -> bool:
    """Whether more effects explain next to nothing more than fewer, of what was missing."""
    bare, fewer, more = (
        misfit(fit, least.noise, found.trials) for fit in (found.fits[0], one, other)
    )
    return fewer - more < LIMITS.negligible_share * (bare - least.data)
