"""Search among all combinations of simple laws, for free decays.

In a decay, laws follow each other: friction ends what drag begins, and a pendulum's frequency
rises as it calms down. Of laws that are looked for one after the other, the first explains what
several cause, and the next mend that. So all combinations are fitted, and each law has the
probability of all combinations that it is in.
"""

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import scipy.fft
import scipy.special

from slowtime.discrepancy.calibration import Fit, try_refit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.candidates.library_fit import Label
from slowtime.discrepancy.diagnosis import NamedEffect, Rival
from slowtime.discrepancy.estimation.candidate_fit import with_noise_of_best
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, evidence, misfit
from slowtime.discrepancy.estimation.occam_factor import leniency
from slowtime.discrepancy.estimation.significance import is_significant
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import numbers_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.comparison import explains_all
from slowtime.discrepancy.selection.probabilities import name_in_combination
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import OpenJoint, Spring
from slowtime.dynamics.effects import Kind, Place

from .combinations import (
    STIFFNESSES,
    Combination,
    applicable_laws,
    fit_combinations,
    law_sets,
)

MAX_ELEMENTS = 3
"""[elements] Of a structure whose combinations are all tried. Source: a bound on computing
time; each costs about twenty fits."""
MAX_REST = 0.01
"""[share of the variance of the motion] That the best combination leaves at most. Source: a
tenth of the amplitude. What leaves more is looked for among all effects."""
NEGLIGIBLE_REST = 4e-4
"""[share of the variance of the motion] Beyond the noise, that a model which lacks no simple
law may leave. Source: 2 % of the amplitude; few sensors and clocks of rigs are known better."""
MAX_PASSIVE_RATIO = 1.5
"""[1] Of the misfit without negative dampings to that with them. Source: on measured rigs, 1.1
where drag was an imitation, and 2.1 where friction, drag and a bearing acted."""
MAX_MISFIT_RATIO = 0.5
"""[1] Of its misfit to that of the model as given, or of fewer laws. Source: laws of damping
explain less than half only of what is hardly seen."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RankedCombination:
    """A combination of laws with its probability among all that were fitted."""

    combination: Combination
    probability: float

    @property
    def labels(self) -> tuple[Label, ...]:
        """Its laws and their element."""
        return self.combination.labels


def explain_together(
    first: Fit, trials: tuple[Trial, ...], kinds: Mapping[str, Kind], monitor: Monitor
) -> Hypothesis | None:
    """Find the laws of stiffness and damping that records lack together.

    Gives the model with the most probable laws, marked as exhausted where the budget was used
    up before all combinations were fitted. Without effects where it leaves next to nothing, and
    no combination noticeably less. None where nothing is missing, the structure has too many
    elements, or no combination is significant.
    """
    description = first.plant.description
    localized = locate(first, trials)
    own = [one for one in description.elements if not isinstance(one, OpenJoint)]
    few = len(own) <= MAX_ELEMENTS
    if not few or localized.p_value > LIMITS.false_alarm_p_value:
        return None
    places = [Place("element", e.id) for e in own if isinstance(e, Spring)]
    found = [
        one
        for place in places
        for one in fit_combinations(first, trials, place, kinds, monitor)
    ]
    planned = sum(
        1 for place in places for _ in law_sets(applicable_laws(kinds, place, description))
    )
    exhausted = monitor.is_late and len(found) < planned
    ranked = _ranked(first, found, trials, kinds)
    gained = bool(ranked) and _falls(first, ranked[0].combination.last, trials)
    if not (exhausted or gained) and leaves_little(first, trials):
        return Hypothesis(
            fits=(first,), trials=trials, localized=localized, rest=localized, combined=True
        )
    if not ranked:
        return None
    best = ranked[0].combination
    hypothesis = Hypothesis(
        fits=best.fits,
        trials=trials,
        effects=tuple(_answers(best, ranked, kinds)),
        localized=localized,
        fitted=tuple(
            one.combination.fitted for one in ranked if one.combination.fitted is not None
        ),
        combined=True,
        exhausted=exhausted,
    )
    if not explains_all(hypothesis):
        hypothesis = dataclasses.replace(hypothesis, rest=locate(best.last, trials))
    return _with_doubts(hypothesis, ranked)


def explains_most(hypothesis: Hypothesis) -> bool:
    """Return whether laws leave so little that no others are looked for."""
    last, trials = hypothesis.last, hypothesis.trials
    motion = sum(float(np.var(trial.measured, axis=0).sum()) for trial in trials)
    left = sum(float(np.var(residual, axis=0).sum()) for residual in last.residual)
    return _falls(hypothesis.first, last, trials) and left < MAX_REST * motion


def _falls(first: Fit, last: Fit, trials: Sequence[Trial]) -> bool:
    """Whether laws leave a noticeably smaller misfit than the model as given."""
    before, after = (misfit(fit, last.noise, trials) for fit in (first, last))
    return after < MAX_MISFIT_RATIO * before


def leaves_little(fit: Fit, trials: Sequence[Trial]) -> bool:
    """Return whether a model leaves next to nothing of the motion beyond the noise."""
    noise = [fit.noise.sd(i, trial.rate_hz) ** 2 for i, trial in enumerate(trials)]
    left = np.sum([np.var(r, axis=0) - n for r, n in zip(fit.residual, noise, strict=True)], 0)
    moved = np.sum([np.var(trial.measured, axis=0) for trial in trials], axis=0)
    return bool(np.all(left <= NEGLIGIBLE_REST * moved))


def _ranked(
    first: Fit,
    found: Sequence[Combination],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[RankedCombination]:
    """Rank combinations by probability, all judged by the noise that the best leaves."""
    fitted = {
        id(one.fitted.description): one
        for one in found
        if one.fitted is not None and is_significant(one.fitted, trials, kinds)
    }
    scored = sorted(
        (one.fitted for one in fitted.values() if one.fitted), key=lambda one: -one.score
    )
    scored = with_noise_of_best(first, scored, trials, kinds, anew=False)
    if not scored:
        return []
    scored = [_fitted_again(one, scored[0].fit.noise, trials, kinds) for one in scored]
    scored.sort(key=lambda one: -one.score)
    missing = misfit(first, scored[0].fit.noise, trials) - first.data
    scored = _without_idle_laws(
        [(fitted[id(one.description)], one) for one in scored],
        LIMITS.negligible_share * missing,
    )
    shares = _shares(first, scored, trials, kinds)
    ranked = []
    for named, share in zip(scored, shares, strict=True):
        one = fitted[id(named.description)]
        fits = (*one.fits[:-1], named.fit)
        ranked.append(
            RankedCombination(dataclasses.replace(one, fits=fits, fitted=named), share)
        )
    return sorted(ranked, key=lambda one: -one.probability)


def _without_idle_laws(
    combinations: Sequence[tuple[Combination, FittedCandidate]], least: float
) -> list[FittedCandidate]:
    """Leave out combinations that explain hardly more than some of their laws do."""
    # The other laws have to explain a share of all that is missing (`least`), or most of what
    # those laws leave: beside the sine of a pendulum's angle, all that brakes it is little.
    return [
        fit
        for one, fit in combinations
        if not any(
            set(other.laws) < set(one.laws)
            and other.place == one.place
            and 2 * (fewer.cost - fit.fit.cost) < least
            and fit.fit.cost > MAX_MISFIT_RATIO * fewer.cost
            for other, fewer in ((other, found.fit) for other, found in combinations)
        )
    ]


def _fitted_again(
    one: FittedCandidate, noise: Noise, trials: Sequence[Trial], kinds: Mapping[str, Kind]
) -> FittedCandidate:
    """Fit a combination on from where it is: under another noise it has another minimum."""
    fit = try_refit(
        one.fit.plant, trials, noise=noise, values=one.fit.values, states=one.fit.states,
        horizons=(1.0,),
    )  # fmt: skip
    best = one.fit if fit is None or fit.cost >= one.fit.cost else fit
    passive = _without_negative_damping(best, trials)
    if passive is one.fit:
        return one
    return dataclasses.replace(one, fit=passive, score=evidence(passive, kinds))


def _without_negative_damping(fit: Fit, trials: Sequence[Trial]) -> Fit:
    """Hold viscous dampings at zero that came out negative: nothing here feeds motion."""
    # Drag and a negative damping together imitate friction that varies a little. Where the fit
    # is much worse without it, all laws together are the law of the damping, and it stays.
    names = list(fit.plant.entries)
    negative = [
        name for name, value in zip(names, fit.values, strict=True)
        if name[0] == "damping" and value < 0 and name in fit.prior.names
    ]  # fmt: skip
    if not negative:
        return fit
    values = fit.values.copy()
    values[[names.index(name) for name in negative]] = 0.0
    held = try_refit(
        fit.plant, trials, noise=fit.noise, values=values, states=fit.states,
        free=[name for name in fit.prior.names if name not in negative],
    )  # fmt: skip
    return fit if held is None or held.cost > MAX_PASSIVE_RATIO * fit.cost else held


def _shares(
    first: Fit,
    scored: Sequence[FittedCandidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[float]:
    """Probability of each combination."""
    # What the noise model cannot be trusted in tempers the likelihood, and so does what is left
    # in few lines of the spectrum; what parameters cost depends on neither.
    best = scored[0].fit
    tempered = LIMITS.evidence_power / max(best.chi2_in_band, 1.0)
    tempered *= independent_share(best, trials)
    shares: list[float] = scipy.special.softmax([
        one.score + leniency(one, kinds, first) + (1 - tempered) * one.fit.cost / 2
        for one in scored
    ]).tolist()  # fmt: skip
    return shares


def independent_share(fit: Fit, trials: Sequence[Trial]) -> float:
    r"""Return the share of the samples in band that is independent in what a model leaves.

    Returns
    -------
    :math:`\min(1, 2 (\sum_k S_k)^2 / (n \sum_k S_k^2))` of the periodogram :math:`S_k` of
    the residuals, each over its own mean square, at the :math:`n` lines up to where the
    structure answers: 1 where they are white, less where they are a few tones [1].
    """
    parts = []
    for residual, trial in zip(fit.residual, trials, strict=True):
        hz = scipy.fft.rfftfreq(len(residual), 1 / trial.rate_hz)
        sd = np.std(residual, axis=0)
        lines = np.abs(scipy.fft.rfft(residual / np.where(sd > 0, sd, 1.0), axis=0)) ** 2
        parts.append(lines[(hz > 0) & (hz <= fit.silent_above_hz)].ravel())
    power = np.concatenate(parts)
    if not power.any():
        return 1.0
    return float(min(2 * power.sum() ** 2 / (len(power) * np.square(power).sum()), 1.0))


def _answers(
    best: Combination, ranked: Sequence[RankedCombination], kinds: Mapping[str, Kind]
) -> Iterator[NamedEffect]:
    """Name the laws of the best combination, each with the probability of its own."""
    effects = fitted_effects(best.last)
    models = [(one.labels, one.probability) for one in ranked]
    for number in range(len(effects) - len(best.laws), len(effects)):
        effect = effects[number]

        def instead(
            labels: Collection[Label], *, spring: bool = effect.kind in STIFFNESSES
        ) -> list[Label]:
            return [
                one for one in labels
                if one not in best.labels and (one[0] in STIFFNESSES) == spring
            ]  # fmt: skip

        numbers = numbers_of(best.last, number)
        yield name_in_combination(effect, numbers, models, instead, kinds)


def _with_doubts(hypothesis: Hypothesis, ranked: Sequence[RankedCombination]) -> Hypothesis:
    """Say which laws may be others, or none, and keep two fits that would part them."""
    best = ranked[0].combination
    doubted = [a for a in hypothesis.effects if a.probability < LIMITS.decided_probability]
    rivals = {
        (r.effect, r.place): r
        for answer in doubted
        for r in (
            Rival(answer.effect.kind, answer.effect.place, answer.probability),
            *answer.rivals,
        )
    }
    total: dict[Label, float] = {}
    for one in ranked:
        for label in one.labels:
            total[label] = total.get(label, 0.0) + one.probability
    for label, share in total.items():
        fresh = label[0] not in best.laws and label not in rivals
        if fresh and share > 1 - LIMITS.decided_probability:
            rivals[label] = Rival(*label, share)
    if not rivals:
        return hypothesis
    others = (one.combination for one in ranked[1:])
    other = next(one for one in others if set(one.laws) != set(best.laws))
    pair = tuple(one.fitted for one in (best, other) if one.fitted is not None)
    return dataclasses.replace(hypothesis, undecided=tuple(rivals.values()), pair=pair)
