"""Where a force was found, in; the two laws that make it together, best at one place, out.

Of two laws at one place neither explains much by itself, and the one that explains most alone
need not be one of them. Along the motion recovered there all are linear in their strengths, so
that every pair of them is compared by the products of their forces with each other.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.effects import Effect, Friction, Hidden, Kind, Law, force_along

from .candidates import SEVERAL, Candidate, can_be, start_with
from .locate import Group, Located
from .refit import Fit
from .shapes import possible, scanned, sized
from .space import HEARD, Forces, Space

BETTER = 0.5
"""Share of what the best law leaves alone that a pair may leave."""
MOST = 2
"""Pairs that are given."""
ALIKE = 0.999
"""Correlation from which two forces are one."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Column:
    """One force: a kind at the place of its space."""

    kind: Kind
    parameters: dict[str, float]
    sign: float
    space: Space

    def force(self, trial: int) -> Float[np.ndarray, " time"]:
        """Along the motion of one trial, in the direction of the group's first place."""
        motion = self.space.latents[trial].motion
        return np.asarray(self.sign * force_along(self.kind, self.parameters, motion))

    def sized(self, strength: float) -> "_Column":
        """Give it a strength."""
        return dataclasses.replace(
            self, parameters=sized(self.kind, self.parameters, float(strength))
        )

    @property
    def effect(self) -> Effect | None:
        """What it is; None where its numbers cannot be such."""
        description = self.space.located.linear.description
        if not possible(self.kind, self.parameters, description, self.space.place):
            return None
        return Effect(self.kind.name, self.space.place, self.parameters)


def pairs(
    fit: Fit, located: Located, tried: Sequence[Candidate], kinds: Mapping[str, Kind]
) -> list[tuple[Candidate, Candidate]]:
    """Give pairs of laws that leave less than half of what the best law leaves; best first.

    The second carries where the free run with both may start from.
    """
    group = located.groups[0]
    if not tried or group.left > SEVERAL:
        return []
    columns = list(_columns(fit, located, group, kinds))
    if len(columns) < 2:
        return []
    space = columns[0].space
    forces = _lines(columns)
    inner, seen = space.normal(forces)
    heard = np.flatnonzero(np.diag(inner) > HEARD * space.power(forces))
    columns, inner, seen = [columns[i] for i in heard], inner[np.ix_(heard, heard)], seen[heard]
    size = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
    across, along = inner / np.outer(size, size), seen / size
    own = 1 - np.minimum(across**2, ALIKE)
    first = (along[:, None] - across * along) / own
    gain = first * along[:, None] + first.T * along
    data = sum(2 * lines.residual.size for lines in located.lines)
    found: dict[tuple[object, ...], tuple[Candidate, Candidate]] = {}
    bar = BETTER * min(one.cost for one in tried)
    for i, j in _best_first(gain, space.bare - bar):
        one, other = columns[i], columns[j]
        label = (one.kind.name, one.space.place, other.kind.name, other.space.place)
        if one.kind is other.kind or abs(across[i, j]) > math.sqrt(ALIKE) or label in found:
            continue
        both = (one.sized(first[i, j] / size[i]), other.sized(first[j, i] / size[j]))
        effects = [effect for column in both if (effect := column.effect) is not None]
        if len(effects) < 2:
            continue
        cost = space.bare - float(gain[i, j])
        numbers = sum(p.fitted for column in both for p in column.kind.parameters)
        score = -cost / 2 - numbers / 2 * math.log(data)
        made = [forces.sum(axis=1, keepdims=True) for forces in _lines(both)]
        start = start_with(fit, made, space)
        one_of, other_of = (Candidate(e, cost, score, space.bare, start) for e in effects)
        found[label] = one_of, other_of
        if len(found) == MOST:
            break
    return list(found.values())


def _columns(
    fit: Fit, located: Located, group: Group, kinds: Mapping[str, Kind]
) -> Iterator[_Column]:
    """Every law that its strength scales, in every shape, at every place of a group."""
    directions = {source.place: source.force for source in located.linear.sources()}
    reference = None
    laws = [kind for kind in kinds.values() if _scales(kind) and can_be(kind, located)]
    for place in group.places:
        own = [kind for kind in laws if kind.where == place.kind]
        if not own or place.kind not in ("element", "node"):
            continue
        space = Space(fit, located, place)
        reference = reference or space
        sign = float(np.sign(directions[place] @ directions[reference.place]))
        for kind in own:
            for parameters in scanned(kind, space):
                yield _Column(kind, parameters, sign, space)


def _scales(kind: Kind) -> bool:
    """Whether a kind is a force that is proportional to its strength, and has no phase."""
    action = kind.action
    if kind.strength is None or kind.quadrature is not None:
        return False
    return isinstance(action, Law | Friction) or (
        isinstance(action, Hidden) and not action.coordinates
    )


def _lines(columns: Sequence[_Column]) -> list[Forces]:
    space = columns[0].space
    return space.lines_of(
        np.stack([column.force(i) for column in columns], axis=1)
        for i in range(len(space.latents))
    )


def _best_first(
    gain: Float[np.ndarray, "column column"], least: float
) -> Iterator[tuple[int, int]]:
    """Pairs that gain more than the least, the best first."""
    upper = np.triu(gain, 1)
    rows, others = np.nonzero(upper > max(least, 0.0))
    order = np.argsort(-upper[rows, others], kind="stable")
    yield from zip(rows[order].tolist(), others[order].tolist(), strict=True)
