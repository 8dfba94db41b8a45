"""Labels further down the list in; the next, and those whose free run comes nearest, out.

Along a motion that was recovered the right law may stand far down: where sensors are few the
motion at its place is guessed, and where it is strong the motion is none that a linear model
would make. Its free run, from where its force has put all else, still comes nearer than others.
Where even the best leaves much, so may that of a law as strong as its free run wants it, or of
one which the bent constants stand for: it is refitted if it comes about as near, before
anything was fitted, as the best of what was. And a law that left little along its force, and
much where it was refitted, is stuck there: it is fitted again from where the model stood. At
last, where all of that has not helped, those come that explain how the records begin.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit
from slowtime.discrepancy.calibration.augmentation import free_run_chi2
from slowtime.discrepancy.candidates.constant_equivalents import equivalent_laws
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.candidates.parameter_scan import is_possible, scale_to_strength
from slowtime.discrepancy.estimation.candidate_fit import FittedCandidate, misfit
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import assemble
from slowtime.dynamics.effects import Effect, Kind, Place, Unmeasured
from slowtime.dynamics.modes import undamped_modes

from .initial_segments import initial_segment_candidates

IN_TURN, NEAREST = 3, 3
"""Labels that are given: the next in turn, and those that come nearest in a free run."""
LEAVES, MOST = 1.5, 0.6
"""Mean square over the noise, in band, and share of that without any law, from which one goes
further down: what explains more may be one of two laws, and the other is looked for first."""
AS_NEAR, LESS = 2.0, 0.8
"""Times what the best leaves, and share of what there was, within which the free run of a law
has to come to be refitted all the same, where the best leaves much."""
STUCK, AGAIN = 10.0, 2
"""Times what a law leaves along its force, from which its refit is stuck; how many such laws
are fitted again, of those that explained no less along the force than the best did."""
MUCH, NEXT_TO_ALL = 0.1, 0.01
"""Share of what the model leaves of how records begin, beyond the noise, that a law may leave
which explains it; and one that leaves more than noise."""
SCALED, TENFOLD, HALF_TEN = 8, (-1.5, 4.1), 0.5
"""Labels whose strength is looked for by free runs, those at the best place first; from how
many powers of ten beside the one along the force, to how many, in which steps: where the motion
was guessed wrongly, a force of the third power is wrong three times as much."""


class LowerRanked:
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
    best, near
        Where a force explains most, whatever its course; and where about as much.
    several
        Whether no force at one place does it: then only what comes near is given.
    shaken
        Whether the base may have moved: what rides lightly on a node swings as that makes it.
    late
        Once true, no more laws are tried on how the records begin.
    """

    def __init__(
        self,
        bent: Fit,
        before: Fit,
        tried: Sequence[Candidate],
        labels: Sequence[Candidate],
        trials: Sequence[Trial],
        kinds: Mapping[str, Kind],
        *,
        best: Sequence[Place] = (),
        near: Sequence[Place] = (),
        several: bool = False,
        shaken: bool = False,
        late: Callable[[], bool] = bool,
    ) -> None:
        done = {label_of(one.effect) for one in labels}
        self._rest = [
            one
            for one in tried
            if label_of(one.effect) not in done
            and one.start is not None
            and not isinstance(kinds[one.effect.kind].action, Unmeasured)
        ]
        self._labels, self._tried, self._several = labels, tried, several
        self._best, self._near_best = best, near
        self._bent, self._before, self._trials, self._kinds = bent, before, trials, kinds
        self._shaken, self._late, self._turn = shaken, late, 0
        self.opened: list[Candidate] = []
        self.begins: Label | None = None
        self._near_by: set[Label] = set()

    def __call__(self, found: Sequence[FittedCandidate]) -> list[Candidate]:
        """Give the next labels; none where what was refitted is enough, or they were given."""
        best = min((one.fit for one in found), key=lambda fit: fit.chi2_in_band, default=None)
        least = math.inf if best is None else best.chi2_in_band
        if least < LEAVES:
            return []
        some = best is not None and least < MOST * self._bent.chi2_in_band
        if some and least < LIMITS.far_off_chi2:
            return []
        turns = (self._near, self._begun, self._in_turn)
        for turn in turns[self._turn :]:
            self._turn += 1
            if given := turn(best, found, some=some):
                return given
        return []

    def _near(
        self, best: Fit | None, found: Sequence[FittedCandidate], *, some: bool
    ) -> list[Candidate]:
        """Give what is stuck, and what comes as near by its free run alone."""
        if best is not None and best.chi2_in_band < LIMITS.far_off_chi2:
            return []
        near = self._as_near(best or self._bent)
        self._near_by = {label_of(one.effect) for one in near}
        return [*self._stuck(found), *near]

    def _begun(
        self, best: Fit | None, found: Sequence[FittedCandidate], *, some: bool
    ) -> list[Candidate]:
        """Give what explains how records begin, and what the model itself suggests."""
        if best is not None and best.chi2_in_band < LIMITS.far_off_chi2:
            return []
        if not self._late():
            # What explains some may be right in a minimum of its own, or the first of two; to
            # few sensors several elements are as likely.
            likeliest = [place for place in self._near_best if place.kind == "element"]
            among = likeliest or None if some else None
            opened = initial_segment_candidates(
                self._before, self._trials, self._kinds, self._late, among
            )
            self.begins = self._alone(opened)
            reach = min((one.cost for one in self._labels), default=math.inf)
            self.opened = [
                dataclasses.replace(one, cost=min(one.cost, reach)) for one in opened
            ]
        guessed = [] if self._shaken else self._as_good(self._guessed())
        return [*self.opened, *guessed]

    def _alone(self, opened: Sequence[Candidate]) -> Label | None:
        """Say which law explains how records begin, where one does, and the model not."""
        if not opened:
            return None
        best, noise = opened[0], self._before.data
        most = MUCH if best.cost < WRONG_MODEL_CHI2 * noise else NEXT_TO_ALL
        right = best.cost - noise < most * (best.cost_without - noise)
        return label_of(best.effect) if right else None

    def _in_turn(
        self, best: Fit | None, found: Sequence[FittedCandidate], *, some: bool
    ) -> list[Candidate]:
        """Give the next in turn, and those that come nearest."""
        if some or (self._several and best is not None):
            return []
        batch, others = self._rest[:IN_TURN], self._rest[IN_TURN:]
        batch += sorted(others, key=self._run_with)[:NEAREST]
        equal = self._equivalents()
        both = [one for one in equal if label_of(one.effect) not in self._near_by]
        return [*self._as_good(both), *batch]

    def _stuck(self, found: Sequence[FittedCandidate]) -> list[Candidate]:
        """Give laws that are to be fitted again from where the model stood."""
        known = {label_of(one.effect): one for one in self._labels if one.start is not None}
        done = [
            (known[label_of(one.effect)], one.fit)
            for one in found
            if label_of(one.effect) in known
        ]
        first = min(done, key=lambda one: one[1].chi2_in_band, default=None)
        if first is None:
            return []
        stuck = [
            one
            for one, fit in done
            if one.cost <= first[0].cost and fit.cost > STUCK * one.cost
        ]
        stuck.sort(key=lambda one: one.cost)
        return [dataclasses.replace(one, start=None) for one in stuck[:AGAIN]]

    def _as_near(self, best: Fit) -> list[Candidate]:
        """Give what comes about as near by its free run alone as what was refitted."""
        reached = misfit(best, self._before.noise, self._trials)
        done = {label_of(one.effect) for one in self._labels}
        both = [one for one in self._equivalents() if label_of(one.effect) not in done]
        near = [one for one in [*self._scaled(), *both] if one.cost < AS_NEAR * reached]
        # Of a law and a richer one that come as near, the simpler is tried while there is time.
        return self._as_good(sorted(near, key=lambda one: (self._numbers(one), one.cost)))

    def _numbers(self, one: Candidate) -> int:
        return sum(p.fitted for p in self._kinds[one.effect.kind].parameters)

    def _scaled(self) -> Iterator[Candidate]:
        """Give laws as strong as their free run comes nearest from where the model stood."""
        without = misfit(self._before, self._before.noise, self._trials)
        strong = [one for one in self._tried if self._kinds[one.effect.kind].strength]
        strong.sort(key=lambda one: one.effect.place not in self._best)
        for one in strong[:SCALED]:
            runs = [
                (
                    free_run_chi2(self._before, effect, None, self._trials, self._kinds),
                    i,
                    effect,
                )
                for i, effect in enumerate(self._strengths(one.effect))
            ]
            left, i, effect = min(runs)
            if 0 < i < len(runs) - 1 and left < LESS * without:
                yield dataclasses.replace(one, effect=effect, cost=left, start=None)

    def _strengths(self, effect: Effect) -> list[Effect]:
        kind = self._kinds[effect.kind]
        factors = 10.0 ** np.arange(*TENFOLD, HALF_TEN)
        every = [
            scale_to_strength(kind, effect.parameters, factor) for factor in factors.tolist()
        ]
        described = self._before.plant.description
        return [
            dataclasses.replace(effect, parameters=parameters)
            for parameters in every
            if is_possible(kind, parameters, described, effect.place)
        ]

    def _guessed(self) -> list[Candidate]:
        """Give kinds that begin with what the model tells, each where it explained most."""
        structure = assemble(self._before.plant.description)
        masses = dict(zip(structure.names, np.diag(structure.mass).tolist(), strict=True))
        frequencies = undamped_modes(structure).frequency_hz.tolist()
        nodes = (one for one in reversed(self._tried) if one.effect.place.kind == "node")
        foremost = {one.effect.kind: one for one in nodes}
        return [
            dataclasses.replace(one, effect=Effect(kind, one.effect.place, guess), start=None)
            for kind, one in foremost.items()
            for guess in self._kinds[kind].guesses(masses[one.effect.place.id], frequencies)
        ]

    def _equivalents(self) -> list[Candidate]:
        return equivalent_laws(self._bent, self._trials, self._kinds)[:NEAREST]

    def _as_good(self, others: Sequence[Candidate]) -> list[Candidate]:
        """Let what a free run leaves count for as little as the best leaves along the force."""
        if not self._labels:
            return list(others)
        best = self._labels[0]
        return [
            dataclasses.replace(one, cost=best.cost, cost_without=best.cost_without)
            for one in others
        ]

    def _run_with(self, one: Candidate) -> float:
        return free_run_chi2(self._before, one.effect, one.start, self._trials, self._kinds)
