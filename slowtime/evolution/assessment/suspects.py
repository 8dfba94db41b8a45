"""Weighed sets of members → for each changed member, the members that it may be."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from .explanations import Explanation

COVERAGE = 0.95
"""Probability [1] that a named set holds the changed member."""


@dataclasses.dataclass(frozen=True, slots=True)
class Suspect:
    """A member that may have changed.

    Parameters
    ----------
    name
        Of the member.
    probability
        Of it being the one of its set [1].
    loss, sd
        Share of its stiffness that it has lost if it is, and the standard deviation [1].
    """

    name: str
    probability: float
    loss: float
    sd: float


@dataclasses.dataclass(frozen=True, slots=True)
class SuspectSet:
    """Members of which one has changed, likeliest first.

    Parameters
    ----------
    suspects
        The smallest number of members of which one has changed with `COVERAGE`.
    """

    suspects: tuple[Suspect, ...]

    @property
    def sentence(self) -> str:
        """What is said of it."""
        said = [
            f"{one.name} has lost {100 * one.loss:.1f} ± {100 * one.sd:.1f} %"
            for one in self.suspects
        ]
        if len(said) == 1:
            return said[0]
        each = zip(said, self.suspects, strict=True)
        return "one of: " + ", or ".join(f"{s} ({one.probability:.0%})" for s, one in each)


def suspect_sets(names: Sequence[str], told: Sequence[Explanation]) -> tuple[SuspectSet, ...]:
    """Find for each changed member those that it may be, over all weighed sets.

    The likeliest set of the likeliest size has a place for each of its members. A member of
    another set takes the place of the one whose change is most like its own.

    Parameters
    ----------
    names
        Of all members.
    told
        Weighed sets, likeliest first.

    Returns
    -------
    Sets, that of the largest loss first.
    """
    weights = _weights(told)
    sizes = np.bincount([len(one.members) for one in told], weights)
    best = next(one for one in told if len(one.members) == int(sizes.argmax()))
    shares = np.zeros((len(best.members), len(names)))
    likeliest: dict[tuple[int, int], tuple[Explanation, int]] = {}
    for one, weight in zip(told, weights.tolist(), strict=True):
        for place, k in _places(best, one):
            shares[place, one.members[k]] += weight
            likeliest.setdefault((place, one.members[k]), (one, k))
    found = []
    for place in np.argsort(-best.loss, kind="stable").tolist():
        share = shares[place] / shares[place].sum()
        order = np.argsort(-share, kind="stable")
        needed = int(np.searchsorted(np.cumsum(share[order]), COVERAGE)) + 1
        suspects = []
        for member in order[:needed].tolist():
            one, k = likeliest[place, member]
            suspects.append(
                Suspect(
                    names[member], float(share[member]), float(one.loss[k]), float(one.sd[k])
                )
            )
        found.append(SuspectSet(tuple(suspects)))
    return tuple(found)


def _places(best: Explanation, one: Explanation) -> list[tuple[int, int]]:
    """Pair members of the best set with those of another, by how alike their changes are."""
    units = best.slope / np.maximum(np.linalg.norm(best.slope, axis=0), 1e-12)
    alike = units[:, [*best.members]].T @ units[:, [*one.members]]
    same = np.equal.outer(best.members, one.members)
    rows, columns = linear_sum_assignment(-(alike + 10.0 * same))
    return [*zip(rows.tolist(), columns.tolist(), strict=True)]


def _weights(told: Sequence[Explanation]) -> Float[np.ndarray, " explanation"]:
    weights = np.exp([one.log_evidence - told[0].log_evidence for one in told])
    return np.asarray(weights / weights.sum())


def inclusion(names: Sequence[str], told: Sequence[Explanation]) -> dict[str, float]:
    """Probability of each member having changed, over all weighed sets.

    Parameters
    ----------
    names
        Of all members.
    told
        Weighed sets, likeliest first.

    Returns
    -------
    Name → probability [1].
    """
    weights = _weights(told)
    found = np.zeros(len(names))
    for one, weight in zip(told, weights, strict=True):
        found[[*one.members]] += weight
    return dict(zip(names, found.tolist(), strict=True))
