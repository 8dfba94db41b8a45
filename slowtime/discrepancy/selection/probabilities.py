"""Probabilities of fitted candidates, the verdict that follows, and its rivals."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np
import scipy.special

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.library_fit import Label, label_of
from slowtime.discrepancy.data.screening import Finding
from slowtime.discrepancy.diagnosis import NamedEffect, Number, Rival, Verdict
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, fitted_effect
from slowtime.discrepancy.estimation.occam_factor import leniency
from slowtime.discrepancy.quoting import numbers_of, numbers_of_effect, quoted
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place

MAX_LOCAL_MINIMUM_REST = 0.003
"""[share of what was missing] That a right model leaves at most in a local minimum, as where
friction sticks. Source: docs/decisions/0019."""


MAX_LOCAL_MINIMUM_CHI2 = 100.0
"""[noise variances] That a right model leaves at most in a local minimum. Source: a decision:
ten times the noise is seen by the eye, however much was missing at first."""


def hardly_any(last: Fit, first: Fit) -> bool:
    """Whether a fit leaves hardly any of what the first left beyond the noise."""
    if last.chi2_in_band > MAX_LOCAL_MINIMUM_CHI2:
        return False
    return last.chi2_in_band - 1 < MAX_LOCAL_MINIMUM_REST * (first.chi2_in_band - 1)


def probabilities(scores: Sequence[float], excess: float) -> list[float]:
    """Probabilities of models from their log evidence [nats].

    Log evidence is tempered by `evidence_power` of the thresholds, and by the mean square that
    the best model leaves (`excess`) [noise variances].
    """
    log_odds = np.asarray(scores) * LIMITS.evidence_power / max(excess, 1.0)
    shares: list[float] = scipy.special.softmax(log_odds).tolist()
    return shares


def shares_of(
    found: Sequence[FittedCandidate],
    kinds: Mapping[str, Kind],
    besides: Sequence[float] = (),
    bare: Fit | None = None,
) -> list[float]:
    """Give the probability of each candidate; what is `besides` [nats] takes its share."""
    scores = [n.score + leniency(n, kinds, bare) for n in found]
    return probabilities([*scores, *besides], found[0].fit.chi2_in_band)[: len(scores)]


def answer_of(
    found: Sequence[FittedCandidate], shares: Sequence[float], kinds: Mapping[str, Kind]
) -> NamedEffect:
    """Give the best candidate as an effect, with its parameters and rivals."""
    best = found[0]
    numbers = numbers_of(best.fit, len(best.description.effects) - 1)
    others = [
        Rival(n.effect.kind, n.effect.place, p)
        for n, p in zip(found[1:], shares[1:], strict=True)
    ]
    return name_best(fitted_effect(best), numbers, shares[0], others, kinds)


def name_best(
    effect: Effect,
    numbers: Mapping[str, Number],
    probability: float,
    others: Iterable[Rival],
    kinds: Mapping[str, Kind],
) -> NamedEffect:
    """Name the likeliest effect, with the rivals that are probable enough to be told."""
    told = [rival for rival in others if rival.probability > LIMITS.told_probability]
    return quoted(effect, numbers, kinds[effect.kind], probability, told)


def name_in_combination(
    effect: Effect,
    numbers: Mapping[str, Number],
    models: Iterable[tuple[Collection[Label], float]],
    instead: Callable[[Collection[Label]], Iterable[Label]],
    kinds: Mapping[str, Kind],
) -> NamedEffect:
    """Name one of several effects that were fitted together.

    Its probability is that of all combinations that it is in. `instead` gives the effects of a
    combination without it that are in its stead.
    """
    probability, others = 0.0, dict[Label, float]()
    for labels, share in models:
        if label_of(effect) in labels:
            probability += share
            continue
        for other in instead(labels):
            others[other] = others.get(other, 0.0) + share
    ranked = sorted(others.items(), key=lambda one: -one[1])
    rivals = [Rival(kind, place, share) for (kind, place), share in ranked]
    return name_best(effect, numbers, min(probability, 1.0), rivals, kinds)


def fault_of(
    finding: Finding, given: Description, kinds: Mapping[str, Kind]
) -> NamedEffect | None:
    """Read a finding of the screen as an effect of the sensor."""
    lost = finding.fault in ("stuck", "zero", "missing", "constant")
    name = "sensor_dropout" if lost else "sensor_saturation"
    if name not in kinds or not finding.spans_s:
        return None
    place = Place("sensor", finding.channel)
    first, last = finding.spans_s[0]
    parameters = (
        {"from_s": first, "for_s": last - first, "held": float(finding.fault == "stuck")}
        if lost
        else {p.name: finding.level for p in kinds[name].parameters[:1]}
    )
    ends = finding.instant_sd
    sds = (
        {"from_s": ends, "for_s": math.sqrt(2) * ends}
        if lost
        else dict.fromkeys(parameters, finding.level_sd)
    )
    effect, kind = Effect(name, place, parameters), kinds[name]
    numbers = numbers_of_effect(effect, sds, kind, given)
    return dataclasses.replace(quoted(effect, numbers, kind, 0.99), sentence=finding.sentence)


def verdict_of(answers: Sequence[NamedEffect]) -> Verdict:
    """One word for what was named: physics first."""
    where = {a.effect.place.kind for a in answers}
    if not where <= {"sensor", "input"}:
        return "missing_effect"
    return "sensor_fault" if "sensor" in where else "input_fault"


def rivals_within(
    found: Sequence[FittedCandidate], shares: Sequence[float]
) -> tuple[Rival, ...]:
    """Give the candidates that together hold `undecided_mass` of the probability."""
    return _greater([
        Rival(named.effect.kind, named.effect.place, share)
        for named, share in zip(found, shares, strict=True)
    ])  # fmt: skip


def doubts_about(answer: NamedEffect) -> tuple[Rival, ...]:
    """Give what an answer may be, itself first; nothing where it is decided."""
    if answer.probability >= LIMITS.decided_probability:
        return ()
    own = Rival(answer.effect.kind, answer.effect.place, answer.probability)
    return _greater([own, *answer.rivals])


def first_doubts(answers: Iterable[NamedEffect]) -> tuple[Rival, ...]:
    """Give what the first answer that is not decided may be; nothing where all are."""
    return next((doubts for one in answers if (doubts := doubts_about(one))), ())


def _greater(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    total = sum(rival.probability for rival in rivals)
    known = itertools.accumulate((rival.probability for rival in rivals), initial=0.0)
    enough = LIMITS.undecided_mass * total
    return tuple(r for r, before in zip(rivals, known, strict=False) if before <= enough)
