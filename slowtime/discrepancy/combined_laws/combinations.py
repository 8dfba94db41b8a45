"""Fits of all combinations of a few laws of stiffness and damping at one element."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.discrepancy.candidates.library_fit import Label, is_applicable
from slowtime.discrepancy.candidates.parameter_scan import best_effect
from slowtime.discrepancy.estimation.candidate_fit import fit_candidate
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate
from slowtime.discrepancy.localization import Localization, locate
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Place

STIFFNESSES = ("pendulum_sine", "cubic_softening", "cubic_hardening", "saturating_stiffness")
"""Laws of a spring, of which an element has one at most."""
DAMPINGS = ("quadratic_damping", "coulomb")
"""Laws of damping that act beside each other, and beside the viscous one of the model."""

START_SHARES = (1.0, 0.1, 0.01)
"""[1] Of the strength that the remaining force suggests, from which a law is fitted, until it
leaves no more than its parent. Source: a free run over many periods has a narrow minimum."""

Laws = tuple[str, ...]
"""Kinds of effects in the order in which they were added."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Combination:
    """Several laws at one element, fitted together.

    Parameters
    ----------
    laws
        Kinds of effects, in the order of the effects of the last fit.
    fits
        Of the model as given, and after each law.
    fitted
        The last fit with its log evidence; None without any law.
    """

    laws: Laws
    place: Place
    fits: tuple[Fit, ...]
    fitted: FittedCandidate | None = None

    @property
    def labels(self) -> tuple[Label, ...]:
        """Its laws and their element."""
        return tuple((law, self.place) for law in self.laws)

    @property
    def last(self) -> Fit:
        """Fit with all laws."""
        return self.fits[-1]


def law_sets(known: Sequence[str]) -> Iterator[frozenset[str]]:
    """Give the sets of laws that an element may have, the smaller ones first."""
    springs = [(), *((one,) for one in STIFFNESSES if one in known)]
    dampings = [one for one in DAMPINGS if one in known]
    several = [
        frozenset((*spring, *some))
        for spring in springs
        for count in range(len(dampings) + 1)
        for some in itertools.combinations(dampings, count)
    ]
    return iter(sorted((one for one in several if one), key=len))


def applicable_laws(
    kinds: Mapping[str, Kind], place: Place, description: Description
) -> tuple[str, ...]:
    """Return the kinds that may act at a place: laws of angles need a model of angles."""
    return tuple(n for n, kind in kinds.items() if is_applicable(kind, place, description))


def fit_combinations(
    first: Fit,
    trials: Sequence[Trial],
    place: Place,
    kinds: Mapping[str, Kind],
    monitor: Monitor,
) -> list[Combination]:
    """Fit every set of laws at an element, each from the best set with one law less.

    Sets whose fit breaks down are left out, as are those beyond the budget.
    """
    found = {frozenset[str](): Combination((), place, (first,))}
    located: dict[Laws, Localization] = {}
    for laws in law_sets(applicable_laws(kinds, place, first.plant.description)):
        parents = [found[laws - {law}] for law in laws if laws - {law} in found]
        for parent in sorted(parents, key=lambda one: one.last.cost)[:1]:
            if monitor.is_late:
                break
            (law,) = laws - set(parent.laws)
            monitor(f"refitting {' and '.join(sorted(laws))} at {place}", 0.3)
            if parent.laws not in located:
                located[parent.laws] = locate(parent.last, trials)
            fitted = _grown(parent, law, located[parent.laws], trials, kinds)
            if fitted is not None:
                found[laws] = fitted
    return [one for one in found.values() if one.laws]


def _grown(
    parent: Combination,
    law: str,
    located: Localization,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> Combination | None:
    """Add a law to a combination, from where the force that it leaves suggests."""
    kind = kinds[law]
    found = best_effect(kind, ForceSpace(parent.last, located, parent.place))
    # Where the force that is left suggests none of it, it may still change a long free run.
    none = Effect(law, parent.place, dict.fromkeys(kind.names, 0.0))
    start = found[0] if found else none if len(kind.names) == 1 else None
    best: FittedCandidate | None = None
    if start is None or kind.strength is None:
        return None
    for share in START_SHARES:
        size = share * start.parameters[kind.strength]
        weak = dataclasses.replace(start, parameters={**start.parameters, kind.strength: size})
        named = fit_candidate(parent.last, weak, trials, kinds, parent.last.noise)
        if named is not None and (best is None or named.fit.cost < best.fit.cost):
            best = named
        if best is not None and best.fit.cost <= parent.last.cost:
            break
    if best is None:
        return None
    return Combination((*parent.laws, law), parent.place, (*parent.fits, best.fit), best)
