r"""Search of all design points of a limit state.

A first descent begins at the origin. Then directional probes are drawn where a plane at the
distance found would fail one probe in ten. A probe that fails although no tangent plane found
so far explains it starts a further descent, until a round of probes brings nothing new.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.reliability.problem import Conditional, Evaluator, Problem
from slowtime.reliability.result import DesignPoint

from .descent import Descent, descend


@dataclasses.dataclass(frozen=True, slots=True)
class Search:
    """Settings of the search for design points.

    Parameters
    ----------
    probes
        Random points of a round; a mode that holds a tenth of them is missed by all 60 with a
        probability of 0.2 %, and there are at least two rounds.
    rounds
        At most.
    most_points
        Design points after which no more are looked for: a sphere has infinitely many.
    in_vain
        Descents in a row without a new point that end the search.
    calls_per_input
        Calls of the limit state at most, over the number of inputs plus 10.
    apart
        Distance, over the smaller distance from the origin, within which two points are one.
    within
        Points farther than the nearest by more than this hold too little probability.
    """

    probes: int = 60
    rounds: int = 6
    most_points: int = 40
    in_vain: int = 4
    calls_per_input: int = 100
    apart: float = 0.2
    within: float = 2.0


TENTH = 1.2815515655446004
"""Score exceeded with probability 0.1."""

MARGIN = 0.05
"""Distance before a tangent plane at which it still explains a failure."""

BEGINNINGS = 8
"""Random starts where the origin leads nowhere."""


@dataclasses.dataclass(frozen=True, slots=True)
class DesignPointSearch:
    """Design points, the nearest first, and what the search could not settle."""

    points: tuple[DesignPoint, ...]
    warnings: tuple[str, ...]


def require_design_points(
    g: Evaluator, rng: np.random.Generator, search: Search | None
) -> DesignPointSearch:
    """Find all design points that matter; raise `ValueError` where there is none."""
    found = find_design_points(g, rng, search)
    if not found.points:
        raise ValueError(
            f"{found.warnings[0]} Use a sampling method, such as subset simulation."
        )
    return found


def find_design_points(
    g: Evaluator, rng: np.random.Generator, search: Search | None = None
) -> DesignPointSearch:
    """Find all design points that matter; their sensitivities are in `sensitivities`.

    Examples
    --------
    >>> from slowtime.reliability.problem import Problem, unknowns
    >>> two_sided = Problem(unknowns(2), lambda u: 3.0 - np.abs(u[:, 0]))
    >>> found = find_design_points(Evaluator(two_sided), np.random.default_rng(0))
    >>> sorted(round(float(point.u[0]), 3) for point in found.points)
    [-3.0, 3.0]
    """
    search = Search() if search is None else search
    size = g.problem.size
    value = float(g(np.zeros((1, size)))[0])
    # A start beside the origin, so that what is symmetric about it has a slope.
    starts = [np.zeros(size), *rng.standard_normal((BEGINNINGS, size)) * 1.5]
    scale = abs(value) if np.isfinite(value) and value else 1.0
    sign = 1.0 if value > 0.0 else -1.0
    points: list[DesignPoint] = []
    for start in starts:
        found = descend(g, start, scale, again=True)
        if found is not None and np.linalg.norm(found.u) > 1e-8:
            points.append(_point(g.problem, found, sign))
            break
    if not points and value > 0.0:
        most = g.calls + search.calls_per_input * (size + 10)
        points, _ = _from_failures(g, rng, scale, search, [], most)
    if not points:
        return DesignPointSearch(
            (), ("No design point was found: the limit state may be flat or jump.",)
        )
    warnings: list[str] = []
    if sign > 0.0 and search.rounds:
        points = _complete(g, rng, scale, search, points, warnings)
    points.sort(key=lambda point: abs(point.beta))
    near = [p for p in points if abs(p.beta) <= abs(points[0].beta) + search.within]
    if not all(point.converged for point in near):
        warnings.append(
            "The search for a design point did not meet its tolerance, as at a corner of the "
            "limit state: its distance is approximate."
        )
    return DesignPointSearch(tuple(near), tuple(warnings))


def _complete(
    g: Evaluator,
    rng: np.random.Generator,
    scale: float,
    search: Search,
    points: list[DesignPoint],
    warnings: list[str],
) -> list[DesignPoint]:
    most = g.calls + search.calls_per_input * (g.problem.size + 10)
    for number in range(search.rounds):
        new, settled = _from_failures(g, rng, scale, search, points, most)
        points = points + new
        if not settled:
            warnings.append(
                f"{len(points)} design points were found, and failures they do not explain "
                "remain: there may be more, or the limit state is curved as a sphere is."
            )
            break
        if not new and number:
            break
    return points


def _from_failures(
    g: Evaluator,
    rng: np.random.Generator,
    scale: float,
    search: Search,
    known: list[DesignPoint],
    most: int,
) -> tuple[list[DesignPoint], bool]:
    """Find design points from probes that fail unexplained; False where some remain so."""
    points = list(known)
    least = min((abs(p.beta) for p in points), default=3.0)
    spread = max(least / TENTH, 1.0)
    probes = spread * rng.standard_normal((search.probes, g.problem.size))
    failed = probes[g(probes) <= 0.0]
    vain = 0
    while True:
        failed = failed[~explained(failed, points)]
        if not len(failed):
            return points[len(known) :], True
        if vain >= search.in_vain or len(points) >= search.most_points or g.calls >= most:
            return points[len(known) :], False
        nearest = int(np.argmin(np.sum(failed**2, axis=1)))
        start, failed = failed[nearest], np.delete(failed, nearest, axis=0)
        found = descend(g, start, scale)
        point = None if found is None else _point(g.problem, found, 1.0)
        if point is None or not is_new(point, points, search):
            vain += 1
            continue
        vain = 0
        points.append(point)


def explained(u: Float[np.ndarray, "sample input"], points: list[DesignPoint]) -> np.ndarray:
    """Tell which points lie beyond the tangent plane of a known design point, less a margin."""
    if not points or not len(u):
        return np.zeros(len(u), dtype=bool)
    alphas = np.stack([point.alpha for point in points])
    betas = np.array([point.beta for point in points])
    return np.asarray((u @ alphas.T >= betas - MARGIN).any(axis=1))


def is_new(point: DesignPoint, points: list[DesignPoint], search: Search) -> bool:
    """Whether a design point is none of those known, and near enough to matter."""
    least = min((abs(p.beta) for p in points), default=point.beta)
    if abs(point.beta) > least + search.within:
        return False
    return all(
        np.linalg.norm(point.u - p.u) > search.apart * max(min(p.beta, point.beta), 0.5)
        for p in points
    )


def descend_from(
    g: Evaluator, start: Float[np.ndarray, " input"], points: list[DesignPoint], search: Search
) -> DesignPoint | None:
    """Descend from a failing point to a design point that is not known yet.

    None where the descent fails or ends at a known one.
    """
    scale = abs(float(g(np.zeros((1, len(start))))[0])) or 1.0
    found = descend(g, start, scale if np.isfinite(scale) else 1.0)
    if found is None or not np.any(found.u):
        return None
    point = _point(g.problem, found, 1.0 if points[0].beta > 0.0 else -1.0)
    return point if is_new(point, points, search) else None


def _point(problem: Problem, found: Descent, sign: float) -> DesignPoint:
    beta = sign * float(np.linalg.norm(found.u))
    alpha = found.u / beta if beta else -found.slope / np.linalg.norm(found.slope)
    x = problem.physical(found.u[None])[0]
    return DesignPoint(found.u, x, beta, alpha, found.converged)


def sensitivities(problem: Problem, point: DesignPoint) -> DesignPoint:
    r"""Add the slopes of :math:`\beta` by :math:`\mu` and :math:`\sigma` of each input."""
    # By d beta / d theta = alpha . d u(x*, theta) / d theta (Ditlevsen and Madsen 1996, chapter
    # 8), which needs no call of the limit state.
    z = problem.scores(point.u[None])[0]
    dz = 1e-5 * np.eye(problem.size)
    # How the independent normal inputs follow the dependent scores, and alpha through that.
    forth, back = _independent(problem, z + dz), _independent(problem, z - dz)
    through = (forth - back) / 2e-5 @ point.alpha
    means, sds = {}, {}
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    for k, (name, law) in enumerate(problem.inputs.items()):
        if isinstance(law, Conditional):
            continue
        slope = float(law.law.pdf(point.x[k])) / density[k]
        if not np.isfinite(slope) or not np.isfinite(law.sd):
            continue
        means[name] = float(-through[k] * slope)
        sds[name] = float(-through[k] * slope * (point.x[k] - law.mean) / law.sd)
    return dataclasses.replace(point, mean_sensitivity=means, sd_sensitivity=sds)


def _independent(problem: Problem, z: np.ndarray) -> np.ndarray:
    u = np.array(z)
    for group, copula in problem.dependence.items():
        columns = [problem.names.index(name) for name in group]
        u[:, columns] = copula.independent(u[:, columns])
    return u


__all__ = [
    "DesignPointSearch",
    "Search",
    "descend_from",
    "explained",
    "find_design_points",
    "sensitivities",
]
