"""Candidates that the search may begin with instead of the first effect."""

import itertools
from collections.abc import Iterator, Mapping

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.library_fit import Candidate, label_of
from slowtime.discrepancy.estimation.candidate_fit import fit_candidates
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.progress import Monitor
from slowtime.dynamics.effects import Effect, Kind

MAX_FITTED_STARTS = 2
"""[candidates] Already refitted, with which the search restarts at most. Source:
docs/decisions/0017 for the rule; docs/what_decides.md: half and double change no answer."""
MAX_LOWER_STARTS = 6
"""[candidates] Ranked lower and not refitted, with which it restarts at most. Source:
docs/decisions/0017 for the rule; docs/what_decides.md: half and double change no answer."""


def alternative_starts(
    found: Hypothesis, before: Fit, kinds: Mapping[str, Kind], tell: Monitor
) -> Iterator[FittedCandidate]:
    """Give the second that was found, the next best that were refitted, and what came after."""

    def refitted(candidate: Candidate) -> list[FittedCandidate]:
        return fit_candidates(before, [candidate], found.trials, kinds, tick)

    def tick(effect: Effect, _: int) -> bool:
        tell(f"refitting {effect.kind} at {effect.place}", 0.85)
        return tell.is_late

    first, *rest = found.fitted
    second = [answer.effect for answer in found.effects[1:2]]
    known = {label_of(one.effect): one for one in rest}
    for effect in second:
        if label_of(effect) in known:
            yield known.pop(label_of(effect))
        else:
            own = [c for c in found.tried if label_of(c.effect) == label_of(effect)]
            candidate = own[0] if own else Candidate(effect, 0.0, 0.0, 0.0)
            yield from refitted(candidate)
    kin = kinds[first.effect.kind].family
    apart = (
        one
        for one in known.values()
        if (kinds[one.effect.kind].family, one.effect.place) != (kin, first.effect.place)
    )
    yield from itertools.islice(apart, MAX_FITTED_STARTS)
    seen = (*(one.effect for one in found.fitted), *second)
    done = {label_of(effect) for effect in seen}
    down = [c for c in found.tried if label_of(c.effect) not in done][:MAX_LOWER_STARTS]
    for candidate in down:
        for named in refitted(candidate):
            if named.fit.cost < first.fit.cost:
                yield named
