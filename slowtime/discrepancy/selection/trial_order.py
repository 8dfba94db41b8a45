"""Order in which candidates are fitted, and the rule by which one suffices."""

from collections.abc import Collection, Mapping, Sequence

from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Effect, Kind

FAR_COST_RATIO = 2.0
"""[1] Times what the best candidate leaves along the force, from which others are not tried in
the last part of the budget. Source: docs/decisions/0023."""
EQUAL_COST_RATIO = 1.1
"""[1] Times what the best candidate leaves along the force, within which those with fewer
parameters are tried first. Source: docs/decisions/0026 for the rule; docs/what_decides.md for
the value: half and double change no answer."""


class TrialOrder:
    """Tells which candidate is refitted; says when there is no time, and keeps which it was.

    Candidates `far` behind are the first to go.
    """

    def __init__(
        self, monitor: Monitor, number: int, most: int, share: float, far: Collection[Label]
    ) -> None:
        self._monitor, self._number, self._far = monitor, number, far
        self._begun, self._step = share + 0.08, 0.18 / max(most, 1)
        # One law at least is tried: what it leaves tells whether there is one.
        self.must = number == 0
        self.cut: list[Effect] = []

    def __call__(self, effect: Effect, turn: int) -> bool:
        """Say whether there is no time for a candidate."""
        share = self._begun + self._step * turn
        self._monitor(f"refitting {effect.kind} at {effect.place}", share)
        stop = self.is_late(effect, turn)
        self.cut.extend([effect] if stop and label_of(effect) not in self._far else [])
        return stop

    def is_late(self, effect: Effect, turn: int) -> bool:
        """Say the same, and keep nothing."""
        if label_of(effect) in self._far:
            return self._monitor.is_late
        must = self.must and turn == 0
        return self._monitor.is_over if self._number else self._monitor.is_late and not must


def near_first(
    candidates: list[Candidate], kinds: Mapping[str, Kind]
) -> tuple[list[Candidate], set[Label]]:
    """Put those of few numbers first, those far behind the best last; say which these are."""
    reach = FAR_COST_RATIO * min((one.cost for one in candidates), default=0.0)
    far = {label_of(one.effect) for one in candidates if one.cost >= reach}

    def turn(one: Candidate) -> tuple[bool, int]:
        return label_of(one.effect) in far, fitted_numbers(kinds[one.effect.kind])

    return sorted(candidates, key=turn), far


def simple_first(candidates: Sequence[Candidate], kinds: Mapping[str, Kind]) -> list[Candidate]:
    """Put candidates of few numbers first among those that leave about as little."""
    reach = EQUAL_COST_RATIO * min((one.cost for one in candidates), default=0.0)

    def turn(one: Candidate) -> tuple[bool, int]:
        near = one.cost <= reach
        return not near, fitted_numbers(kinds[one.effect.kind]) if near else 0

    return sorted(candidates, key=turn)


def fitted_numbers(kind: Kind) -> int:
    """How many numbers of a kind are fitted."""
    return sum(parameter.fitted for parameter in kind.parameters)


def is_enough(best: FittedCandidate, untried: Effect, kinds: Mapping[str, Kind]) -> bool:
    """Whether one explains all, by fewer numbers than the first that was not tried has."""
    fewer = fitted_numbers(kinds[best.effect.kind]) < fitted_numbers(kinds[untried.kind])
    return fewer and chi2_p_value(best.fit) > LIMITS.white_p_value
