"""Doubt about laws that do nothing of their own, or that a free force beside them refutes."""

import dataclasses
from collections.abc import Mapping

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.validation.free_force_test import refuted_by_free_force
from slowtime.dynamics.effects import Kind

from .doubts import doubt
from .many_laws import MANY_LAWS


def refute(found: Hypothesis, first: int, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Doubt laws that do nothing of their own, and name the place of those refuted."""
    last = found.last
    if not found.effects or found.undecided or found.final:
        return found
    # What leaves more than noise is judged by that: of real structures no law is quite true. Of
    # many laws, what is left is too little to be judged by: the more laws, the less it is.
    patchwork = len(found.effects) >= MANY_LAWS and last.chi2_in_band < LIMITS.explained_chi2
    if chi2_p_value(last) <= LIMITS.coloured_p_value and not patchwork:
        return found
    against = refuted_by_free_force(last, first, found.trials, kinds)
    if against is None:
        return found
    if not against.idle:
        return dataclasses.replace(found, refuted_at=against.place)
    for number in against.idle:
        found = doubt(found, number - first)
    return found
