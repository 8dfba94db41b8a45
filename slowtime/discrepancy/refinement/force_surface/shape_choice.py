r"""Choice of the shape of a force surface: by evidence, or as demanded where records allow it.

Coefficients of a monotone surface are bounded to one side. With the normal equations
:math:`A` and :math:`b` of the terms that were chosen without bounds, they minimise
:math:`\tfrac12 c^T (A + I/\sigma^2) c - b^T c` within these bounds, and the loss against the
minimum without them is what the demand costs [nats].
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.discrepancy.calibration.bounded_least_squares import solve_within
from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.effects.library.measured_force import DIRECTIONS

from .regression import MIN_GAIN, Equations, Regression, choose_terms, equations_of
from .scales import blocks_of
from .shape import EVEN, FREE, NEITHER, ODD, SurfaceDemand, SurfaceShape, groups_of, scales_of

MAX_LOSS = 5.0
"""[nats] Of log evidence that a demanded shape may cost. Source: Kass and Raftery (1995): very
strong evidence against it from there on."""
MAX_LOSS_SHARE = 2e-3
"""[share of the log evidence of the surface] That a demanded shape may cost as well, as a
regression along the motion of another model is no more exact than that. Source: 8e-4 is the
most that the right shape costs in records of 1 % noise, 1.7e-2 the least that a wrong one
does; the free run decides in between."""
Groups = Mapping[str, tuple[str, ...]]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class ShapedRegression:
    """Terms of a surface, and the shape that it has.

    Parameters
    ----------
    gain
        Log evidence over that of a surface of any shape [nats].
    refused
        Demands that the records contradict, with the log evidence that they would cost [nats].
    """

    terms: Regression
    shape: SurfaceShape
    gain: float
    refused: tuple[tuple[str, float], ...]


def choose_shape(
    kind: Kind,
    scales: Mapping[str, float],
    groups: Groups,
    space: ForceSpace,
    demand: SurfaceDemand,
) -> ShapedRegression | None:
    """Choose the shape of a surface and its terms; None where no force is told from noise."""
    free = _with_shape(kind, scales, groups, space, FREE)
    base = 0.0 if free is None else free.evidence
    most = max(MAX_LOSS, MAX_LOSS_SHARE * base)
    found, shape, refused = free, FREE, []
    for parity in _parities(demand):
        tried = _with_shape(kind, scales, groups, space, SurfaceShape(parity), free)
        evidence = 0.0 if tried is None else tried.evidence
        least = MIN_GAIN if demand.parity is None else -most
        best = base if demand.parity is not None or found is None else found.evidence
        if tried is not None and evidence >= best + (least if shape == FREE else 0.0):
            found, shape = tried, SurfaceShape(parity)
        elif demand.parity is not None and free is not None:
            refused.append((SurfaceShape(parity).words, base - evidence))
    if found is not None and demand.monotone:
        bounded = _monotone(kind, scales, groups, space, shape.parity, free)
        loss = np.inf if bounded is None else found.evidence - bounded[0].evidence
        if bounded is not None and loss <= most:
            found, shape = bounded
        else:
            refused.append(("monotone", float(loss)))
    if found is None:
        return None
    return ShapedRegression(found, shape, found.evidence - base, tuple(refused))


def _parities(demand: SurfaceDemand) -> tuple[int, ...]:
    """Parities that are tried beside none."""
    if demand.parity is None:
        return (ODD,) if demand.monotone else (ODD, EVEN)
    return () if demand.parity == NEITHER else (demand.parity,)


def _with_shape(
    kind: Kind,
    scales: Mapping[str, float],
    groups: Groups,
    space: ForceSpace,
    shape: SurfaceShape,
    against: Regression | None = None,
    *,
    monotone: bool = False,
) -> Regression | None:
    """Choose terms of a surface of a shape, without bounds of the coefficients."""
    kept = groups_of(groups, shape.parity, monotone=monotone)
    return choose_terms(
        kind, scales_of(scales, shape), blocks_of(space.latents, kept), space,
        None if against is None else against.excess,
    )  # fmt: skip


def _monotone(
    kind: Kind,
    scales: Mapping[str, float],
    groups: Groups,
    space: ForceSpace,
    parity: int,
    free: Regression | None,
) -> tuple[Regression, SurfaceShape] | None:
    """Bound the coefficients of the terms to the side that costs least."""
    loose = _with_shape(kind, scales, groups, space, SurfaceShape(parity), free, monotone=True)
    if loose is None:
        return None
    terms = equations_of(kind, loose.scales, loose.blocks, space).tempered(loose.excess)
    names = tuple(loose.coefficients)
    best: tuple[float, SurfaceShape, np.ndarray] | None = None
    for way_e, way_v in itertools.product((1, -1), repeat=2):
        shape = SurfaceShape(parity, way_e, way_v)
        loss, found = _bounded(terms, names, shape, loose)
        if best is None or loss < best[0]:
            best = loss, shape, found
    assert best is not None
    loss, shape, found = best
    first = tuple(name for name in names if name in loose.leading)
    at = np.array([names.index(name) for name in first])
    own = dataclasses.replace(terms, matrix=terms.matrix[np.ix_(at, at)], right=terms.right[at])
    _, leading = _bounded(own, first, shape, loose)
    held = dataclasses.replace(
        loose,
        scales={**loose.scales, **shape.parameters},
        coefficients=dict(zip(names, found.tolist(), strict=True)),
        leading=dict(zip(first, leading.tolist(), strict=True)),
        evidence=loose.evidence - loss,
    )
    return held, shape


def _bounded(
    terms: Equations, names: Sequence[str], shape: SurfaceShape, loose: Regression
) -> tuple[float, np.ndarray]:
    """Give the loss of the bounds [nats] and the coefficients within them [N]."""
    ways = [shape.parameters.get(DIRECTIONS.get(name, ""), 0.0) for name in names]
    low = np.array([0.0 if way > 0 else -np.inf for way in ways])
    high = np.array([0.0 if way < 0 else np.inf for way in ways])
    spread = loose.scales["spread_n"]
    inner = spread**2 * terms.matrix + np.eye(len(names))
    right = spread * terms.right
    without = np.linalg.solve(inner, right)
    found = solve_within(inner, right, low, high)
    off = found - without
    return float(off @ inner @ off) / 2, spread * found
