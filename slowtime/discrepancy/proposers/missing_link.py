"""Recognition of a spring between nodes that no element of the model joins.

Effects sit on what the model has. Two nodes that nothing joins in it may be joined on the rig:
a heavy hidden oscillator on one of them then does nearly the same, or no law does.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration import Fit, FitControl
from slowtime.discrepancy.calibration.augmentation import free_run_chi2, refit_without
from slowtime.discrepancy.calibration.goodness_of_fit import chi2_p_value
from slowtime.discrepancy.calibration.tolerances import refit_within_tolerances
from slowtime.discrepancy.estimation.candidate_fit import fit_candidate
from slowtime.discrepancy.estimation.model_evidence import FittedCandidate, evidence, rescored
from slowtime.discrepancy.estimation.shooting_fit import unexplained_by
from slowtime.discrepancy.hypothesis import Hypothesis, Link, Pair
from slowtime.discrepancy.progress import Monitor
from slowtime.discrepancy.records import Trial
from slowtime.discrepancy.selection.doubts import doubt
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.description import BASE, Description, Spring
from slowtime.dynamics.effects import Effect, Hidden, InputChange, Kind, Place, SensorChange
from slowtime.dynamics.plant import Plant

LINK, LOSS = "a spring not in the model", "stiffness_loss"
"""What the element is called while it is tried; the kind whose negative is its stiffness."""
MAX_LINK_REST = 0.1
"""[share of what was missing] That a spring may leave which takes the place of effects. Source:
chosen on hidden cases."""
START_STIFFNESS_RATIOS = (0.1, 0.03, 0.01, 0.003)
"""[median stiffness of the model's springs] Of a missing spring at the start of its fit: the
one whose free run leaves least. Source: docs/decisions/0030 for the rule; the value is
judgement."""


def with_missing_link(
    found: Hypothesis, first: int, kinds: Mapping[str, Kind], tell: Monitor
) -> Hypothesis:
    """Name a missing spring, where it explains more than a hidden oscillator, or than no law.

    Parameters
    ----------
    first
        Effects that the model had as it was given.
    """
    last = found.last
    if found.final or not found.last_fits_whole_records:
        return found
    for number in range(len(found.effects)):
        latest = number == len(found.effects) - 1 and len(found.fits) == number + 2
        before = found.fits[-2] if latest else None
        link = link_instead_of(last, first + number, before, found.trials, kinds)
        lead = -math.inf if link is None else link.named.score - evidence(last, kinds)
        if lead > LIMITS.least_log_evidence:
            return dataclasses.replace(found, link=link, undecided=(), pair=None)
        if lead > -LIMITS.least_log_evidence and not found.undecided:
            found = doubt(found, number)
    if _explained(found, kinds) or tell.is_late or found.undecided:
        return found
    held = refit_within_tolerances(found.first, found.trials)
    link = best_link(held, None, found.trials, kinds, tell)
    if link is not None and _is_likelier(link.named, found, kinds):
        return dataclasses.replace(found, link=link)
    return found


def _explained(found: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Return whether effects explain all, and none of them can stand for a spring."""
    last = found.last
    explained = last.chi2_in_band < LIMITS.explained_chi2
    explained &= chi2_p_value(last) > LIMITS.coloured_p_value
    # What acts in proportion, two of them or one on a node, may do what one spring does.
    proportional = all(
        isinstance(kinds[one.effect.kind].action, Hidden | SensorChange | InputChange)
        for one in found.effects
    )
    on_node = any(one.effect.place.kind == "node" for one in found.effects)
    return explained and not (proportional and (on_node or len(found.effects) > 1))


def _is_likelier(link: FittedCandidate, found: Hypothesis, kinds: Mapping[str, Kind]) -> bool:
    """Return whether a spring leaves little of what was missing, and is the likelier."""
    first, last = found.first, found.last
    if link.fit.chi2_in_band - 1 > MAX_LINK_REST * (first.chi2_in_band - 1):
        return False
    least = min((link.fit, last), key=unexplained_by)
    others = FittedCandidate(link.effect, last.plant.description, last, 0.0)
    ahead, behind = (rescored(one, least, found.trials, kinds).score for one in (link, others))
    return ahead - behind > LIMITS.least_log_evidence


def link_instead_of(
    fit: Fit,
    number: int,
    before: Fit | None,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
) -> Link | None:
    """Give the best spring from the node of a hidden oscillator, in place of that.

    Parameters
    ----------
    number
        Of the effect in the plant of the fit.
    before
        A fit of the same without it, where there is one.
    """
    effect = fit.plant.effects[number]
    kind = kinds[effect.kind]
    if not isinstance(kind.action, Hidden) or not kind.action.coordinates:
        return None
    pairs = [pair for pair in _unjoined(fit.plant.description) if effect.place.id in pair]
    if effect.place.kind != "node" or not pairs:
        return None
    less = before or refit_without(fit, number, trials, kinds)
    if less is None:
        return None
    known = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    own = np.array([known["effect", number, name] for name in kind.names])
    stiffness = abs(float(kind.action.matrices(own)[2][0, 0]))
    less = dataclasses.replace(less, noise=fit.noise)
    return best_link(less, pairs, trials, kinds, stiffness=stiffness)


def best_link(
    fit: Fit,
    pairs: Iterable[Pair] | None,
    trials: tuple[Trial, ...],
    kinds: Mapping[str, Kind],
    tell: Monitor | None = None,
    stiffness: float = 0.0,
) -> Link | None:
    """Give the spring that, added to the model of a fit, explains most.

    Parameters
    ----------
    fit
        Of the model without it.
    pairs
        Nodes between which one is tried; all that no element joins where not given.
    trials, kinds
        Records, and the catalogue of effects by name.
    tell
        Told what is tried; says whether it is too late for it.
    stiffness
        To start with, in the unit of the model's springs; shares of theirs are tried beside it.

    Returns
    -------
    The spring, its stiffness and standard deviation in that unit; None where no fit succeeds
    or exceeds its standard deviation.
    """
    if LOSS not in kinds:
        return None
    found: list[Link] = []
    for pair in _unjoined(fit.plant.description) if pairs is None else pairs:
        if tell is not None:
            tell(f"trying a spring between {pair[0]} and {pair[1]}", 0.9)
            if tell.is_late:
                break
        link = _linked(fit, pair, stiffness, trials, kinds, found, tell)
        found += [link] if link is not None else []
    return max(found, key=lambda link: link.named.score, default=None)


def _linked(
    fit: Fit,
    pair: Pair,
    stiffness: float,
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
    others: Sequence[Link],
    tell: Monitor | None,
) -> Link | None:
    """Refit a model with a spring more; None where that comes to nothing, or less than none."""
    description = fit.plant.description
    springs = [e.stiffness_n_per_m for e in description.elements if isinstance(e, Spring)]
    median = float(np.median(springs))
    begins = [
        max(stiffness, START_STIFFNESS_RATIOS[0] * median),
        *(share * median for share in START_STIFFNESS_RATIOS[1:]),
    ]
    link = Spring(id=LINK, between=pair)
    linked = dataclasses.replace(description, elements=(*description.elements, link))
    plant = Plant.of(linked, kinds=kinds)
    known = dict(zip(fit.plant.parameters, fit.values.tolist(), strict=True))
    values = np.array([known.get(name, entry.value) for name, entry in plant.entries.items()])
    before = dataclasses.replace(fit, plant=plant, values=values)
    place, strength = Place("element", LINK), kinds[LOSS].names[0]
    effect = min(
        (Effect(LOSS, place, {strength: -begin}) for begin in begins),
        key=lambda one: free_run_chi2(before, one, None, trials, kinds),
    )
    least = min((other.named.fit.cost for other in others), default=None)

    def late() -> bool:
        return tell is not None and tell.is_late

    control = FitControl(cost_to_beat=least, is_late=late)
    named = fit_candidate(before, effect, trials, kinds, fit.noise, control=control)
    if named is None:
        return None
    name = ("effect", len(plant.effects), strength)
    at = named.fit.prior.names.index(name)
    found, sd = -float(named.fit.free[at]), float(named.fit.inflated_sd[at])
    unit = named.fit.plant.entries["stiffness", LINK].unit
    if not (math.isfinite(sd) and found > sd):
        return None
    return Link(pair, found, sd, unit, named)


def _unjoined(description: Description) -> list[Pair]:
    """Nodes, and the base, that no element joins; none of a model with beams or matrices."""
    if not all(isinstance(element, Spring) for element in description.elements):
        return []
    joined = {frozenset(element.between) for element in description.elements}
    nodes = [BASE, *(node.id for node in description.nodes)]
    return [pair for pair in itertools.combinations(nodes, 2) if frozenset(pair) not in joined]
