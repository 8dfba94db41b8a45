"""Proposer: laws that explain the records segment by segment.

Where a law is strong, or one of several, the run without it is soon another motion: what it
leaves, and the force that would make up for that, tell little, and the run with the right law,
begun from there, ends in a minimum of its own. Over a few periods there is one minimum only.
So laws are fitted to a few pieces of each record, where as little moves as still shows that
one is missing, and those that explain these to more, where most moves.
"""

import contextlib
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import (
    Fit,
    FitAbandoned,
    FitControl,
    attempt,
    cut_segments,
    initial_states_of_records,
    shooting_fit,
    strongest_segments,
)
from slowtime.discrepancy.calibration.augmentation import (
    FitStart,
    augmented_start,
    fitted_effects,
)
from slowtime.discrepancy.calibration.fit import referred_to
from slowtime.discrepancy.calibration.levenberg_marquardt import Comparison
from slowtime.discrepancy.candidates.library_fit import (
    Candidate,
    Label,
    is_applicable,
    label_of,
)
from slowtime.discrepancy.candidates.parameter_scan import (
    concatenate_motions,
    effects_of_strength,
    has_strength,
)
from slowtime.discrepancy.estimation.fits_ahead import Attempt, FitsAhead
from slowtime.discrepancy.estimation.switching_instant import refine_switching_instant
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import current_workers
from slowtime.dynamics.effects import Effect, Hidden, Kind, Law, Place, Unmeasured, simple_kinds

from .protocol import Proposal, Round, reached_by_shortlist

FEW_SEGMENTS = 4
"""[segments] Of each record, to which all laws are fitted. Source: docs/decisions/0031."""
MORE_SEGMENTS = 12
"""[segments] Of each record, to which those laws are fitted that explain most of the few.
Source: docs/decisions/0031."""
PLACE_REST_RATIO = 1.5
"""[1] Times what a force at the best place leaves, within which laws are tried at other places.
Source: docs/what_decides.md: half and double change no answer."""
MIN_LAWS_PER_PLACE = 4
"""[laws] Tried first at each of several places. Source: docs/what_decides.md: half and double
change no answer."""
FIRST_LAWS = 8
"""[laws] Tried first, shared by all places. Source: docs/what_decides.md: half and double
change no answer."""
MAX_LAWS = 24
"""[laws] Tried at all places at most. Source: a bound on computing time."""
POWER_SHARES = (0.25, 0.5, 1.0)
"""[share of the power of the loudest segments] Of the few segments, tried in turn, because a
law with inaccurate parameters still moves a structure rightly where little moves. Source:
docs/decisions/0031."""
MIN_QUIET_CHI2 = 10.0
"""[noise variances] Mean square in band that the few segments must leave without a law. Source:
docs/decisions/0031."""
START_FORCE_RATIO = 0.5
"""[1] Force of a law that explains nothing along the recovered motion, at the start of its fit,
over the force recovered there. Source: docs/what_decides.md: half and double change no
answer."""
MAX_REST_OF_FEW = 0.6
"""[share of what the few segments leave without a law] That a law leaves at most to be fitted
to more. Source: docs/decisions/0031."""
MAX_REST_OF_MORE = 0.45
"""[share of what more segments leave without a law] That a law leaves at most to be proposed.
Source: docs/decisions/0031."""
NEAR_RATIO = 2.0
"""[1] Times what the best law leaves, within which another is fitted to more segments, and
fitted to the end. Source: docs/what_decides.md: half and double change no answer."""
MAX_NEAR_LAWS = 3
"""[laws] That are fitted to more segments. Source: docs/decisions/0031."""
SWITCH_SHARES = (0.0, 0.25, 0.5, 0.75)
"""[share of a segment] After which a law that switches starts to do so. Source:
docs/decisions/0031."""
MAX_PROPOSED = 2
"""[laws] That are proposed. Source: a bound on computing time."""

Shoot = Callable[..., tuple[Fit, Sequence[np.ndarray]]]
"""Fits a plant to segments of records, and gives the fit and the first state of each record."""


@dataclasses.dataclass(frozen=True, slots=True)
class Segments:
    """Proposes laws that explain the records segment by segment (multiple shooting).

    Where a law is strong, the run without it is soon another motion, and no force along it says
    what is missing. It is asked twice: before anything was fitted, where no force explains what
    is missing (`only`), and where what was fitted explains little.
    """

    only: bool = False
    name: str = "segments"
    shoot: Shoot = shooting_fit

    def __call__(self, given: Round) -> Proposal:
        """Propose the laws that leave least of the segments, if they leave half at most."""
        nothing = Proposal(self.name, ())
        if given.number or self._is_needless(given):
            return nothing

        def late() -> bool:
            return given.is_late("fitting laws to segments of the records", 0.06)

        if late():
            return nothing
        search = _SegmentSearch(given, late, self.shoot)
        told = attempt(search.best)
        if not told:
            return dataclasses.replace(nothing, only=self.only)
        reach = reached_by_shortlist(given.shortlist)
        # Where the best leaves noise only, what is missing is only that.
        alone = told[0].cost < LIMITS.segment_chi2 * given.before.data
        # A clock is a delay within a segment: whole records may tell more, and are asked, too.
        whole = min((_share_left(one) for one in given.shortlist), default=1.0)
        return Proposal(
            self.name,
            # What is left of segments is no measure for what a law leaves along a force.
            tuple(dataclasses.replace(one, cost=min(one.cost, reach)) for one in told),
            only=self.only and _share_left(told[0]) < whole,
            begins=label_of(told[0].effect),
            shot=tuple(told) if alone else (),
        )

    def _is_needless(self, given: Round) -> bool:
        if self.only:
            if given.has_substitute:
                return True
            least = min((one.cost for one in given.shortlist), default=0.0)
            return least <= LIMITS.far_off_chi2 * given.before.data
        earlier = given.of(self.name)
        if earlier is not None and (earlier.only or earlier.candidates):
            return True  # they were fitted before anything else was
        best = given.best()
        return best is not None and best.chi2_in_band <= LIMITS.far_off_chi2


def _share_left(one: Candidate) -> float:
    """Share of the misfit that a law leaves, of segments or along a force [1]."""
    return one.cost / one.cost_without if one.cost_without > 0.0 else 1.0


class _SegmentSearch:
    """Fits laws to segments of the records of a round, until `is_late`."""

    def __init__(self, given: Round, late: Callable[[], bool], shoot: Shoot) -> None:
        self._shoot = shoot
        self._before, self._tried, self._labels = given.before, given.tried, given.shortlist
        self._located, self._trials, self._kinds = given.localized, given.trials, given.kinds
        self.is_late = late

    def best(self) -> list[Candidate]:
        """Give the laws that leave least, each with what it and the model would leave."""
        found = self._fitted(self._likeliest(), *self._quiet(), MAX_REST_OF_FEW)
        if not found:
            return []
        near = NEAR_RATIO * found[0][0].cost
        some = [one for one, _ in found if one.cost <= near][:MAX_NEAR_LAWS]
        found = self._fitted(some, *self._parts(MORE_SEGMENTS), MAX_REST_OF_MORE)
        return [self._started(one, fit) for one, fit in found[:MAX_PROPOSED]]

    def _likeliest(self) -> list[Candidate]:
        """Give the likeliest laws, those at the best places first."""
        groups = self._located.groups
        most = PLACE_REST_RATIO * groups[0].left
        places = [p for g in groups if g.left <= most for p in g.places]
        at = [[one for one in self._tried if one.effect.place == place] for place in places]
        few = max(MIN_LAWS_PER_PLACE, FIRST_LAWS // len(places))
        likely = itertools.chain.from_iterable(every[:few] for every in at)
        others = itertools.chain.from_iterable(every[few:] for every in at)
        overlooked = itertools.chain.from_iterable(map(self._overlooked, places))
        found: dict[Label, Candidate] = {}
        for one in itertools.chain(self._labels, likely, overlooked, others):
            if len(found) < MAX_LAWS and not _rides(self._kinds[one.effect.kind]):
                found.setdefault(label_of(one.effect), one)
        return list(found.values())

    def _overlooked(self, place: Place) -> Iterator[Candidate]:
        """Give laws that explain nothing along the motion recovered at a place."""
        tried = {one.effect.kind for one in self._tried if one.effect.place == place}
        located, numbers = self._located, range(len(self._located.trials))
        described = located.linear.description
        others = [
            k
            for k in simple_kinds(self._kinds)
            if is_applicable(k, place, described) and has_strength(k)
        ]
        latents = [located.latent(place, i) for i in numbers] if others else []
        for kind in others:
            if kind.name in tried:
                continue
            # Where the recovered motion is not what moved, a law may seem to pull where it
            # pushes.
            laws = list(
                effects_of_strength(
                    kind, place, concatenate_motions([one.motion for one in latents]),
                    np.concatenate([one.force for one in latents]), described,
                    (START_FORCE_RATIO, -START_FORCE_RATIO),
                )
            )  # fmt: skip
            for law in laws[len(laws) // 2 :][:1]:
                yield Candidate(law, math.inf, -math.inf, math.inf)

    def _fitted(
        self, labels: Sequence[Candidate], parts: Sequence[Trial], bare: Fit, most: float
    ) -> list[tuple[Candidate, Fit]]:
        """Fit each law to pieces; give those that explain them, the best first."""
        data = self._before.data
        found: dict[Label, tuple[Candidate, Fit]] = {}
        least = most * bare.cost
        starts = [tuple(_begun(label.effect, parts, self._kinds)) for label in labels]
        tried = tuple(itertools.chain.from_iterable(starts))
        with contextlib.closing(_Shots(self, tried, parts)) as shots:
            for label, own in zip(labels, starts, strict=True):
                fits = shots.take(len(own), least)
                if not fits:
                    continue
                fit = self._switched(min(fits, key=lambda one: one.cost), parts)
                least = min([least, fit.cost, *(one.cost for one in fits)])
                one = dataclasses.replace(
                    label,
                    effect=fitted_effects(fit)[-1],
                    cost=fit.chi2_in_band * data,
                    cost_without=bare.chi2_in_band * data,
                )
                found[label_of(one.effect)] = one, fit
        telling = (
            pair for pair in found.values() if pair[0].cost < most * pair[0].cost_without
        )
        return sorted(telling, key=lambda pair: pair[0].cost)

    def _quiet(self) -> tuple[tuple[Trial, ...], Fit]:
        """Give the quietest few pieces that still tell, and their fit without a law."""
        for share in POWER_SHARES:
            parts, bare = self._parts(FEW_SEGMENTS, share)
            if bare.chi2_in_band > MIN_QUIET_CHI2:
                break
        return parts, bare

    def _parts(self, count: int, share: float = 1.0) -> tuple[tuple[Trial, ...], Fit]:
        parts = strongest_segments(self._before.plant, self._trials, count, share)
        return parts, self._shot(None, parts, FitControl(is_late=self.is_late))

    def shot_with(
        self, effect: Effect, parts: Sequence[Trial], cost_to_beat: float
    ) -> Attempt[Fit | None]:
        """Fit pieces with one more effect, and keep what was compared."""
        compared: list[Comparison] = []
        control = FitControl(cost_to_beat=cost_to_beat, is_late=self.is_late, compared=compared)
        fit = attempt(self._shot, effect, parts, control)
        if fit is None and self.is_late():
            raise FitAbandoned
        return Attempt(fit, tuple(compared))

    def shared_objects(self, parts: Sequence[Trial]) -> tuple[object, ...]:
        """List what fits of pieces refer to, and need not be copied."""
        own = referred_to(self._before, parts)
        return (*own, self._kinds, *self._kinds.values())

    def _shot(self, effect: Effect | None, parts: Sequence[Trial], control: FitControl) -> Fit:
        """Fit pieces, with one more effect or none, from what the model itself claims."""
        before = self._before
        plant = (
            before.plant if effect is None else augmented_start(before, effect, self._kinds)[0]
        )
        values = np.array([entry.value for entry in plant.entries.values()])
        return self._shoot(plant, parts, before.noise, values, control)[0]

    def _switched(self, fit: Fit, parts: Sequence[Trial]) -> Fit:
        """Look for a better instant of a switch, in all pieces."""
        cut, _ = cut_segments(fit.plant, parts)
        return refine_switching_instant(
            fit, cut, self._kinds, None, math.inf, late=self.is_late
        )

    def _started(self, one: Candidate, fit: Fit) -> Candidate:
        """Say where the free run may begin."""
        plant = fit.plant
        values = dict(zip(plant.parameters, fit.values.tolist(), strict=True))
        states = initial_states_of_records(plant, self._trials, self._before.noise, fit.values)
        begun = [dict(zip(plant.state_names, s.tolist(), strict=True)) for s in states]
        constants = {name: value for name, value in values.items() if len(name) == 2}
        return dataclasses.replace(one, start=FitStart(constants, begun, from_segments=True))


class _Shots:
    """Fits of effects to pieces, one after the other; other processes begin the next ones."""

    def __init__(
        self, search: _SegmentSearch, effects: Sequence[Effect], parts: Sequence[Trial]
    ) -> None:
        self._search, self._effects, self._parts = search, effects, parts
        self._count = 0
        self._ahead: FitsAhead[Fit | None] = FitsAhead(
            current_workers(), search.shared_objects(parts)
        )

    def take(self, count: int, least: float) -> list[Fit]:
        """Fit the next few effects; give the fits that ended."""
        found = []
        for number in range(self._count, self._count + count):
            if self._search.is_late():
                raise FitAbandoned
            beat = NEAR_RATIO * least
            for later in range(number, min(number + self._ahead.room, len(self._effects))):
                self._ahead.begin(later, beat, self._attempt(later, beat))
            taken = self._ahead.take(number, beat, self._search.is_late)
            fit = (taken or self._attempt(number, beat)()).fit
            if fit is not None and math.isfinite(fit.cost):
                found.append(fit)
                least = min(least, fit.cost)
        self._count += count
        return found

    def close(self) -> None:
        """End what was begun and is not needed."""
        self._ahead.drop()

    def _attempt(self, number: int, beat: float) -> Callable[[], Attempt[Fit | None]]:
        return functools.partial(
            self._search.shot_with, self._effects[number], self._parts, beat
        )


def _rides(kind: Kind) -> bool:
    """Whether a kind swings by itself: from a new state in each piece, it explains anything."""
    return isinstance(kind.action, Unmeasured) or bool(
        isinstance(kind.action, Hidden) and kind.action.coordinates
    )


def _begun(
    effect: Effect, parts: Sequence[Trial], kinds: Mapping[str, Kind]
) -> Iterator[Effect]:
    """Give an effect with every choice that is not fitted: the motion tells which it is."""
    kind = kinds[effect.kind]
    ways = {p.name: list(p.choices) for p in kind.parameters if p.choices}
    # From afar no fit comes to the right instant of a switch: it is begun all over the pieces.
    for name in kind.action.switches if isinstance(kind.action, Law) else ():
        within = {
            part.start_s + share * part.duration_s for part in parts for share in SWITCH_SHARES
        }
        ways[name] = [effect.parameters[name], *sorted(within)]
    for chosen in itertools.product(*ways.values()):
        parameters = dict(effect.parameters) | dict(zip(ways, chosen, strict=True))
        yield dataclasses.replace(effect, parameters=parameters)
