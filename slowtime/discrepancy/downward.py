"""Labels further down the list in; the next, and those whose free run comes nearest, out.

Along a motion that was recovered the right law may stand far down: where sensors are few the
motion at its place is guessed, and where it is strong the motion is none that a linear model
would make. Its free run, from where its force has put all else, still comes nearer than others.
"""

import math
from collections.abc import Mapping, Sequence

from slowtime.dynamics.effects import Kind, Unmeasured

from .adding import free_run
from .candidates import Candidate, label_of
from .equivalent import equivalents
from .naming import Named
from .records import Trial
from .refit import Fit

IN_TURN, NEAREST = 3, 3
"""Labels that are given: the next in turn, and those that come nearest in a free run."""
LEAVES, MOST = 1.5, 0.6
"""Mean square over the noise, in band, and share of that without any law, from which one goes
further down: what explains more may be one of two laws, and the other is looked for first."""


class Downward:
    """Gives more labels to refit, once, where the best leaves most of what was missing.

    Parameters
    ----------
    bent
        The fit without any law, whose constants may have made up for one.
    before
        The same, its constants held to their tolerances.
    tried
        Candidates, the best first.
    labels
        Those that are refitted anyway.
    """

    def __init__(
        self,
        bent: Fit,
        before: Fit,
        tried: Sequence[Candidate],
        labels: Sequence[Candidate],
        trials: Sequence[Trial],
        kinds: Mapping[str, Kind],
    ) -> None:
        done = {label_of(one.effect) for one in labels}
        self._rest = [
            one
            for one in tried
            if label_of(one.effect) not in done
            and one.start is not None
            and not isinstance(kinds[one.effect.kind].action, Unmeasured)
        ]
        self._bent, self._before, self._trials, self._kinds = bent, before, trials, kinds
        self._gone = False

    def __call__(self, found: Sequence[Named]) -> list[Candidate]:
        """Give the next labels; none where what was refitted is enough, or they were given."""
        least = min((one.fit.chi2_in_band for one in found), default=math.inf)
        if self._gone or least < max(LEAVES, MOST * self._bent.chi2_in_band):
            return []
        self._gone = True
        batch, others = self._rest[:IN_TURN], self._rest[IN_TURN:]
        batch += sorted(others, key=self._run_with)[:NEAREST]
        return [*equivalents(self._bent, self._trials, self._kinds)[:NEAREST], *batch]

    def _run_with(self, one: Candidate) -> float:
        return free_run(self._before, one.effect, one.start, self._trials, self._kinds)
