"""Pairs of laws at one place that together explain the force found there.

Of two laws at one place neither explains much by itself, and the one that explains most alone
need not be one of them. Along the recovered motion all are linear in their strengths, so that
every pair is compared by one matrix of inner products. A tone keeps the frequency that it was
found with, and may have any phase.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.localization import Localization, PlaceGroup
from slowtime.discrepancy.localization.pair_ranking import MIN_DISTINCT_SHARE
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import (
    Effect,
    Friction,
    Hidden,
    Kind,
    Law,
    Place,
    force_along,
    simple_kinds,
)

from .force_space import ForceSpace, ForceSpectra
from .library_fit import (
    Candidate,
    Label,
    acceptable_chi2,
    is_applicable,
    label_of,
    start_with_force,
)
from .parameter_scan import is_possible, scale_to_strength, unit_strength_shapes

MAX_COST_RATIO = 0.5
"""[share of chi squared of the best single law] That a pair may leave. Source:
docs/what_decides.md: half and double change no answer."""
MAX_PAIRS = 2
"""[1] Pairs, and tones, that are proposed. Source: docs/what_decides.md: half and double change
no answer."""
SAME_FORCE = 0.999
"""[1] Correlation from which two forces are one. Source: docs/what_decides.md: half and double
change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Column:
    """Force of one kind of law in one shape at one place."""

    kind: Kind
    parameters: dict[str, float]
    sign: float
    space: ForceSpace

    def force(self, trial: int) -> Float[np.ndarray, " time"]:
        """Force [N] along the motion of one trial, as seen from the group's first place."""
        motion = self.space.latents[trial].motion
        return np.asarray(self.sign * force_along(self.kind, self.parameters, motion))

    def with_strength(self, strength: float) -> "_Column":
        """Multiply the strength."""
        return dataclasses.replace(
            self, parameters=scale_to_strength(self.kind, self.parameters, float(strength))
        )

    @property
    def effect(self) -> Effect | None:
        """The effect; None where its parameters are out of bounds."""
        description = self.space.located.linear.description
        if not is_possible(self.kind, self.parameters, description, self.space.place):
            return None
        return Effect(self.kind.name, self.space.place, self.parameters)


def law_pairs(
    fit: Fit,
    located: Localization,
    tried: Sequence[Candidate],
    reached: Mapping[Label, float],
    kinds: Mapping[str, Kind],
) -> list[tuple[Candidate, Candidate]]:
    """Find pairs of laws that leave less than half of what the best law leaves, best first."""
    group = _best_structural_group(located)
    if not tried or group is None:
        return []
    spaces = _force_spaces(fit, located, group)
    columns = list(_candidate_columns(spaces, located, tried, kinds))
    if not columns:
        return []
    space = columns[0].space
    forces = _force_spectra(columns)
    inner, seen = space.normal_equations(forces)
    heard = np.flatnonzero(np.diag(inner) > MIN_DISTINCT_SHARE * space.power(forces))
    columns, inner, seen = [columns[i] for i in heard], inner[np.ix_(heard, heard)], seen[heard]
    bar = MAX_COST_RATIO * min(reached.get(label_of(one.effect), one.cost) for one in tried)
    least = space.cost_without - bar
    tones = [
        one.effect
        for one in tried
        if kinds[one.effect.kind].quadrature is not None and one.effect.place in spaces
    ]
    both = [
        *_pairs_of_laws(columns, inner, seen, least),
        *_pairs_with_tone(spaces, columns, tones[:MAX_PAIRS], least, kinds),
    ]
    data = sum(2 * lines.residual.size for lines in located.lines)
    found: dict[tuple[Label, ...], tuple[Candidate, Candidate]] = {}
    for gain, pair in sorted(both, key=lambda one: -one[0]):
        effects = [effect for column in pair if (effect := column.effect) is not None]
        key = tuple(label_of(effect) for effect in effects)
        if len(effects) < 2 or key in found:
            continue
        cost = space.cost_without - gain
        numbers = sum(p.fitted for column in pair for p in column.kind.parameters)
        score = -cost / 2 - numbers / 2 * math.log(data)
        made = [forces.sum(axis=1, keepdims=True) for forces in _force_spectra(pair)]
        start = start_with_force(fit, made, space)
        one_of, other_of = (
            Candidate(e, cost, score, space.cost_without, start) for e in effects
        )
        found[key] = one_of, other_of
        if len(found) == MAX_PAIRS:
            break
    return list(found.values())


def _pairs_of_laws(
    columns: Sequence[_Column],
    inner: Float[np.ndarray, "column column"],
    seen: Float[np.ndarray, " column"],
    least: float,
) -> Iterator[tuple[float, tuple[_Column, _Column]]]:
    """Pairs of laws that explain more than the least, the best shapes of each pair."""
    size = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
    across, along = inner / np.outer(size, size), seen / size
    own = 1 - np.minimum(across**2, SAME_FORCE)
    first = (along[:, None] - across * along) / own
    gain = first * along[:, None] + first.T * along
    done: set[tuple[object, ...]] = set()
    for i, j in _pairs_by_gain(gain, least):
        one, other = columns[i], columns[j]
        key = (one.kind.name, one.space.place, other.kind.name, other.space.place)
        if one.kind is other.kind or abs(across[i, j]) > math.sqrt(SAME_FORCE) or key in done:
            continue
        both = (
            one.with_strength(first[i, j] / size[i]),
            other.with_strength(first[j, i] / size[j]),
        )
        if any(column.effect is None for column in both):
            continue
        done.add(key)
        yield float(gain[i, j]), both
        if len(done) == MAX_PAIRS:
            return


def _pairs_with_tone(
    spaces: Mapping[Place, tuple[ForceSpace, float]],
    columns: Sequence[_Column],
    tones: Sequence[Effect],
    least: float,
    kinds: Mapping[str, Kind],
) -> Iterator[tuple[float, tuple[_Column, _Column]]]:
    """Find the best law beside each tone of known frequency and unknown phase."""
    space = columns[0].space
    for tone in tones:
        kind = kinds[tone.kind]
        if kind.quadrature is None or kind.strength is None:
            continue
        own, sign = spaces[tone.place]
        turned = [
            _Column(
                kind, {**tone.parameters, kind.strength: 1.0, kind.quadrature: turn}, sign, own
            )
            for turn in (0.0, math.pi / 2)
        ]
        inner, seen = space.normal_equations(_force_spectra([*turned, *columns]))
        square, cross = inner[:2, :2], inner[2:, :2]
        alone = np.linalg.solve(square, seen[:2])
        left = seen[2:] - cross @ alone
        apart = np.linalg.solve(square, cross.T).T
        size = np.diag(inner)[2:] - np.sum(cross * apart, axis=1)
        heard = size > (1 - SAME_FORCE) * np.diag(inner)[2:]
        gains = np.where(heard, left**2 / np.where(heard, size, 1.0), 0.0)
        for best in np.argsort(-gains, kind="stable").tolist():
            gain = float(gains[best] + seen[:2] @ alone)
            if gain <= least:
                break
            strength = float(left[best] / max(size[best], np.finfo(float).tiny))
            law, quarters = (
                columns[best].with_strength(strength),
                alone - strength * apart[best],
            )
            if not heard[best] or law.kind is kind or law.effect is None:
                continue
            heights = {
                kind.strength: float(np.hypot(*quarters)),
                kind.quadrature: float(np.arctan2(quarters[1], quarters[0])),
            }
            whole = {**tone.parameters, **heights}
            yield gain, (dataclasses.replace(turned[0], parameters=whole), law)
            break


def _best_structural_group(located: Localization) -> PlaceGroup | None:
    """Find the best group with an element or node, if it is as good as the best of all."""
    most = min(LIMITS.several_forces_chi2, acceptable_chi2(located.groups[0].left))
    laws = (g for g in located.groups if any(p.kind in ("element", "node") for p in g.places))
    group = next(laws, None)
    return group if group is not None and group.left <= most else None


def _force_spaces(
    fit: Fit, located: Localization, group: PlaceGroup
) -> dict[Place, tuple[ForceSpace, float]]:
    """Force spaces of the elements and nodes of a group, with signs relative to the first."""
    directions = {source.place: source.force for source in located.linear.sources()}
    places = [place for place in group.places if place.kind in ("element", "node")]
    return {
        place: (
            ForceSpace(fit, located, place),
            float(np.sign(directions[place] @ directions[places[0]])),
        )
        for place in places
    }


def _candidate_columns(
    spaces: Mapping[Place, tuple[ForceSpace, float]],
    located: Localization,
    tried: Sequence[Candidate],
    kinds: Mapping[str, Kind],
) -> Iterator[_Column]:
    """Columns of every proportional law, in every shape, at every place of a group."""
    laws = [kind for kind in simple_kinds(kinds) if _is_proportional(kind)]
    for place, (space, sign) in spaces.items():
        for kind in laws:
            if not is_applicable(kind, place, located.linear.description):
                continue
            # Once more as it was fitted alone, since a jump lies between the instants of the
            # scan.
            here = (one.effect for one in tried if label_of(one.effect) == (kind.name, place))
            for parameters in (
                *unit_strength_shapes(kind, space),
                *(dict(e.parameters) for e in here),
            ):
                yield _Column(kind, parameters, sign, space)


def _is_proportional(kind: Kind) -> bool:
    """Whether a kind is a force that is proportional to its strength, and has no phase."""
    action = kind.action
    if kind.strength is None or kind.quadrature is not None:
        return False
    return isinstance(action, Law | Friction) or (
        isinstance(action, Hidden) and not action.coordinates
    )


def _force_spectra(columns: Sequence[_Column]) -> list[ForceSpectra]:
    space = columns[0].space
    return space.lines_of(
        np.stack([column.force(i) for column in columns], axis=1)
        for i in range(len(space.latents))
    )


def _pairs_by_gain(
    gain: Float[np.ndarray, "column column"], least: float
) -> Iterator[tuple[int, int]]:
    """Sort the pairs that explain more than the least, the best first."""
    upper = np.triu(gain, 1)
    rows, others = np.nonzero(upper > max(least, 0.0))
    order = np.argsort(-upper[rows, others], kind="stable")
    yield from zip(rows[order].tolist(), others[order].tolist(), strict=True)
