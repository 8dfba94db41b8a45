"""Candidates for a second effect, from later segments of the records.

Where two strong effects are missing, the free run with one of them is soon out of step, and
what a whole record leaves points nowhere. Over the first part of the records of which that law
leaves something, and not yet much, what is left is small, and tells of the other.
"""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence

from scipy.fft import prev_fast_len

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    Fit,
    FitControl,
    attempt,
    refit,
)
from slowtime.discrepancy.calibration.initial_states import refit_initial_states
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of, laws_left_by
from slowtime.discrepancy.records import MIN_SAMPLES, Trial
from slowtime.dynamics.effects import Kind

from .initial_segments import SEGMENT_HORIZONS, initial_segment_candidates

LIKELY_ELEMENTS = 2
"""[elements] The most probable, at which laws are tried by free runs. Source: a bound on
computing time."""
MAX_BY_FREE_RUN = 2
"""[laws] Found by free runs that are proposed. Source: a bound on computing time."""
RECORD_SHARES = (0.06, 0.12, 0.25, 0.5)
"""[share of each record] First parts that are examined in turn. Source: docs/decisions/0030 for
the rule; docs/what_decides.md: half and double change no answer."""


def later_segment_candidates(
    before: Fit,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    late: Callable[[], bool],
) -> tuple[Fit, list[Candidate]]:
    """Give the fit to that part of the records, and what may be missing in it, the best first.

    Those that explain most along the force, and those whose free run explains how that part
    begins. None where it is too late, or where the model explains half of the records.
    """
    return attempt(_first_misfit, before, trials, kinds, late) or (before, [])


def _first_misfit(
    before: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind], late: Callable[[], bool]
) -> tuple[Fit, list[Candidate]] | None:
    fit = before
    horizons: tuple[float, ...] = SEGMENT_HORIZONS
    for share in RECORD_SHARES:
        counts = [max(prev_fast_len(int(share * len(t.outputs))), MIN_SAMPLES) for t in trials]
        parts = tuple(t.part(0, count) for t, count in zip(trials, counts, strict=True))
        fit = refit_initial_states(fit, parts) if fit is before else fit
        fit = refit(
            before.plant, parts, noise=before.noise, values=fit.values,
            states=fit.states, horizons=horizons, control=FitControl(is_late=late),
        )  # fmt: skip
        horizons = (1.0,)
        if fit.chi2_in_band > WRONG_MODEL_CHI2:
            held, located, along = laws_left_by(fit, parts, kinds)
            places = (p for g in located.groups for p in g.places if p.kind == "element")
            among = list(itertools.islice(places, LIKELY_ELEMENTS))
            opened = initial_segment_candidates(held, parts, kinds, late, among)
            opened = opened[:MAX_BY_FREE_RUN]
            done = {label_of(one.effect) for one in opened}
            others = (one for one in along if label_of(one.effect) not in done)
            both = sorted([*opened, *others], key=lambda one: one.cost)
            return held, [dataclasses.replace(one, start=None) for one in both]
    return None
