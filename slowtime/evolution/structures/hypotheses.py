r"""Probabilities of hypotheses about which elements have changed.

Damage is sparse. Under the hypothesis that the set S has changed, the parameters in S are
:math:`N(0, \sigma_1^2)` and all others :math:`N(0, \sigma_0^2)` with the small
:math:`\sigma_0` of what is always a little off. Each hypothesis has its evidence by Laplace's
method about its own optimum, and the prior odds of so many changes. A Gaussian prior alone
would smear one broken spring over all that look like it; this says "spring 1 or spring 4".
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.evolution.change import check_level

from .fit import Optimum, check_prior, optimise_from, total_misfit
from .measured_modes import MeasuredModes
from .updatable_models import UpdatableModel

_BEAM = 6  # hypotheses of one size from which those of the next are made
_HOPELESS = 12.0  # log-probability below the best at which a hypothesis is not built upon
# [prior standard deviations] Of a single change, from which a search may begin. Source:
# judgement; a search reaches as far as modes do not exchange their shapes.
_SCANNED = tuple(0.25 * k for k in range(-8, 5) if k)
_HALVINGS = 4  # of that step, about the best change: what searches then reach is near
_TOLD = 0.9
_RIVAL = 0.2  # of the probability of the best, from which a hypothesis is told as well


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ChangedParts:
    """One set of changed parts, how probable, and by how much they have changed.

    Parameters
    ----------
    names
        Of the changed parts; none if nothing has changed.
    probability
        Of just this set having changed [1].
    change, sd
        Relative changes of these parts, and their standard deviations [1].
    lo, hi
        Ends of their 95 % intervals [1].
    """

    names: tuple[str, ...]
    probability: float
    change: Float[np.ndarray, " changed"]
    sd: Float[np.ndarray, " changed"]
    lo: Float[np.ndarray, " changed"]
    hi: Float[np.ndarray, " changed"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class NamedChanges:
    """Hypotheses on what has changed, most probable first.

    Parameters
    ----------
    hypotheses
        Of which one is true with near certainty, if the model is.
    inclusion
        Probability of each parameter having changed [1].
    sentence
        For a person.
    """

    hypotheses: tuple[ChangedParts, ...]
    inclusion: dict[str, float]
    sentence: str


def name_changes(
    structure: UpdatableModel,
    measured: MeasuredModes | Sequence[MeasuredModes],
    *,
    changed_sd: Float[np.ndarray, " parameter"] | float = 0.3,
    unchanged_sd: Float[np.ndarray, " parameter"] | float = 0.005,
    changed_share: float = 0.1,
    most: int = 4,
) -> NamedChanges:
    """Find the changed parts, or the parts between which the data cannot decide.

    Parameters
    ----------
    structure, measured
        As for `estimate`.
    changed_sd
        Standard deviation of the logarithm of the factor on a changed part; 0 for a part that
        cannot have changed.
    unchanged_sd
        The same for an unchanged part: how well the nominal model holds.
    changed_share
        Share of the parts expected to have changed [1].
    most
        Largest number of changed parts considered.

    Returns
    -------
    Hypotheses about the changed parts, with their probabilities.
    """
    sets = (measured,) if isinstance(measured, MeasuredModes) else tuple(measured)
    slab = check_prior(structure, changed_sd)
    spike = np.minimum(check_prior(structure, unchanged_sd), slab)
    if not 0.0 < changed_share < 1.0 or most < 1:
        raise ValueError(
            f"changed_share={changed_share}, most={most}. Give a share between 0 and 1, such "
            "as 0.1, and at least one part that may have changed."
        )
    odds = float(np.log(changed_share / (1.0 - changed_share)))

    def weigh(changed: frozenset[int], start: np.ndarray) -> tuple[float, Optimum]:
        sd = np.array([slab[i] if i in changed else spike[i] for i in range(len(slab))])
        found = optimise_from(structure, sets, sd, start)
        return found.log_evidence + odds * len(changed), found

    free = [i for i in range(len(slab)) if slab[i] > spike[i]]
    none = frozenset[int]()
    weighed = {none: weigh(none, np.zeros(len(slab)))}
    layer = [none]
    for _ in range(min(most, len(free))):
        larger: dict[frozenset[int], list[np.ndarray]] = {}
        for base in layer:
            for i in free:
                starts = [weighed[base][1].theta]
                if base == none:
                    starts.append(_likeliest_single(structure, sets, i, slab))
                larger.setdefault(base | {i}, starts)
        fresh = {
            s: max((weigh(s, start) for start in starts), key=lambda pair: pair[0])
            for s, starts in larger.items()
            if s not in weighed
        }
        weighed |= fresh
        best = max(score for score, _ in weighed.values())
        layer = sorted(fresh, key=lambda s: -fresh[s][0])[:_BEAM]
        layer = [s for s in layer if fresh[s][0] > best - _HOPELESS]
    return _conclude(structure, weighed)


def _likeliest_single(
    structure: UpdatableModel,
    sets: Sequence[MeasuredModes],
    which: int,
    slab: Float[np.ndarray, " parameter"],
) -> np.ndarray:
    """Change of one part alone at which the data are likeliest, among a few such changes.

    Where two modes come near each other and exchange their shapes on the way, a search from
    the nominal state ends there; and slight changes of all parts explain some of a change, so
    that none of the one part looks better from there.

    Parameters
    ----------
    structure, sets
        As for `optimise_from`.
    which
        The changed part.
    slab
        Prior standard deviation of each part, if changed [1].
    """
    spread = np.where(np.arange(len(slab)) == which, slab, 0.0)

    def misfit(share: float) -> float:
        gap = total_misfit(structure, sets, share * spread, spread).residual
        return float(gap @ gap)

    left = {share: misfit(share) for share in _SCANNED}
    step = _SCANNED[1] - _SCANNED[0]
    for _ in range(_HALVINGS):
        step, best = step / 2, min(left, key=left.__getitem__)
        left |= {share: misfit(share) for share in (best - step, best + step)}
    return np.asarray(min(left, key=left.__getitem__) * spread)


def _conclude(
    structure: UpdatableModel, weighed: dict[frozenset[int], tuple[float, Optimum]]
) -> NamedChanges:
    ranked = sorted(weighed, key=lambda s: -weighed[s][0])
    scores = np.array([weighed[s][0] for s in ranked])
    weights = np.exp(scores - scores[0])
    weights /= weights.sum()
    hypotheses = [
        _hypothesis(structure, s, float(w), weighed[s][1])
        for s, w in zip(ranked, weights, strict=True)
        if w > 1e-4
    ]
    inclusion = {
        name: float(sum(w for s, w in zip(ranked, weights, strict=True) if i in s))
        for i, name in enumerate(structure.names)
    }
    return NamedChanges(tuple(hypotheses), inclusion, _sentence(hypotheses))


def _hypothesis(
    structure: UpdatableModel, changed: frozenset[int], weight: float, found: Optimum
) -> ChangedParts:
    which = np.array(sorted(changed), dtype=int)
    log, log_sd = found.theta[which], np.sqrt(np.diag(found.covariance))[which]
    half = check_level(0.95) * log_sd
    return ChangedParts(
        tuple(structure.names[i] for i in which),
        weight,
        np.expm1(log),
        np.exp(log) * log_sd,
        np.expm1(log - half),
        np.expm1(log + half),
    )


def _sentence(hypotheses: list[ChangedParts]) -> str:
    best = hypotheses[0]
    rivals = [h for h in hypotheses if h.probability >= _RIVAL * best.probability]
    if best.probability >= _TOLD:
        rivals = [best]
    total = sum(h.probability for h in rivals)
    said = " or ".join(_said(h) for h in rivals)
    if rivals == [best] and not best.names:
        return f"Nothing has changed (probability {total:.0%})."
    return f"{said[0].upper()}{said[1:]} (together probability {total:.0%})."


def _said(hypothesis: ChangedParts) -> str:
    if not hypothesis.names:
        return "nothing"
    each = zip(hypothesis.names, hypothesis.change, hypothesis.sd, strict=True)
    return " and ".join(f"{name} by {100 * c:+.1f} ± {100 * s:.1f} %" for name, c, s in each)
