"""Places of a large model between which something is likeliest missing.

Between any two points something may be missing: a force there is tried for all pairs, without
constants of the model (`many_points`), and with them for the likeliest (`latent_force`).
"""

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.localization.latent_force import LatentForceSolver
from slowtime.discrepancy.localization.linear_response import ForceSource
from slowtime.discrepancy.localization.many_points import Ends, PointShapes, free_force_gains
from slowtime.discrepancy.localization.pair_ranking import PairScreening
from slowtime.discrepancy.workers import map_shared
from slowtime.dynamics.description import BASE, Description, Matrix, OpenJoint
from slowtime.dynamics.effects import Place

from .basis import Basis
from .reduction import Kept

MOST_SCREENED = 2_000
"""[pairs] Likeliest by a free force, of which a small link is asked for. Source: a tenth of the
pairs of 200 points; a bound on computing time."""
MOST_RANKED = 60
"""[pairs] Likeliest of all, which are ranked beside constants of the model. Source: of four
missing links of a chain of 200 masses, each was among the first six."""
KEPT_PAIRS = 4
"""[pairs] Likeliest ones that a search is given. Source: the missing link of these was the
first; the others are its neighbours, with which it is compared."""

Gains = Float[np.ndarray, " pair"]


def likeliest_parts(
    solver: LatentForceSolver, large: Description, basis: Basis, *, small_links: bool
) -> Kept:
    """Choose the parts of a large model that a search is to be given.

    Parameters
    ----------
    solver
        Linearised about a run of the reduced model.
    basis
        Of the reduced model.
    small_links
        Whether what is missing may do less than constants within their tolerances.
    """
    names, ends = _pairs(large)
    flexibility = np.zeros((len(names) - 1,) * 2)
    rows = [large.dofs.index(name) for name in names[:-1]]
    points = PointShapes(tuple(names[:-1]), basis[rows], flexibility)
    free = np.argsort(-free_force_gains(solver, points, ends))
    chosen = free[:MOST_RANKED]
    if small_links:
        few = free[:MOST_SCREENED]
        pairs = [(names[i], names[j]) for i, j in ends[few]]
        gains = PairScreening(solver, pairs, points).gains()
        chosen = few[np.argsort(-gains)][:MOST_RANKED]
    ranked = chosen[np.argsort(-_gains_beside_constants(solver, points, ends[chosen]))]
    return _parts(large, [(names[i], names[j]) for i, j in ends[ranked[:KEPT_PAIRS]]])


def _pairs(large: Description) -> tuple[list[str], Ends]:
    """Names of points, the ground last, and all pairs of them."""
    free = set(large.dofs)
    names = [*(node.id for node in large.nodes if node.id in free), BASE]
    return names, np.array(list(itertools.combinations(range(len(names)), 2)))


def _gains_beside_constants(
    solver: LatentForceSolver, points: PointShapes, ends: Ends
) -> Gains:
    """Log likelihood [nats] of a force between each pair, constants within their tolerances."""
    still = np.zeros((1, points.shapes.shape[1]))
    shapes = np.concatenate([points.shapes, still])

    def likelihood(number: int) -> float:
        first, second = ends[number]
        place = Place("element", f"pair {number}")
        source = ForceSource(place=place, force=shapes[second] - shapes[first])
        return solver.iterate(source, rounds=1).likelihood

    found = map_shared(likelihood, range(len(ends)), (solver, solver.linear, solver.known))
    return np.array(found)


def _parts(large: Description, pairs: Sequence[tuple[str, str]]) -> Kept:
    """Keep what joins each pair, or a place for it, and nodes that something holds."""
    every = len(large.dofs) * (len(large.dofs) + 1) // 2 - len(large.elements)
    grounded = {BASE, *(one.id for one in large.supports)}
    joined: dict[frozenset[str], list[str]] = {}
    for part in large.elements:
        if not isinstance(part, Matrix):
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
