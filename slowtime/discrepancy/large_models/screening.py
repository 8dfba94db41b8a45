"""Places of a large model between which something is likeliest missing.

Between any two points something may be missing. Two rankings of all pairs are taken in turn:

- A force of any size, about the model as claimed: first without constants (`many_points`), and
  for the likeliest beside them (`latent_force`).
- Score test of a spring, a damper and a mass, about the fit of all constants (`pair_ranking`).
  Many constants nearly make up for a change of one, and what shows it is how far they moved.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from slowtime.discrepancy.localization.latent_force import LatentForceSolver
from slowtime.discrepancy.localization.linear_response import ForceSource
from slowtime.discrepancy.localization.many_points import Ends, PointShapes, free_force_gains
from slowtime.discrepancy.localization.pair_ranking import NodePair, PairScreening
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import BASE, Description, OpenJoint, Spring
from slowtime.dynamics.effects import Place

from .basis import Basis
from .reduction import Kept

MOST_AT_ONCE = 12_000
"""[pairs] Whose products with constants are held at once. Source: a bound on memory, 70 MB for
each array of 250 constants and initial states."""
MOST_RANKED = 60
"""[pairs] Likeliest by a free force, which are ranked beside constants of the model. Source:
of four missing links of a chain of 200 masses, each was among the first six."""
KEPT_PAIRS = 4
"""[pairs] Likeliest ones that a search is given. Source: the missing link was the first of one
of two rankings; the others are its neighbours, with which it is compared."""


def likeliest_parts(
    claimed: LatentForceSolver,
    fitted: LatentForceSolver | None,
    large: Description,
    basis: Basis,
) -> Kept:
    """Choose the parts of a large model that a search is to be given."""
    names, ends = _pairs(large)
    flexibility = np.zeros((len(names) - 1,) * 2)
    rows = [large.dofs.index(name) for name in names[:-1]]
    points = PointShapes(tuple(names[:-1]), basis[rows], flexibility)
    pairs = [(names[i], names[j]) for i, j in ends]
    orders = [_by_free_force(claimed, points, ends)]
    if fitted is not None:
        orders.append(_by_score(fitted, points, pairs))
    in_turn = itertools.chain.from_iterable(zip(*orders, strict=True))
    chosen = itertools.islice(dict.fromkeys(in_turn), KEPT_PAIRS)
    return kept_parts(large, [pairs[i] for i in chosen])


def _pairs(large: Description) -> tuple[list[str], Ends]:
    """Names of points, the ground last, and all pairs of them."""
    free = set(large.dofs)
    names = [*(node.id for node in large.nodes if node.id in free), BASE]
    return names, np.array(list(itertools.combinations(range(len(names)), 2)))


def _by_free_force(solver: LatentForceSolver, points: PointShapes, ends: Ends) -> list[int]:
    """Sort the likeliest pairs by the likelihood of a force there, beside constants."""
    among = np.argsort(-free_force_gains(solver, points, ends))[:MOST_RANKED]
    still = np.zeros((1, points.shapes.shape[1]))
    shapes = np.concatenate([points.shapes, still])

    def likelihood(number: int) -> float:
        first, second = ends[among[number]]
        place = Place("element", f"pair {number}")
        source = ForceSource(place=place, force=shapes[second] - shapes[first])
        return solver.iterate(source, rounds=1).likelihood

    found = map_shared(likelihood, range(len(among)), (solver, solver.linear, solver.known))
    return list(among[np.argsort(-np.array(found))].tolist())


def _by_score(
    solver: LatentForceSolver, points: PointShapes, pairs: Sequence[NodePair]
) -> list[int]:
    """Sort the likeliest pairs by what a small spring, damper and mass gain there."""
    gains = [
        PairScreening(solver, pairs[first : first + MOST_AT_ONCE], points).gains()
        for first in range(0, len(pairs), MOST_AT_ONCE)
    ]
    return list(np.argsort(-np.concatenate(gains))[:MOST_RANKED].tolist())


def kept_parts(large: Description, pairs: Sequence[NodePair]) -> Kept:
    """Keep what joins each pair, or a place for it, and nodes that something holds."""
    every = len(large.dofs) * (len(large.dofs) + 1) // 2 - len(large.elements)
    grounded = {BASE, *(one.id for one in large.supports)}
    joined: dict[frozenset[str], list[str]] = {}
    for part in large.elements:
        # A beam joins what turns, too: a force across its ends is none of its own.
        if isinstance(part, Spring):
            ends = frozenset(BASE if end in grounded else end for end in part.between)
            joined.setdefault(ends, []).append(part.id)
    elements: list[str] = []
    joints: list[OpenJoint] = []
    for pair in pairs:
        known = joined.get(frozenset(pair))
        if known:
            elements += known
        else:
            first, second = pair if BASE not in pair else (BASE, pair[0])
            joints.append(
                OpenJoint(id=f"{first}-{second}", between=(first, second), among=max(every, 1))
            )
    nodes = [end for pair in pairs if BASE in pair for end in pair if end != BASE]
    return Kept(tuple(elements), tuple(nodes), tuple(joints))
