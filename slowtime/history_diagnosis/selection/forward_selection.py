"""Forward selection of terms: every law against all others and against no further term."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.history_diagnosis.laws.catalogue import HistoryLaw
from slowtime.history_diagnosis.laws.laplace import (
    LaplaceFit,
    add_variants,
    fit_variants,
    maximize_evidence,
    process_variant,
    process_variants,
)
from slowtime.history_diagnosis.laws.terms import (
    ScreenedHistory,
    Term,
    design,
    gap_variance,
    solve,
)
from slowtime.history_diagnosis.likelihood.evidence import CoefficientPosterior
from slowtime.history_diagnosis.likelihood.whitening import FilterResult

from .grid_scan import GridScan, ScanResult, scan_grid
from .irregular_sawtooth import add_irregular_sawtooth
from .outliers import inlier_mask

_NOTHING_PRIOR = 0.5
"""[probability] Prior that no further term is missing. Source: indifference."""
_FAMILY_WEIGHTS = {"drift": 3.0, "crack": 0.2, "sensor": 0.5}
"""[1] Prior weights of families, 1 if not listed: everything ages, cracks are rare. Source:
docs/what_decides.md: half and double change no answer."""
_SCAN_MARGIN = 9.0
"""[nats] Behind the best result of the scan, beyond which a law is not refined. Source:
docs/what_decides.md: half and double change no answer."""
_REFINED_MARGIN = 7.0
"""[nats] Behind the best refined law, beyond which a law is dropped. Source:
docs/what_decides.md: half and double change no answer."""
_FEWEST_REFINED = 3
"""[laws] Refined in each comparison at least. Source: docs/what_decides.md: half and double
change no answer."""
_MOST_REFINED = 9
"""[laws] Refined in each comparison at most. Source: a bound on computing time."""
_INFLUENTIAL = 3
"""[readings] On which no discovery may depend. Source: docs/what_decides.md: half and double
change no answer."""
_LEAST_WITHOUT = 3.0
"""[nats] That a law must gain without these readings. Source: Kass and Raftery (1995) call 3
nats strong evidence."""
_RESCREENINGS = 2
"""[times] That influential readings are removed. Source: docs/what_decides.md: half and double
change no answer."""
_DISCOVERY = 0.9
"""[probability] That any term is missing, from which one is added. Source: a decision of the
interface."""
_REPLACEMENT = 0.8
"""[probability] Of another law, from which it replaces an earlier term. Source:
docs/what_decides.md: half and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ComparedFit:
    """One candidate for a place in the law, and its probability.

    Parameters
    ----------
    fit
        All terms with the candidate; the terms before it alone for no further term.
    """

    fit: LaplaceFit
    law: HistoryLaw | None
    probability: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RankedLaw:
    """All variants of one law for one covariate."""

    name: str
    covariate: int | None
    probability: float
    best: ComparedFit

    @property
    def key(self) -> tuple[str, int | None]:
        """Name and covariate."""
        return self.name, self.covariate


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ModelComparison:
    """All candidates for one more term, most probable first."""

    options: tuple[ComparedFit, ...]

    @property
    def nothing(self) -> ComparedFit:
        """No further term."""
        return next(option for option in self.options if option.law is None)

    def by_name(self) -> list[RankedLaw]:
        """Return laws, their variants added up, most probable first."""
        found: dict[tuple[str, int | None], list[ComparedFit]] = {}
        for option in self.options:
            if option.law is not None:
                found.setdefault((option.law.name, option.law.covariate), []).append(option)
        laws = [
            RankedLaw(*key, sum(o.probability for o in options), options[0])
            for key, options in found.items()
        ]
        return sorted(laws, key=lambda law: -law.probability)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class SelectionResult:
    """Result of the forward selection.

    Parameters
    ----------
    comparisons
        One for each term of `augmented`: what else could stand in its place.
    last
        The comparison in which no further term was found.
    """

    readings: ScreenedHistory
    nominal: LaplaceFit
    augmented: LaplaceFit
    comparisons: tuple[ModelComparison, ...]
    last: ModelComparison


def select_terms(
    readings: ScreenedHistory,
    laws: tuple[HistoryLaw, ...],
    most: int,
    progress: Callable[[str, float], None],
) -> SelectionResult:
    """Add terms while the evidence demands one, and reconsider earlier terms each time."""
    comparisons: list[ModelComparison] = []
    terms: tuple[Term, ...] = ()
    while True:
        progress("searching", len(terms) / (most + 1.0))
        readings, last = _compare_robustly(readings, laws, terms)
        if len(terms) >= most or last.nothing.probability > 1.0 - _DISCOVERY:
            break
        fit = last.by_name()[0].best.fit
        terms = fit.terms
        comparisons.append(last)
        readings = rescreen(readings, terms, fit)
        if len(terms) > 1:
            terms, comparisons = _reconsider(readings, laws, terms, comparisons)
    progress("fitting", most / (most + 1.0))
    nominal = fit_variants(readings, (), last.nothing.fit.process)
    augmented = last.nothing.fit if terms else nominal
    return SelectionResult(readings, nominal, augmented, tuple(comparisons), last)


def compare_laws(
    readings: ScreenedHistory, laws: tuple[HistoryLaw, ...], before: tuple[Term, ...]
) -> ModelComparison:
    """Compare every law as the next term, and no further term with them."""
    scanned = add_irregular_sawtooth(readings, before, scan_grid(readings, laws, before))
    nothing = fit_variants(readings, before, scanned.process)
    fits: list[tuple[HistoryLaw | None, LaplaceFit]] = [(None, nothing)]
    for result, first in _refine_best(readings, before, scanned):
        fits.append((result.law, _fit_other_variants(readings, before, first)))
    weights = np.array([_log_prior(law, laws) + fit.log_evidence for law, fit in fits])
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    options = [ComparedFit(f, w, float(p)) for (w, f), p in zip(fits, shares, strict=True)]
    return ModelComparison(tuple(sorted(options, key=lambda option: -option.probability)))


def _compare_robustly(
    readings: ScreenedHistory, laws: tuple[HistoryLaw, ...], before: tuple[Term, ...]
) -> tuple[ScreenedHistory, ModelComparison]:
    """Compare laws until the winner does not depend on a few influential readings."""
    found = compare_laws(readings, laws, before)
    # Any law of an uncommon day explains a wrong reading on it. Readings without which the
    # winner is no better than no further term are barred.
    for _ in range(_RESCREENINGS):
        winner = found.options[0]
        if winner.law is None or not winner.law.width:
            break
        nothing = found.nothing.fit
        influential = _influential(readings, nothing, winner.fit)
        without = dataclasses.replace(readings, mask=readings.mask & ~influential)
        base = maximize_evidence(without, before, (), nothing.process)
        still = maximize_evidence(without, before, winner.fit.terms[-1:], winner.fit.process)
        if still.log_evidence - base.log_evidence > _LEAST_WITHOUT:
            break
        readings = dataclasses.replace(without, barred=readings.barred | influential)
        found = compare_laws(readings, laws, before)
    return readings, found


def _influential(
    readings: ScreenedHistory, nothing: LaplaceFit, winner: LaplaceFit
) -> Bool[np.ndarray, " time"]:
    """Mark the few readings that the winner predicts better by the most."""
    known, without = (solve(readings, fit.terms, fit.process) for fit in (winner, nothing))
    gain = _squared_errors(*without) - _squared_errors(*known)
    influential = np.zeros(len(gain), dtype=bool)
    influential[np.argsort(gain)[-_INFLUENTIAL:]] = True
    return influential


def _squared_errors(
    found: CoefficientPosterior, filtered: FilterResult
) -> Float[np.ndarray, " time"]:
    residual: Float[np.ndarray, " time"] = (
        filtered.white[:, 0] - filtered.white[:, 1:] @ found.mean
    )
    return residual**2 / found.noise_variance


def rescreen(
    readings: ScreenedHistory, terms: tuple[Term, ...], fit: LaplaceFit
) -> ScreenedHistory:
    """Screen outliers again with the terms known, and add the noise of covariate gaps."""
    past = readings.past
    columns = design(terms, past.time, past.covariates)
    mask = inlier_mask(past, columns[:, 1:], readings.barred)
    mean = solve(readings, terms, fit.process)[0].mean
    variance = past.sd**2 + gap_variance(terms, past.time, past.covariates, mean)
    return ScreenedHistory(past, mask, variance, readings.barred)


def _reconsider(
    readings: ScreenedHistory,
    laws: tuple[HistoryLaw, ...],
    terms: tuple[Term, ...],
    comparisons: Sequence[ModelComparison],
) -> tuple[tuple[Term, ...], list[ModelComparison]]:
    """Compare all laws again for each earlier term; remove or replace terms accordingly."""
    kept, compared = list(terms), list(comparisons)
    for _ in range(len(terms) - 1):
        old = kept.pop(0)
        del compared[0]
        again = compare_laws(readings, laws, tuple(kept))
        if again.nothing.probability > 0.5:
            continue
        ranked = again.by_name()
        chosen, own = ranked[0], (old.law.name, old.law.covariate)
        if chosen.key != own and chosen.probability < _REPLACEMENT:
            chosen = next((law for law in ranked if law.key == own), chosen)
        kept.append(chosen.best.fit.terms[-1])
        compared.append(again)
    # The latest term comes first now; move it to the end.
    return (*kept[1:], kept[0]), [*compared[1:], compared[0]]


def _refine_best(
    readings: ScreenedHistory, before: tuple[Term, ...], scanned: GridScan
) -> list[tuple[ScanResult, LaplaceFit]]:
    """Refine the best results of a scan once, and drop those far behind."""
    best = scanned.results[0].score
    near = sum(result.score > best - _SCAN_MARGIN for result in scanned.results)
    first = []
    for result in scanned.results[: max(_FEWEST_REFINED, min(near, _MOST_REFINED))]:
        starts = zip(result.terms, result.processes, strict=True)
        fits = [maximize_evidence(readings, before, (term,), start) for term, start in starts]
        first.append((result, max(fits, key=lambda fit: fit.log_evidence)))
    best = max(fit.log_evidence for _, fit in first)
    return [(r, fit) for r, fit in first if fit.log_evidence > best - _REFINED_MARGIN]


def _fit_other_variants(
    readings: ScreenedHistory, before: tuple[Term, ...], first: LaplaceFit
) -> LaplaceFit:
    """Fit a refined term with the other variants of the process, and add their evidence."""
    own = process_variant(first.process)
    others = [
        maximize_evidence(readings, before, first.terms[-1:], process)
        for process in process_variants(first.process)
        if process_variant(process) != own
    ]
    return add_variants([first, *others])


def _log_prior(law: HistoryLaw | None, laws: tuple[HistoryLaw, ...]) -> float:
    """Log prior: even for no further term; families by weight; laws of a family alike."""
    if law is None:
        return float(np.log(_NOTHING_PRIOR))
    # Sorted, because a set of words has another order in each process.
    families = sorted({k.family for k in laws})
    total = sum(_FAMILY_WEIGHTS.get(family, 1.0) for family in families)
    share = _FAMILY_WEIGHTS.get(law.family, 1.0) / total
    members = sum(k.family == law.family for k in laws)
    return float(np.log((1.0 - _NOTHING_PRIOR) * share / members))
