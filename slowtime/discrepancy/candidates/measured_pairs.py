r"""Pairs of laws at any places, compared along the motion that the sensors tell by themselves.

Where two strong laws are missing at different places, no force at one place explains what is
left, and the motion recovered with one is wrong. Along the measured motion, all laws at all
places are columns :math:`c_i` of one linear regression of the residual :math:`r`, constants
and initial states eliminated. With :math:`g_i = c_i^T r / |c_i|` and
:math:`\rho = c_i^T c_j / |c_i| |c_j|`, a pair explains

.. math:: \frac{g_i^2 - 2 \rho g_i g_j + g_j^2}{1 - \rho^2} ,

so that thousands of pairs cost one matrix product. One of both is among the best alone: the
stronger. Shapes of the best pairs are refined together.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit, attempt
from slowtime.discrepancy.localization import Localization, measured_motion
from slowtime.discrepancy.localization.pair_ranking import MIN_DISTINCT_SHARE
from slowtime.discrepancy.records import Trial
from slowtime.dynamics.effects import (
    Effect,
    Kind,
    Law,
    force_along,
    general_kinds,
    simple_kinds,
)

from .force_space import ForceSpace, ForceSpectra
from .library_fit import Candidate, Label, is_applicable, start_beside
from .parameter_scan import (
    Shape,
    best_effect,
    effect_forces,
    has_strength,
    is_possible,
    scale_to_strength,
    unit_strength_shapes,
)

FIRST_COLUMNS = 40
"""[columns] The best alone, one of which is in each pair. Source: a bound on computing time."""
SHAPES_OF_FIRST = 3
"""[columns] Of one law at one place among these. Source: as above."""
REFINED_PAIRS = 12
"""[pairs] Whose shapes are refined. Source: a bound on computing time."""
PROPOSED_PAIRS = 3
"""[pairs] That are proposed. Source: a bound on computing time."""
REFINEMENTS = 4
"""[1] Times that steps of shapes are halved. Source: the fit to the free run does the rest."""
SHAPE_STEP = 0.12
"""[1] Relative step of a shape at first. Source: as of a resonance in `parameter_scan`."""
INSTANT_STEP = 0.02
"""[share of the campaign] Step of an instant at first. Source: spacing of scanned instants."""
SAME_FORCE = 0.999
"""[1] Squared correlation from which two forces are one. Source: docs/what_decides.md: half and
double change no answer."""
MAX_COST_RATIO = 0.3
"""[share of chi squared of the best single law] That a pair leaves at most; also one with a law
that contains simpler ones, of the best pair of simple laws. Source: true pairs left 0.01 to
0.2 of that."""
MAX_PAIR_RATIO = 20.0
"""[1] Times chi squared of the best pair, up to which another is proposed. Source: along the
motion the right one leaves least or nearly so."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """Forces of laws at one place, and their products with all else.

    Parameters
    ----------
    cross, taken
        Products with constants and initial states, and these solved for.
    seen, own
        Products with the residual, and with themselves, all else eliminated.
    """

    space: ForceSpace
    laws: Sequence[tuple[Kind, Shape]]
    forces: list[ForceSpectra]
    cross: Float[np.ndarray, "nuisance column"]
    taken: Float[np.ndarray, "nuisance column"]
    seen: Float[np.ndarray, " column"]
    own: Float[np.ndarray, " column"]

    @classmethod
    def of(
        cls, space: ForceSpace, laws: Sequence[tuple[Kind, Shape]], forces: list[ForceSpectra]
    ) -> "_Columns":
        """Eliminate constants and initial states; what they do as well has no length."""
        cross, seen = space.products(forces)
        taken = scipy.linalg.cho_solve(space.factor, cross)
        power = space.power(forces)
        own = power - np.sum(cross * taken, axis=0)
        distinct = own > MIN_DISTINCT_SHARE * np.maximum(power, np.finfo(float).tiny)
        seen = np.where(distinct, seen - cross.T @ space.solved, 0.0)
        return cls(space, laws, forces, cross, taken, seen, np.where(distinct, own, np.inf))

    def only(self, numbers: Sequence[int]) -> "_Columns":
        """Keep some."""
        at = list(numbers)
        return _Columns(
            self.space, [self.laws[i] for i in at], [one[:, at] for one in self.forces],
            self.cross[:, at], self.taken[:, at], self.seen[at], self.own[at],
        )  # fmt: skip

    def products_with(self, other: "_Columns") -> Float[np.ndarray, "column other"]:
        """Products with forces at another place, all else eliminated."""
        found = -self.cross.T @ other.taken
        for one, two, unit, unit2 in zip(
            self.forces, other.forces, self.space.units, other.space.units, strict=True
        ):
            both = np.sum(unit.conj() * unit2, axis=1)
            found += 2 * (one.conj().T @ (both[:, None] * two)).real
        return np.asarray(found)

    def effect(self, number: int, strength: float) -> Effect | None:
        """Give a law as strong as that; None where it is out of bounds."""
        (kind, shape), place = self.laws[number], self.space.place
        parameters = dict(shape)
        if has_strength(kind):
            parameters = scale_to_strength(kind, shape, strength)
        elif kind.quadrature is not None and kind.strength is not None:
            parameters = parameters | {kind.strength: strength * shape[kind.strength]}
        description = self.space.located.linear.description
        if not is_possible(kind, parameters, description, place):
            return None
        return Effect(kind.name, place, parameters)


def measured_pairs(
    fit: Fit, located: Localization, kinds: Mapping[str, Kind]
) -> list[tuple[Candidate, Candidate]]:
    """Find pairs of laws that leave far less than any law alone, the best first."""
    every = list(_columns(fit, located, kinds))
    if not every:
        return []
    without = every[0].space.cost_without
    first = _best_alone(every)
    if not first:
        return []
    single = without - max(_gains(one).max() for one in every)
    pairs = [_refined(pair) for pair in _best_pairs(first, every)]
    pairs.sort(key=lambda pair: -pair.gain)
    data = sum(2 * lines.residual.size for lines in located.lines)
    simple = min((without - pair.gain for pair in pairs if pair.is_simple), default=math.inf)
    found: list[tuple[Candidate, Candidate]] = []
    for pair in pairs:
        effects = pair.effects
        cost = without - pair.gain
        least = MAX_COST_RATIO * (single if pair.is_simple else min(single, simple))
        if effects is None or cost > least:
            continue
        if found and cost > MAX_PAIR_RATIO * found[0][0].cost:
            break
        numbers = sum(p.fitted for one in pair.laws for p in one[0].parameters)
        score = -cost / 2 - numbers / 2 * math.log(data)
        taken = pair.one.cross @ [pair.strengths[0]] + pair.other.cross @ [pair.strengths[1]]
        start = start_beside(fit, taken, pair.one.space)
        one, other = (Candidate(effect, cost, score, without, start) for effect in effects)
        found.append((one, other))
        if len(found) == PROPOSED_PAIRS:
            break
    return found


def act_apart(fit: Fit, trials: Sequence[Trial], kinds: Mapping[str, Kind]) -> bool:
    """Whether two laws at different places explain far more than any law does."""
    located = attempt(measured_motion, fit, trials)
    # One coordinate: its element, its node and its link to the ground move alike.
    if located is None or located.linear.structure.dofs < 2:
        return False
    pairs = attempt(measured_pairs, fit, located, kinds) or []
    return any(one.effect.place != other.effect.place for one, other in pairs[:1])


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _ColumnPair:
    """Two laws, one column each, with the strengths that explain most."""

    one: _Columns
    other: _Columns
    gain: float
    strengths: tuple[float, float]

    @property
    def laws(self) -> tuple[tuple[Kind, Shape], tuple[Kind, Shape]]:
        """Kinds and shapes of both."""
        return self.one.laws[0], self.other.laws[0]

    @property
    def is_simple(self) -> bool:
        """Whether neither law contains a simpler one."""
        return not any(kind.simpler for kind, _ in self.laws)

    @property
    def effects(self) -> tuple[Effect, Effect] | None:
        """Both effects; None where one is out of bounds."""
        one = self.one.effect(0, self.strengths[0])
        other = self.other.effect(0, self.strengths[1])
        return None if one is None or other is None else (one, other)


def _columns(fit: Fit, located: Localization, kinds: Mapping[str, Kind]) -> Iterator[_Columns]:
    """Columns of every law in every shape, place after place."""
    described = located.linear.description
    every = [*simple_kinds(kinds), *general_kinds(kinds)]
    space: ForceSpace | None = None
    for group in located.groups:
        (place,) = group.places
        own = [kind for kind in every if is_applicable(kind, place, described)]
        if place.kind == "base" or not own:
            continue
        if space is None:
            space = ForceSpace(fit, located, place, keeps=True)
        else:
            space = space.elsewhere(place)
        laws: list[tuple[Kind, Shape]] = []
        forces: list[list[ForceSpectra]] = []
        for kind in own:
            shapes, spectra = _shapes_of(kind, space)
            laws += [(kind, shape) for shape in shapes]
            forces += [spectra] if shapes else []
        if laws:
            joined = [np.concatenate(trial, axis=1) for trial in zip(*forces, strict=True)]
            yield _Columns.of(space, laws, joined)


def _shapes_of(kind: Kind, space: ForceSpace) -> tuple[list[Shape], list[ForceSpectra]]:
    """Shapes of a kind, of unit strength where it has one, and their forces."""
    if has_strength(kind) and not kind.simpler:
        shapes: list[Shape] = [*unit_strength_shapes(kind, space)]
        return shapes, _forces_of(kind, shapes, space) if shapes else []
    alone = best_effect(kind, space)
    if alone is None:
        return [], []
    return [alone[0].parameters], space.lines_of(effect_forces(kind, alone[0], space))


def _forces_of(kind: Kind, shapes: Sequence[Shape], space: ForceSpace) -> list[ForceSpectra]:
    return space.lines_of(
        np.array([force_along(kind, shape, latent.motion) for shape in shapes]).T
        for latent in space.latents
    )


def _gains(columns: _Columns) -> Float[np.ndarray, " column"]:
    """Chi squared that each explains alone, if it may."""
    gains = columns.seen**2 / columns.own
    strengths = columns.seen / columns.own
    may = [columns.effect(i, float(s)) is not None for i, s in enumerate(strengths)]
    return np.where(may, gains, 0.0)


def _best_alone(every: Sequence[_Columns]) -> list[_Columns]:
    """Columns that explain most alone, of several shapes of a law few."""
    ranked = sorted(
        (
            (float(gain), block, number)
            for block, columns in enumerate(every)
            for number, gain in enumerate(columns.seen**2 / columns.own)
            if gain > 0
        ),
        reverse=True,
    )
    chosen: list[tuple[int, int]] = []
    count: dict[tuple[int, str], int] = {}
    for _, block, number in ranked:
        key = block, every[block].laws[number][0].name
        if count.get(key, 0) < SHAPES_OF_FIRST and len(chosen) < FIRST_COLUMNS:
            chosen.append((block, number))
            count[key] = count.get(key, 0) + 1
    blocks = sorted({block for block, _ in chosen})
    return [every[b].only([n for block, n in chosen if block == b]) for b in blocks]


def _best_pairs(first: Sequence[_Columns], every: Sequence[_Columns]) -> list[_ColumnPair]:
    """Best shapes of each pair of laws, the best pairs first."""
    best: dict[frozenset[Label], _ColumnPair] = {}
    for one in first:
        for other in every:
            for pair in _pairs_between(one, other):
                both = frozenset(
                    (law[0].name, columns.space.place)
                    for law, columns in zip(pair.laws, (pair.one, pair.other), strict=True)
                )
                known = best.get(both)
                if known is None or pair.gain > known.gain:
                    best[both] = pair
    return sorted(best.values(), key=lambda pair: -pair.gain)[:REFINED_PAIRS]


def _pairs_between(one: _Columns, other: _Columns) -> Iterator[_ColumnPair]:
    """Possible pairs of laws at two places, the best shapes of each."""
    gain, first, second = _pair_gains(one, other)
    if not {"element", "node"} & {one.space.place.kind, other.space.place.kind}:
        return  # of sensors alone any motion can be made, where no force is known
    names = [law[0].name for law in one.laws], [law[0].name for law in other.laws]
    same = one.space is other.space
    done: set[tuple[str, str]] = set()
    for at in np.argsort(-gain, axis=None).tolist():
        i, j = divmod(at, len(other.laws))
        key = names[0][i], names[1][j]
        if gain[i, j] <= 0 or len(done) >= REFINED_PAIRS:
            return
        if key in done or (same and key[0] == key[1]):
            continue
        strengths = float(first[i, j]), float(second[i, j])
        pair = _ColumnPair(one.only([i]), other.only([j]), float(gain[i, j]), strengths)
        if pair.effects is not None:
            done.add(key)
            yield pair


def _pair_gains(
    one: _Columns, other: _Columns
) -> tuple[
    Float[np.ndarray, "column other"],
    Float[np.ndarray, "column other"],
    Float[np.ndarray, "column other"],
]:
    """Chi squared that each pair explains, and both strengths; none of two that are one."""
    size, size2 = np.sqrt(one.own), np.sqrt(other.own)
    with np.errstate(invalid="ignore"):
        across = np.nan_to_num(one.products_with(other) / np.outer(size, size2))
    alone, alone2 = one.seen / size, other.seen / size2
    apart = 1 - across**2
    told = apart > 1 - SAME_FORCE
    apart = np.where(told, apart, 1.0)
    first = (alone[:, None] - across * alone2) / apart
    second = (alone2 - across * alone[:, None]) / apart
    gain = np.where(told, first * alone[:, None] + second * alone2, 0.0)
    return gain, first / size[:, None], second / size2


def _refined(pair: _ColumnPair) -> _ColumnPair:
    """Refine the shapes of both laws, each beside the other."""
    step = SHAPE_STEP
    for _ in range(REFINEMENTS):
        pair = _swapped(_with_finer_shape(_swapped(_with_finer_shape(pair, step)), step))
        step /= 2
    return pair


def _swapped(pair: _ColumnPair) -> _ColumnPair:
    return _ColumnPair(pair.other, pair.one, pair.gain, pair.strengths[::-1])


def _with_finer_shape(pair: _ColumnPair, step: float) -> _ColumnPair:
    """Try neighbouring shapes of the first of two laws."""
    (kind, shape), space = pair.laws[0], pair.one.space
    if not has_strength(kind):
        return pair
    for near in _neighbours(kind, space, step):
        shapes = near(shape)
        laws = [(kind, one) for one in shapes]
        columns = _Columns.of(space, laws, _forces_of(kind, shapes, space))
        gain, first, second = _pair_gains(columns, pair.other)
        for i in np.argsort(-gain[:, 0]).tolist():
            strengths = float(first[i, 0]), float(second[i, 0])
            other = _ColumnPair(columns.only([i]), pair.other, float(gain[i, 0]), strengths)
            if other.gain <= pair.gain:
                break
            if other.effects is not None:
                pair, shape = other, shapes[i]
                break
    return pair


def _neighbours(
    kind: Kind, space: ForceSpace, step: float
) -> Iterator[Callable[[Shape], list[Shape]]]:
    """Give, for each parameter that shapes a law, how its neighbours are made."""
    switches = kind.action.switches if isinstance(kind.action, Law) else ()
    last = max(float(latent.motion.times[-1]) for latent in space.latents)
    for parameter in kind.parameters:
        name = parameter.name
        if not parameter.fitted or name == kind.strength:
            continue
        wide = INSTANT_STEP * step / SHAPE_STEP * last if name in switches else 0.0
        ratio = 4 * step if name in kind.scales else step

        def near(
            shape: Shape, name: str = name, wide: float = wide, ratio: float = ratio
        ) -> list[Shape]:
            return [
                dict(shape) | {name: shape[name] * (1 + ratio) ** (0 if wide else k) + k * wide}
                for k in (-1.0, -0.5, 0.5, 1.0)
            ]

        yield near
