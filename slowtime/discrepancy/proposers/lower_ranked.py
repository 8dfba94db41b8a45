"""Proposers: laws that stand low in the library's ranking, and come near all the same.

Along a motion that was recovered the right law may stand far down: where sensors are few the
motion at its place is guessed, and where it is strong the motion is none that a linear model
would make. Its free run, from where its force has put all else, still comes nearer than others.
Where even the best leaves much, so may that of a law as strong as its free run wants it, or of
one which the bent constants stand for: it is fitted if it comes about as near, before
anything was fitted, as the best of what was. And a law that left little along its force, and
much where it was fitted, is stuck there: it is fitted again from where the model stood. At
last, where all of that has not helped, those come that explain how the records begin.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from slowtime.discrepancy.calibration import WRONG_MODEL_CHI2, Fit
from slowtime.discrepancy.calibration.augmentation import free_run_chi2
from slowtime.discrepancy.candidates.constant_equivalents import equivalent_laws
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.candidates.parameter_scan import is_possible, scale_to_strength
from slowtime.discrepancy.estimation.model_evidence import misfit
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import assemble
from slowtime.dynamics.effects import Effect, Unmeasured
from slowtime.dynamics.modes import undamped_modes

from .initial_segments import initial_segment_candidates
from .protocol import Proposal, Round, reached_by_shortlist

NEXT_IN_TURN = 3
"""[candidates] Next in the ranking that are proposed. Source: docs/decisions/0019."""
NEAREST_RUNS = 3
"""[candidates] With the nearest free runs that are proposed. Source: docs/decisions/0019."""
MIN_REST_CHI2 = 1.5
"""[noise variances] Mean square in band that the best law leaves, from which the list is
extended. Source: as `explained_chi2` of the thresholds; half and double change no answer of
docs/what_decides.md."""
MAX_EXPLAINED_REST = 0.6
"""[share of the mean square in band without a law] Below which the best law explains some of
it: it may be one of two, and the other is sought first. Source: docs/decisions/0019."""
NEAR_RUN_RATIO = 2.0
"""[1] Times what the best law leaves, within which the free run of another has to come. Source:
docs/decisions/0026."""
MAX_RUN_SHARE = 0.8
"""[share of chi squared without a law] That such a free run leaves at most. Source:
docs/what_decides.md: half and double change no answer."""
STUCK_RATIO = 10.0
"""[1] Times its chi squared along the force, from which the refit of a law is stuck. Source:
docs/what_decides.md: half and double change no answer."""
MAX_REFITTED_AGAIN = 2
"""[laws] That were stuck and are fitted again. Source: docs/decisions/0026."""
MAX_BEGINNING_REST = 0.1
"""[share of what the model leaves of the initial segments beyond noise] That a law leaves at
most which explains them. Source: docs/what_decides.md: half and double change no answer."""
MAX_WRONG_BEGINNING_REST = 0.01
"""[share of what the model leaves of the initial segments beyond noise] The same for a law that
leaves more than noise. Source: docs/what_decides.md: half and double change no answer."""
SCANNED_LAWS = 8
"""[laws] Whose strength is scanned by free runs, those at the best place first. Source:
docs/decisions/0026."""
STRENGTH_DECADES = (-1.5, 4.1)
"""[powers of ten] First and end of the scan, beside the strength along the force: if the
recovered motion is wrong by a factor, a cubic force is wrong by its cube. Source:
docs/decisions/0026."""
STRENGTH_STEP = 0.5
"""[powers of ten] Between the strengths of the scan. Source: docs/decisions/0026 for the rule;
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True)
class NearbyRuns:
    """Proposes laws whose free run comes as near as what was fitted.

    Where sensors are few, the motion at an element is guessed, and the force of the right law
    does not follow it.
    """

    name: str = "nearby runs"

    def __call__(self, given: Round) -> Proposal:
        """Propose fits that are stuck, from another start, and laws that come as near."""
        if not _is_far_off(given):
            return Proposal(self.name, ())
        near = _as_near(given, given.best() or given.hypothesis.last)
        return Proposal(self.name, (*_stuck(given), *near))


@dataclasses.dataclass(frozen=True, slots=True)
class InitialSegments:
    """Proposes laws that explain how each record begins, and what the model itself suggests."""

    name: str = "initial segments"

    def __call__(self, given: Round) -> Proposal:
        """Propose laws that leave least of the first swings of the records."""
        if not _is_far_off(given):
            return Proposal(self.name, ())
        opened: list[Candidate] = []
        begins = None

        def late() -> bool:
            return given.is_late("fitting laws to how the records begin", 0.2)

        if not late():
            # What explains some may be right in a minimum of its own, or the first of two; to
            # few sensors several elements are as likely.
            likeliest = [
                place for place in given.localized.equivalent_places if place.kind == "element"
            ]
            among = likeliest or None if _explains_some(given, given.best()) else None
            opened = initial_segment_candidates(
                given.before, given.trials, given.kinds, late, among
            )
            begins = explains_alone(given, opened)
            reach = reached_by_shortlist(given.shortlist)
            opened = [dataclasses.replace(one, cost=min(one.cost, reach)) for one in opened]
        guessed = [] if given.base_moves else _as_good(given, _guessed(given))
        return Proposal(self.name, (*opened, *guessed), begins=begins, shot=tuple(opened))


@dataclasses.dataclass(frozen=True, slots=True)
class NextInRank:
    """Proposes the next of the library's ranking, and those whose free runs come nearest."""

    name: str = "next in rank"

    def __call__(self, given: Round) -> Proposal:
        """Propose where what was fitted explains next to nothing."""
        best = given.best()
        several = given.localized.groups[0].left > LIMITS.several_forces_chi2
        if (
            not _is_asked(given)
            or _explains_some(given, best)
            or (several and best is not None)
        ):
            return Proposal(self.name, ())
        rest = _not_fitted(given)
        batch, others = rest[:NEXT_IN_TURN], rest[NEXT_IN_TURN:]
        before, trials, kinds = given.before, given.trials, given.kinds
        batch += sorted(
            others, key=lambda one: free_run_chi2(before, one.effect, one.start, trials, kinds)
        )[:NEAREST_RUNS]
        nearby = given.of(NearbyRuns().name)
        # Fits of the shortlist that are repeated from another start are no laws of their own.
        listed = [one.effect for one in given.shortlist]
        near = {
            label_of(one.effect)
            for one in (nearby.candidates if nearby else ())
            if one.effect not in listed
        }
        both = [one for one in _equivalents(given) if label_of(one.effect) not in near]
        return Proposal(self.name, (*_as_good(given, both), *batch))


def _is_asked(given: Round) -> bool:
    """Return whether the best fit leaves so much that the ranking of laws does not count."""
    segments = given.of("segments")
    if given.number or (segments is not None and segments.candidates):
        return False
    best = given.best()
    if best is None:
        return True
    much = best.chi2_in_band >= MIN_REST_CHI2
    return much and not (
        _explains_some(given, best) and best.chi2_in_band < LIMITS.far_off_chi2
    )


def _is_far_off(given: Round) -> bool:
    """Return whether a proposer is asked, and the best fit is still far off."""
    best = given.best()
    return _is_asked(given) and (best is None or best.chi2_in_band >= LIMITS.far_off_chi2)


def _explains_some(given: Round, best: Fit | None) -> bool:
    """Return whether the best fit leaves clearly less than the model without any law."""
    bare = given.hypothesis.last.chi2_in_band
    return best is not None and best.chi2_in_band < MAX_EXPLAINED_REST * bare


def _not_fitted(given: Round) -> list[Candidate]:
    done = {label_of(one.effect) for one in given.shortlist}
    return [
        one
        for one in given.tried
        if label_of(one.effect) not in done
        and one.start is not None
        and not isinstance(given.kinds[one.effect.kind].action, Unmeasured)
    ]


def explains_alone(given: Round, opened: Sequence[Candidate]) -> Label | None:
    """Give the law that explains how records begin, where one does, and the model does not."""
    if not opened:
        return None
    best, noise = opened[0], given.before.data
    most = (
        MAX_BEGINNING_REST if best.cost < WRONG_MODEL_CHI2 * noise else MAX_WRONG_BEGINNING_REST
    )
    right = best.cost - noise < most * (best.cost_without - noise)
    return label_of(best.effect) if right else None


def _stuck(given: Round) -> list[Candidate]:
    """Give laws that are to be fitted again from where the model stood."""
    known = {label_of(one.effect): one for one in given.shortlist if one.start is not None}
    done = [
        (known[label_of(one.effect)], one.fit)
        for one in given.fitted
        if label_of(one.effect) in known
    ]
    first = min(done, key=lambda one: one[1].chi2_in_band, default=None)
    if first is None:
        return []
    stuck = [
        one
        for one, fit in done
        if one.cost <= first[0].cost and fit.cost > STUCK_RATIO * one.cost
    ]
    stuck.sort(key=lambda one: one.cost)
    return [dataclasses.replace(one, start=None) for one in stuck[:MAX_REFITTED_AGAIN]]


def _as_near(given: Round, best: Fit) -> list[Candidate]:
    """Give what comes about as near by its free run alone as what was fitted."""
    reached = misfit(best, given.before.noise, given.trials)
    done = {label_of(one.effect) for one in given.shortlist}
    both = [one for one in _equivalents(given) if label_of(one.effect) not in done]
    near = [one for one in [*_scaled(given), *both] if one.cost < NEAR_RUN_RATIO * reached]

    def simplest(one: Candidate) -> tuple[int, float]:
        return sum(p.fitted for p in given.kinds[one.effect.kind].parameters), one.cost

    # Of a law and a richer one that come as near, the simpler is tried while there is time.
    return _as_good(given, sorted(near, key=simplest))


def _scaled(given: Round) -> Iterator[Candidate]:
    """Give laws as strong as their free run comes nearest from where the model stood."""
    before, trials, kinds = given.before, given.trials, given.kinds
    bare = misfit(before, before.noise, trials)
    here = given.localized.groups[0].places
    strong = [one for one in given.tried if kinds[one.effect.kind].strength]
    strong.sort(key=lambda one: one.effect.place not in here)
    for one in strong[:SCANNED_LAWS]:
        runs = [
            (free_run_chi2(before, effect, None, trials, kinds), i, effect)
            for i, effect in enumerate(_strengths(given, one.effect))
        ]
        left, i, effect = min(runs)
        if 0 < i < len(runs) - 1 and left < MAX_RUN_SHARE * bare:
            yield dataclasses.replace(one, effect=effect, cost=left, start=None)


def _strengths(given: Round, effect: Effect) -> list[Effect]:
    kind = given.kinds[effect.kind]
    factors = 10.0 ** np.arange(*STRENGTH_DECADES, STRENGTH_STEP)
    every = [scale_to_strength(kind, effect.parameters, factor) for factor in factors.tolist()]
    described = given.before.plant.description
    return [
        dataclasses.replace(effect, parameters=parameters)
        for parameters in every
        if is_possible(kind, parameters, described, effect.place)
    ]


def _guessed(given: Round) -> list[Candidate]:
    """Give kinds that begin with what the model tells, each where it explained most."""
    structure = assemble(given.before.plant.description)
    masses = dict(zip(structure.names, np.diag(structure.mass).tolist(), strict=True))
    frequencies = undamped_modes(structure).frequency_hz.tolist()
    nodes = (one for one in reversed(given.tried) if one.effect.place.kind == "node")
    foremost = {one.effect.kind: one for one in nodes}
    return [
        dataclasses.replace(one, effect=Effect(kind, one.effect.place, guess), start=None)
        for kind, one in foremost.items()
        for guess in given.kinds[kind].guesses(masses[one.effect.place.id], frequencies)
    ]


def _equivalents(given: Round) -> list[Candidate]:
    return equivalent_laws(given.hypothesis.last, given.trials, given.kinds)[:NEAREST_RUNS]


def _as_good(given: Round, others: Sequence[Candidate]) -> list[Candidate]:
    """Let what a free run leaves count for as little as the best leaves along the force."""
    if not given.shortlist:
        return list(others)
    best = given.shortlist[0]
    return [
        dataclasses.replace(one, cost=best.cost, cost_without=best.cost_without)
        for one in others
    ]
