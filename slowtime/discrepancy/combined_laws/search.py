"""Search among all combinations of simple laws, for free decays.

In a decay, laws follow each other: friction ends what drag begins, and a pendulum's frequency
rises as it calms down. Of laws that are looked for one after the other, the first explains what
several cause, and the next mend that. So all combinations are fitted, and each law has the
probability of all combinations that it is in.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, try_refit
from slowtime.discrepancy.calibration.augmentation import fitted_effects
from slowtime.discrepancy.diagnosis import NamedEffect, Rival
from slowtime.discrepancy.estimation.candidate_fit import (
    FittedCandidate,
    evidence,
    is_significant,
    misfit,
    with_noise_of_best,
)
from slowtime.discrepancy.estimation.occam_factor import leniency
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.discrepancy.localization import locate
from slowtime.discrepancy.noise import Noise
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.quoting import numbers_of, sentence_of
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.comparison import explains_all
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Spring
from slowtime.dynamics.effects import Kind, Place

from .combinations import STIFFNESSES, Combination, fit_combinations

MAX_ELEMENTS = 3
"""[elements] Of a structure whose combinations are all tried. Source: a bound on computing
time; each costs about twenty fits."""
MAX_REST = 0.01
"""[share of the variance of the motion] That the best combination leaves at most. Source:
judgement: a tenth of the amplitude. What leaves more is looked for among all effects."""
MAX_PASSIVE_RATIO = 1.5
"""[1] Of the misfit without negative dampings to that with them. Source: judgement; on measured
rigs, 1.1 where drag was an imitation, and 2.1 where friction, drag and a bearing acted."""
MAX_MISFIT_RATIO = 0.5
"""[1] Of its misfit to that of the model as given. Source: judgement; laws of damping explain
less than half only of what is hardly seen."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """A combination with its probability.

    Parameters
    ----------
    share
        Probability [1].
    """

    one: Combination
    share: float


def explain_together(
    first: Fit, trials: tuple[Trial, ...], kinds: Mapping[str, Kind], monitor: Monitor
) -> Hypothesis | None:
    """Find the laws of stiffness and damping that records lack together.

    Parameters
    ----------
    first
        Fit of the model as given.
    trials
        Records.
    kinds
        Catalogue of effects by name.
    monitor
        Told the stage; says whether the budget is used up.

    Returns
    -------
    The model with the most probable laws; None where nothing is missing, or where the
    structure has too many elements.
    """
    description = first.plant.description
    localized = locate(first, trials)
    few = len(description.elements) <= MAX_ELEMENTS
    if not few or localized.p_value > LIMITS.false_alarm_p_value:
        return None
    found = [
        one
        for element in description.elements
        if isinstance(element, Spring)
        for one in fit_combinations(first, trials, Place("element", element.id), kinds, monitor)
    ]
    ranked = _ranked(first, found, trials, kinds)
    if not ranked:
        return None
    best = ranked[0].one
    hypothesis = Hypothesis(
        fits=best.fits,
        trials=trials,
        effects=tuple(_answers(best, ranked, kinds)),
        localized=localized,
        fitted=tuple(one.one.fitted for one in ranked if one.one.fitted is not None),
        combined=True,
    )
    if not explains_all(hypothesis):
        hypothesis = dataclasses.replace(hypothesis, rest=locate(best.last, trials))
    return _with_doubts(hypothesis, ranked)


def explains_most(hypothesis: Hypothesis) -> bool:
    """Return whether laws leave so little that no others are looked for."""
    first, last, trials = hypothesis.first, hypothesis.last, hypothesis.trials
    before, after = (misfit(fit, last.noise, trials) for fit in (first, last))
    motion = sum(float(np.var(trial.measured, axis=0).sum()) for trial in trials)
    left = sum(float(np.var(residual, axis=0).sum()) for residual in last.residual)
    return after < MAX_MISFIT_RATIO * before and left < MAX_REST * motion


def _ranked(
    first: Fit,
    found: Sequence[Combination],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> list[Shared]:
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
    shares = _shares(first, scored, kinds)
    ranked = []
    for named, share in zip(scored, shares, strict=True):
        one = fitted[id(named.description)]
        fits = (*one.fits[:-1], named.fit)
        ranked.append(Shared(dataclasses.replace(one, fits=fits, fitted=named), share))
    return sorted(ranked, key=lambda one: -one.share)


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
    """Hold viscous dampings at zero that came out negative: nothing here feeds motion.

    Drag and a negative damping together imitate friction that varies a little. Where the fit
    is much worse without it, all laws together are the law of the damping, and it stays.
    """
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
    first: Fit, scored: Sequence[FittedCandidate], kinds: Mapping[str, Kind]
) -> list[float]:
    """Probability of each combination.

    What the noise model cannot be trusted in tempers the likelihood; what parameters cost does
    not depend on it.
    """
    tempered = LIMITS.evidence_power / max(scored[0].fit.chi2_in_band, 1.0)
    evidence = np.array([
        one.score + leniency(one, kinds, first) + (1 - tempered) * one.fit.cost / 2
        for one in scored
    ])  # fmt: skip
    odds = np.exp(evidence - evidence.max())
    return [float(p) for p in odds / odds.sum()]


def _answers(
    best: Combination, ranked: Sequence[Shared], kinds: Mapping[str, Kind]
) -> Iterator[NamedEffect]:
    """Name the laws of the best combination, each with the probability of its own."""
    effects = fitted_effects(best.last)
    given = len(effects) - len(best.laws)
    for number, law in enumerate(best.laws):
        kind, numbers = kinds[law], numbers_of(best.last, given + number)
        yield NamedEffect(
            effect=effects[given + number],
            family=kind.family,
            numbers=numbers,
            probability=_probability(law, best.place, ranked),
            rivals=tuple(_rivals(law, best.place, ranked)),
            sentence=sentence_of(kind, best.place, numbers),
        )


def _probability(law: str, place: Place, ranked: Sequence[Shared]) -> float:
    """Sum the probabilities of the combinations that hold a law at a place."""
    return sum(s.share for s in ranked if law in s.one.laws and s.one.place == place)


def _rivals(law: str, place: Place, ranked: Sequence[Shared]) -> Iterator[Rival]:
    """Give laws that combinations without this one have in its place."""
    without = [s for s in ranked if law not in s.one.laws or s.one.place != place]
    best = ranked[0].one
    others = dict.fromkeys(
        (other, s.one.place) for s in without for other in s.one.laws
        if (other not in best.laws or s.one.place != place)
        and (other in STIFFNESSES) == (law in STIFFNESSES)
    )  # fmt: skip
    for other, at in others:
        share = sum(s.share for s in without if other in s.one.laws and s.one.place == at)
        if share > LIMITS.told_probability:
            yield Rival(other, at, share)


def _with_doubts(hypothesis: Hypothesis, ranked: Sequence[Shared]) -> Hypothesis:
    """Say which laws may be others, or none, and keep two fits that would part them."""
    best = ranked[0].one
    doubted = [a for a in hypothesis.effects if a.probability < LIMITS.decided_probability]
    rivals = {
        (r.effect, r.place): r
        for answer in doubted
        for r in (
            Rival(answer.effect.kind, answer.effect.place, answer.probability),
            *answer.rivals,
        )
    }
    more = dict.fromkeys(
        (law, s.one.place) for s in ranked for law in s.one.laws
        if law not in best.laws and (law, s.one.place) not in rivals
    )  # fmt: skip
    for law, place in more:
        share = _probability(law, place, ranked)
        if share > 1 - LIMITS.decided_probability:
            rivals[law, place] = Rival(law, place, share)
    if not rivals:
        return hypothesis
    other = next(s.one for s in ranked[1:] if set(s.one.laws) != set(best.laws))
    pair = tuple(one.fitted for one in (best, other) if one.fitted is not None)
    return dataclasses.replace(hypothesis, undecided=tuple(rivals.values()), pair=pair)
