"""Selection among laws of an imposed motion by cross-validation over blocks of time.

Every law alone, and pairs of laws of different groups, are fitted to all samples; the likeliest
are fitted again with each quarter of every record left out, and judged by what they leave of
it. Nested laws that explain no more than a simpler one count as that one.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int

from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.selection.probabilities import probabilities
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind
from slowtime.dynamics.effects.library.friction import fallen

from .regression import (
    ForceFit,
    ForceRegression,
    Series,
    applicable_kinds,
    independent_samples,
    log_evidence,
)

FOLDS = 4
"""[blocks] Of each record, contiguous in time. Source: a decision: a quarter of a record holds
a cycle or more, and the last one is the split in time."""
SHORTLIST = 8
"""[laws] That are cross-validated, of those fitted. Source: docs/what_decides.md: half and
double change no answer."""
ALONE = 14
"""[laws] That are fitted alone: those which, unfitted, leave least. Source:
docs/what_decides.md: half and double change no answer."""
PAIRED = 5
"""[laws] That are fitted beside another, likewise. Source: docs/what_decides.md: half and
double change no answer."""
FIRST = 2
"""[laws] Of different groups that others are fitted beside. Source: docs/what_decides.md: half
and double change no answer."""
STARTS = 2
"""[shapes] From which a law is fitted alone. Source: docs/what_decides.md: half and double
change no answer."""
PAIRED_STARTS = 1
"""[shapes] From which a law is fitted beside another. Source: docs/what_decides.md: half and
double change no answer."""
MIN_GAIN = 0.1
"""[share of the root mean square] By which a law has to reduce what is left. Source: a
decision: less is within what differentiated motion and a drifting transducer leave."""
SAME_LAW = 1.0
"""[nats] Of likelihood that a general law gains at most over a simpler one of its family where
it is the same law. Source: the mean gain of two parameters that mean nothing."""
MEMORY = frozenset({"friction", "hysteresis"})
DAMPING = frozenset({"drag", "damping by elongation", "negative damping", "viscoelasticity"})


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ForceModel:
    """One combination of laws, and how well it predicts samples it was not fitted to.

    Parameters
    ----------
    validated
        Residuals of cross-validation, of the samples that tell something [N].
    """

    fit: ForceFit
    validated: Series

    @property
    def names(self) -> frozenset[str]:
        """Kinds of its laws."""
        return frozenset(one.kind for one in self.fit.effects)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals of cross-validation [N]."""
        return float(np.sqrt(np.mean(self.validated**2)))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class LawComparison:
    """Models that were compared.

    Parameters
    ----------
    models
        The one without laws first.
    parents
        Place among the models of the one with a law less that is kept in its stead, or its own.
    """

    models: tuple[ForceModel, ...]
    scores: tuple[float, ...]
    parents: tuple[int, ...]
    count: float

    def shares(self, excess: float, kinds: Mapping[str, Kind]) -> list[float]:
        """Give the probability of each model; 0 for those that count as a simpler one.

        Evidence is divided by `excess`: the mean square on held-out records over that of
        cross-validation.
        """
        shares = probabilities(self.scores, excess)
        into = self._same_laws(self.parents, kinds)
        total = [0.0] * len(shares)
        for number, share in enumerate(shares):
            total[_root(into, number)] += share
        return total

    def _same_laws(self, into: Sequence[int], kinds: Mapping[str, Kind]) -> list[int]:
        """Lead general laws that gain nothing over a simpler one of the family to it."""
        found = list(into)
        for i, general in enumerate(self.models):
            if found[i] != i:
                continue
            simpler = [
                j
                for j, other in enumerate(self.models)
                if found[j] == j
                and other.fit.numbers < general.fit.numbers
                and is_nested(other, general, kinds)
                and self.count * math.log(other.rms / general.rms) < SAME_LAW
            ]
            if simpler:
                found[i] = max(simpler, key=lambda j: self.scores[j])
        return found


def _root(into: Sequence[int], number: int) -> int:
    while into[number] != number:
        number = into[number]
    return number


def is_nested(simple: ForceModel, general: ForceModel, kinds: Mapping[str, Kind]) -> bool:
    """Whether one law of a more general model stands for the one by which a model differs."""
    less, more = simple.names - general.names, general.names - simple.names
    if len(less) != 1 or len(more) != 1:
        return False
    return next(iter(less)) in _contained(next(iter(more)), kinds)


def _contained(name: str, kinds: Mapping[str, Kind]) -> set[str]:
    found: set[str] = set()
    waiting = [name]
    while waiting:
        for one in kinds[waiting.pop()].simpler:
            if one not in found and one in kinds:
                found.add(one)
                waiting.append(one)
    return found


def group_of(kind: Kind) -> str:
    """Return the group of a law; an element has one law of each group at most."""
    if kind.family in MEMORY:
        return "friction"
    return "damping" if kind.family in DAMPING else "stiffness"


def compare(
    regression: ForceRegression,
    description: Description,
    kinds: Mapping[str, Kind],
    monitor: Monitor,
) -> LawComparison:
    """Fit laws alone and in pairs, and cross-validate the likeliest."""
    selection = _Selection(regression, kinds)
    bare = selection.validated(regression.bare())
    assert bare is not None
    monitor("fitting laws to the force", 0.1)
    laws = applicable_kinds(kinds, description)
    singles = selection.extended(bare, laws, ALONE, STARTS)
    best: dict[str, ForceModel] = {}
    for one in sorted(singles, key=lambda one: one.rms):
        best.setdefault(group_of(kinds[one.fit.effects[0].kind]), one)
    pairs: list[ForceModel] = []
    for number, first in enumerate(list(best.values())[:FIRST]):
        monitor("fitting pairs of laws to the force", 0.4 + 0.15 * number)
        tried = {one.names for one in pairs}
        others = [
            kind
            for kind in laws
            if group_of(kind) != group_of(kinds[first.fit.effects[0].kind])
            and first.names | {kind.name} not in tried
        ]
        pairs += selection.extended(first, others, PAIRED, PAIRED_STARTS)
    return _compared([bare, *singles, *pairs])


def _compared(models: Sequence[ForceModel]) -> LawComparison:
    best = min(models, key=lambda one: one.rms)
    count = independent_samples(best.validated)
    scores = [log_evidence(one.fit, one.rms, count) for one in models]
    parents = []
    for i, one in enumerate(models):
        less = [j for j, other in enumerate(models) if other.names < one.names]
        parent = max(less, key=lambda j: scores[j], default=i)
        clear = scores[i] - scores[parent] >= LIMITS.least_log_evidence
        clear = clear and one.rms <= (1 - MIN_GAIN) * models[parent].rms
        parents.append(i if clear else parent)
    return LawComparison(tuple(models), tuple(scores), tuple(parents), count)


class _Selection:
    """Fits and cross-validations on one set of records."""

    def __init__(self, regression: ForceRegression, kinds: Mapping[str, Kind]) -> None:
        self.regression, self.kinds = regression, kinds
        self.motion = regression.motion()
        self.folds = _folds(regression)

    def extended(
        self, first: ForceModel, kinds: Sequence[Kind], most: int, starts: int
    ) -> list[ForceModel]:
        """Add each of some laws to a model; the likeliest, cross-validated."""
        ranked = [self.regression.starts(first.fit, kind, starts) for kind in kinds]
        ranked.sort(key=lambda one: one[0])
        fits = [
            one
            for _, laws in ranked[:most]
            if (one := self.regression.with_one_more(first.fit, laws)) is not None
            and not self.regression.is_at_bound(one)
            and self._is_shown(one.effects[-1])
        ]
        if not fits:
            return []
        used = self.regression.used
        nearest = min(fits, key=lambda one: one.rms)
        count = independent_samples(nearest.left[used])
        fits.sort(key=lambda one: -log_evidence(one, one.rms, count))
        models = [self.validated(one) for one in fits[:SHORTLIST]]
        return [one for one in models if one is not None]

    def validated(self, fit: ForceFit) -> ForceModel | None:
        """Predict each block of time by the laws fitted to the others."""
        used = self.regression.used
        left = fit.left.copy()
        for fold in range(FOLDS):
            out = self.folds == fold
            if not (out & used).any():
                continue
            again = self.regression.fit(fit.effects, fit.centre, ~out, fit.rms)
            if again is None:
                return None
            left[out] = again.left[out]
        return ForceModel(fit, left[used])

    def _is_shown(self, effect: Effect) -> bool:
        """Whether the motion goes through what sets a law apart from a simpler one."""
        kind, told = self.kinds[effect.kind], effect.parameters
        if {"friction_n", "static_n", "vs_m_per_s"} <= set(told) and not fallen(
            told, self.motion
        ):
            return False
        if "presliding_m" in told:
            reach = told["presliding_m"] + told.get("play_m", 0.0)
            if reach > float(np.ptp(self.motion.e)):
                return False
        return kind.shown(told, self.motion)


def _folds(regression: ForceRegression) -> Int[np.ndarray, " time"]:
    """Return the block of time of each sample; blocks have as many informative samples."""
    found = []
    first = 0
    for record in regression.records:
        used = regression.used[first : first + len(record.force)]
        rank = np.cumsum(used) - 1
        found.append(np.clip(rank * FOLDS // max(int(used.sum()), 1), 0, FOLDS - 1))
        first += len(record.force)
    return np.concatenate(found)
