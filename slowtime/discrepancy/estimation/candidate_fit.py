"""Candidates fitted to the free run with all constants of the model."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import (
    WRONG_MODEL_CHI2,
    Fit,
    FitControl,
    attempt,
    refit,
    shooting_fit,
)
from slowtime.discrepancy.calibration.augmentation import (
    FitStart,
    augmented_start,
    carry_effect,
)
from slowtime.discrepancy.calibration.fit import referred_to
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.levenberg_marquardt import DEFAULT_CONTROL, Comparison
from slowtime.discrepancy.candidates.library_fit import Candidate, Label, label_of
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.discrepancy.workers import current_workers
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    InputChange,
    Kind,
    Law,
    SensorChange,
    Unmeasured,
)
from slowtime.dynamics.effects.kind import no_shapes

from .fits_ahead import Attempt, FitsAhead
from .model_evidence import FittedCandidate, evidence, misfit, rescored
from .significance import is_idle, is_shown
from .switching_instant import refine_switching_instant

NESTED = {"stribeck": "coulomb", "extra_dof": "added_mass", "mass_jump": "added_mass"}
"""Laws, and the simpler ones that they become at an end of their range."""
MAX_CANDIDATES = 6
"""[candidates] Refitted in one round at most. Source: docs/decisions/0023."""
MAX_PER_PLACE = 4
"""[candidates] Refitted at one place at most, where there are more than `FEW_PLACES`. Source:
docs/what_decides.md: half and double change no answer."""
MAX_PER_KIND = 2
"""[candidates] Of one kind that are refitted at most. Source: docs/what_decides.md: half and
double change no answer."""
FEW_PLACES = 4
"""[places] Up to which none of the refits is reserved for other places. Source:
docs/decisions/0019 for the rule; docs/what_decides.md for the value: half and double change no
answer."""
RIVAL_COST_RATIO = 5.0
"""[1] Times the chi squared along the force of a candidate that explains all, up to which
others are still refitted. Source: docs/what_decides.md: half and double change no answer."""
RIVAL_COST_SHARE = 0.01
"""[share of chi squared without a law] Along the force, up to which others are still refitted
then. Source: docs/what_decides.md: half and double change no answer."""
MAIN_EFFECT_SHARE = 0.5
"""[share of chi squared without a law] Below which a fit explains the greater part of what is
missing. Source: docs/decisions/0021."""
OTHER_EFFECT_RATIO = 1.5
"""[1] Times what such a fit leaves, from which others are given up along the force: the rest is
the force of another effect. Source: docs/decisions/0021."""
LOCAL_MINIMUM_SHARE = 0.1
"""[share of the mean square in band without a law] Below which the best law, if it leaves more
than noise, may be in a local minimum, and is fitted again to growing parts of the records.
Source: docs/decisions/0021."""
NOISE_UPDATE_SDS = 4.0
"""[standard deviations of chi squared] Of the mean square in band from 1, from which the noise
is estimated again. Source: docs/what_decides.md: half and double change no answer."""
COARSE_HORIZONS = (0.4, 1.0)
"""[share of each record] Fitted one after the other from the motion recovered along the force,
which is close to the minimum. Source: docs/decisions/0017 for the rule; docs/what_decides.md
for the value: half and double change no answer."""
GROWING_HORIZONS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
"""[share of each record] Fitted one after the other from the model without the law. Source:
docs/decisions/0026."""
STICK_SLIP_HORIZONS = (0.02, 0.04, 0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.65, 1.0)
"""[share of each record] Fitted one after the other for friction, from one sticking phase to
the next. Source: docs/decisions/0030 for the rule; docs/what_decides.md for the value: half and
double change no answer."""
GIVE_UP_MARGIN = 40.0
"""[nats; of chi squared 1] Log evidence behind the best from which a candidate is not refitted;
also chi squared that any rival may leave more. Source: docs/what_decides.md: half and double
change no answer."""
GIVE_UP_SHARE = 0.3
"""[share of the range of log evidence] Behind the best, up to which a candidate is refitted in
any case. Source: docs/what_decides.md: half and double change no answer."""
Tick = Callable[[Effect, int], bool | None]
"""Told what is tried next, and the how many-eth it is; says whether it is too late for it."""


def best_of_each_place(
    found: Sequence[Candidate], most: int = MAX_CANDIDATES
) -> list[Candidate]:
    """Choose the best candidates, of several kinds at several places."""
    if not found:
        return []
    kept: list[Candidate] = []
    best = found[0]
    at_one = MAX_PER_PLACE if len({one.effect.place for one in found}) > FEW_PLACES else most
    enough = best.score - max(
        GIVE_UP_MARGIN, GIVE_UP_SHARE * (best.score - found[-1].score), 2 * best.cost
    )
    for one in found:
        if one.score < enough:
            break
        place = sum(k.effect.place == one.effect.place for k in kept)
        kind = sum(k.effect.kind == one.effect.kind for k in kept)
        if place < at_one and kind < MAX_PER_KIND:
            kept.append(one)
        if len(kept) == most:
            break
    return kept


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitSchedule:
    """Where the fit of a candidate starts, and to what it is fitted in turn.

    Parameters
    ----------
    start
        Constants and initial states; as the model without the candidate has them where not
        given.
    horizons
        Growing shares of each record [1], the last of them 1.
    """

    start: FitStart | None = None
    shooting: bool = False
    horizons: Sequence[float] = COARSE_HORIZONS


DEFAULT_SCHEDULE = FitSchedule()


def fit_candidate(
    before: Fit,
    effect: Effect,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    noise: Noise | None,
    *,
    control: FitControl = DEFAULT_CONTROL,
    schedule: FitSchedule = DEFAULT_SCHEDULE,
) -> FittedCandidate | None:
    """Add one effect to the model of a fit, and fit all constants to the free run again.

    It is weighted by the noise of the residual where none is given. Gives None where the fit
    broke down or was abandoned; a law that explains every segment, but no whole record, has the
    fit of `before` and that of the segments.
    """
    plant, values, states = augmented_start(before, effect, kinds, schedule.start)
    description = plant.description
    short: Fit | None = None
    if schedule.shooting:
        # Constants that were bent to do without the effect are no place to start from.
        if schedule.start is None:
            entries = zip(values, plant.entries.items(), strict=True)
            values = np.array([
                v if name[0] == "effect" else entry.value for v, (name, entry) in entries
            ])  # fmt: skip
        own = FitControl(is_late=control.is_late)
        shot = attempt(shooting_fit, plant, trials, before.noise, values, own)
        if shot is None:
            return None
        short, states = shot
        values = short.values
    fit = attempt(
        refit, plant, trials, noise=noise, values=values, states=states,
        horizons=schedule.horizons, control=control,
    )  # fmt: skip
    if fit is not None:
        fit = refine_switching_instant(
            fit, trials, kinds, control.cost_to_beat, MAIN_EFFECT_SHARE * before.chi2_in_band,
            late=control.is_late,
        )  # fmt: skip
    if fit is None:
        if short is None or short.chi2_in_band > WRONG_MODEL_CHI2:
            return None
        # It explains every piece, and runs away from, or loses its way in, a whole record.
        fit = carry_effect(before, effect, kinds)
    if not math.isfinite(fit.cost):
        return None
    return FittedCandidate(effect, description, fit, evidence(fit, kinds), short)


def _growing(candidate: Candidate, kind: Kind, *, shooting: bool) -> tuple[float, ...]:
    """Give the shares of the records to which a law is fitted one after the other."""
    if shooting or (candidate.start is not None and not candidate.start.from_segments):
        return COARSE_HORIZONS
    sticks = candidate.start is not None and isinstance(kind.action, Friction)
    return STICK_SLIP_HORIZONS if sticks else GROWING_HORIZONS


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fitting:
    """Candidates that were fitted to the free run, batch after batch.

    Parameters
    ----------
    tick
        Told which candidate is next, and its number; says whether there is no budget for it.
    late
        Says the same and keeps nothing; `tick` where that keeps nothing either.
    shooting
        Whether each is fitted to segments of the records first: that leads to the right minimum
        where an effect is strong, and costs more.
    idle, nested
        Those of several parameters that do what a simpler one does: of which the motion shows
        what sets them apart, and all.
    noise
        Of the first fit, by which all are compared.
    give_up, reached
        Chi squared along the force above which others are not fitted any more; the least that
        one which explains all has left in its free run.
    """

    before: Fit
    trials: Sequence[Trial]
    kinds: Mapping[str, Kind]
    tick: Tick
    late: Tick | None = None
    shooting: bool = False
    found: tuple[FittedCandidate, ...] = ()
    idle: tuple[FittedCandidate, ...] = ()
    nested: tuple[FittedCandidate, ...] = ()
    noise: Noise | None = None
    count: int = 0
    stopped: bool = False
    give_up: float = math.inf
    reached: float = math.inf

    def fit(self, candidates: Sequence[Candidate]) -> "Fitting":
        """Fit each candidate until there is no budget left."""
        # Once one leaves nothing, others are given up that were far behind it along the force;
        # once one leaves little, others that would leave more.
        fitting, first = self, self.count
        ahead: FitsAhead[FittedCandidate | None] = FitsAhead(
            current_workers(), self._shared_objects()
        )
        try:
            for candidate in candidates:
                if fitting.stopped:
                    break
                fitting._begin_ahead(candidates[fitting.count - first :], ahead)
                fitting = fitting._fit_one(candidate, ahead)
        finally:
            ahead.drop()
        return fitting

    def ranked(self, over: Callable[[], bool] = bool) -> list[FittedCandidate]:
        """Give one fit for each candidate, the best first by the noise that it leaves."""
        found = list(self.found)
        if not any(chi2_p_value(one.fit) > LIMITS.white_p_value for one in found):
            # No simpler law does the same.
            found += [n for n in self.idle if chi2_p_value(n.fit) > LIMITS.white_p_value]
        best: dict[Label, FittedCandidate] = {}
        for one in sorted(found, key=lambda n: -n.score):
            best.setdefault(label_of(one.effect), one)
        # Once it is `over`, the best is left in the minimum in which it is.
        return with_noise_of_best(
            self.before, list(best.values()), self.trials, self.kinds,
            anew=not self.stopped, over=over,
        )  # fmt: skip

    def _begin_ahead(
        self,
        candidates: Sequence[Candidate],
        ahead: "FitsAhead[FittedCandidate | None]",
    ) -> None:
        """Begin to fit the next candidates, once there is a noise to compare them by."""
        if self.noise is None or self.shooting:
            return
        for number, candidate in enumerate(candidates[: ahead.room], self.count):
            action = self.kinds[candidate.effect.kind].action
            # A law that switches is sought near the cost to beat, which is no comparison.
            if self._is_passed_over(candidate) or (isinstance(action, Law) and action.switches):
                continue
            beat = self._cost_to_beat(candidate.effect)
            fit = functools.partial(self._attempt, candidate, number, beat, self.late)
            ahead.begin(number, beat, fit)

    def _shared_objects(self) -> tuple[object, ...]:
        """List what fits refer to, and need not be copied."""
        own = referred_to(self.before, self.trials)
        return (*own, self.noise, self.kinds, *self.kinds.values())

    def _is_passed_over(self, candidate: Candidate) -> bool:
        """Whether a candidate is so far behind along the force that it is not fitted."""
        kind = self.kinds[candidate.effect.kind]
        if isinstance(kind.action, Unmeasured) or candidate.cost > self.give_up:
            return True
        most = RIVAL_COST_RATIO * self.reached + GIVE_UP_MARGIN
        return _straight(kind) and candidate.cost > most

    def _attempt(
        self, candidate: Candidate, number: int, cost_to_beat: float | None, late: Tick | None
    ) -> Attempt[FittedCandidate | None]:
        """Fit a candidate, and keep what was compared with the cost to beat."""
        kind = self.kinds[candidate.effect.kind]
        compared: list[Comparison] = []
        named = fit_candidate(
            self.before,
            candidate.effect,
            self.trials,
            self.kinds,
            self.noise,
            control=FitControl(
                cost_to_beat=cost_to_beat,
                is_late=functools.partial(_late, late or self.tick, candidate.effect, number),
                compared=compared,
            ),
            schedule=FitSchedule(
                start=candidate.start,
                shooting=self.shooting,
                horizons=_growing(candidate, kind, shooting=self.shooting),
            ),
        )
        return Attempt(named, tuple(compared))

    def _fit_one(
        self, candidate: Candidate, ahead: "FitsAhead[FittedCandidate | None]"
    ) -> "Fitting":
        kind, number = self.kinds[candidate.effect.kind], self.count
        seen = dataclasses.replace(self, count=number + 1)
        if self._is_passed_over(candidate):
            return seen
        if self.tick(candidate.effect, number):
            return dataclasses.replace(seen, stopped=True)
        beat, late = self._cost_to_beat(candidate.effect), self.late or self.tick
        attempt = ahead.take(
            number, beat, functools.partial(_late, late, candidate.effect, number)
        ) or self._attempt(candidate, number, beat, self.tick)
        named = attempt.fit
        if named is None:
            return seen
        if seen.noise is None:
            seen = dataclasses.replace(seen, noise=named.fit.noise)
        shown = is_shown(named, self.trials, self.kinds)
        if shown and not is_idle(named, self.kinds):
            return seen._with(candidate, named)
        if len(kind.names) == 1:
            return seen
        idle = (*self.idle, named) if shown else self.idle
        return dataclasses.replace(seen, idle=idle, nested=(*self.nested, named))

    def _cost_to_beat(self, effect: Effect) -> float | None:
        """Cost from which a fit is given up; none where a law that becomes it was fitted."""
        # Whether the more general of two nested laws is needed is told by both fits.
        general = any(limit_of(one.effect) == label_of(effect) for one in self.found)
        return None if general else min((one.fit.cost for one in self.found), default=None)

    def _with(self, candidate: Candidate, named: FittedCandidate) -> "Fitting":
        """Keep a fit, and tighten what others have to leave along the force."""
        kind = self.kinds[candidate.effect.kind]
        give_up, reached = self.give_up, self.reached
        fits = [fit for fit in (named.fit, named.shot) if fit is not None]
        if any(chi2_p_value(fit) > LIMITS.white_p_value for fit in fits):
            little = (
                max(
                    RIVAL_COST_RATIO * candidate.cost, RIVAL_COST_SHARE * candidate.cost_without
                )
                + GIVE_UP_MARGIN
            )
            give_up = min(give_up, little)
            cost = min(fit.cost for fit in fits)
            if (
                not _straight(kind)
                or candidate.cost <= RIVAL_COST_RATIO * cost + GIVE_UP_MARGIN
            ):
                reached = min(reached, cost)  # else what is far off is not told by one step
        else:
            left = misfit(named.fit, self.before.noise, self.trials)
            if left < MAIN_EFFECT_SHARE * candidate.cost_without:
                give_up = min(
                    give_up, OTHER_EFFECT_RATIO * max(left, candidate.cost) + GIVE_UP_MARGIN
                )
        return dataclasses.replace(
            self, found=(*self.found, named), give_up=give_up, reached=reached
        )


def fit_candidates(
    before: Fit,
    candidates: Sequence[Candidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    tick: Tick,
    *,
    shooting: bool = False,
    over: Callable[[], bool] = bool,
) -> list[FittedCandidate]:
    """Fit each candidate to the free run; all judged by the noise that the best leaves."""
    fitting = Fitting(before=before, trials=trials, kinds=kinds, tick=tick, shooting=shooting)
    return fitting.fit(candidates).ranked(over)


def limit_of(effect: Effect) -> Label | None:
    """Give the simpler law that an effect becomes, at its place; None where there is none."""
    simple = NESTED.get(effect.kind)
    return None if simple is None else label_of(dataclasses.replace(effect, kind=simple))


def _late(tick: Tick, effect: Effect, number: int) -> bool:
    return bool(tick(effect, number))


def _straight(kind: Kind) -> bool:
    """Whether what a kind explains along the force is all that its refit will."""
    linear = isinstance(kind.action, Hidden | InputChange | SensorChange)
    return linear and sum(p.fitted for p in kind.parameters) == 1 and kind.shapes is no_shapes


def with_noise_of_best(
    before: Fit,
    found: list[FittedCandidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    *,
    anew: bool,
    over: Callable[[], bool] = bool,
) -> list[FittedCandidate]:
    """Judge all by the noise that the best leaves, where they were fitted to another."""
    if (
        not found
        or abs(found[0].fit.chi2_in_band - 1) < NOISE_UPDATE_SDS * found[0].fit.in_band_sd
    ):
        return found
    best = found[0]
    plant, values, states = best.fit.plant, best.fit.values, best.fit.states
    control = FitControl(is_late=over)
    fit = attempt(
        refit, plant, trials, values=values, states=states, horizons=(1.0,), control=control
    )
    if fit is None:
        return found
    least, most = WRONG_MODEL_CHI2, LOCAL_MINIMUM_SHARE * before.chi2_in_band
    # Far from noise, the best is fitted again from where its model stands.
    if anew and least < fit.chi2_in_band < most:
        # One period off over a long record, the misfit has a minimum too.
        other = attempt(refit, plant, trials, values=fit.values, control=control)
        heard = fit.noise
        if other is not None and misfit(other, heard, trials) < misfit(fit, heard, trials):
            fit = other
    named = dataclasses.replace(best, fit=fit, score=evidence(fit, kinds))
    if not is_shown(named, trials, kinds):
        return with_noise_of_best(before, found[1:], trials, kinds, anew=anew, over=over)
    again = [named, *(rescored(one, fit, trials, kinds) for one in found[1:])]
    return sorted(again, key=lambda n: -n.score)
