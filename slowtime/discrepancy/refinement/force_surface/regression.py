r"""Regression of the recovered force on a surface, its terms chosen by their evidence.

With normal equations :math:`A c = b` of the whitened residual, constants and initial states
eliminated, and a prior of the coefficients :math:`c \sim N(0, \sigma^2)`,

.. math:: \log Z = \tfrac12 b^T (A + I/\sigma^2)^{-1} b
          - \tfrac12 \log |A + I/\sigma^2| - n \log \sigma .
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float, Int

from slowtime.discrepancy.candidates.force_space import ForceSpace
from slowtime.dynamics.effects import Kind, force_along

from .scales import ColumnGroup

MIN_GAIN = 3.0
"""[nats] Of log evidence by which a group of terms must gain. Source: Kass and Raftery (1995):
strong from there on."""
LEADING_GAIN = 2e-3
"""[share of the log evidence of the surface] By which a leading group must gain. Source: that
of demanded shapes (`MAX_LOSS_SHARE` in `shape_choice`), as a regression along a recovered
motion is no more exact than that."""
LEVEL = "level"
"""Group of the terms that depend on a slow level."""
REFINED_WITHIN = 3.0
"""[1] Factor within which the time constant of the level is refined. Source: the neighbours of
a value that was tried."""
REFINED_TO = 0.01
"""[1] Relative exactness of that time constant. Source: a cost in evidence that no longer
matters for slow changes of some ten per cent."""
SPREAD_FACTORS = (0.3, 1.0, 3.0)
"""[times the largest recovered force] Standard deviations of the prior that are tried. Source:
a force is made of terms of about its own size."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """Terms of a surface that explain the recovered force.

    Parameters
    ----------
    coefficients
        Value of each chosen coefficient [N].
    evidence
        Log evidence over that of no force [nats].
    leading
        Values of the coefficients of the leading groups, fitted without the others [N]. The
        others may say no more than errors of the recovered motion.
    excess
        Chi squared per datum that counts as noise, at least 1.
    """

    kind: Kind
    blocks: tuple[ColumnGroup, ...]
    scales: Mapping[str, float]
    coefficients: Mapping[str, float]
    evidence: float
    leading: Mapping[str, float]
    excess: float

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters of the surface, those that are zero left out."""
        return {**self.scales, **self.coefficients}


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations of the columns of blocks."""

    matrix: Float[np.ndarray, "column column"]
    right: Float[np.ndarray, " column"]
    places: tuple[Int[np.ndarray, " own"], ...]

    def tempered(self, excess: float) -> "Equations":
        """Give the equations under noise whose variance is larger by a factor."""
        return dataclasses.replace(self, matrix=self.matrix / excess, right=self.right / excess)

    def solve(
        self, chosen: Sequence[int], spread: float
    ) -> tuple[float, Float[np.ndarray, " own"]]:
        """Give the log evidence of some blocks [nats] and their coefficients."""
        if not chosen:
            return 0.0, np.zeros(0)
        at = np.concatenate([self.places[i] for i in chosen])
        inner = spread**2 * self.matrix[np.ix_(at, at)] + np.eye(len(at))
        right = spread * self.right[at]
        try:
            factor = scipy.linalg.cho_factor(inner)
        except np.linalg.LinAlgError:
            return -math.inf, np.zeros(len(at))
        solved = scipy.linalg.cho_solve(factor, right)
        turned = float(np.log(np.diag(factor[0])).sum())
        return float(right @ solved) / 2 - turned, spread * solved


def choose_terms(
    kind: Kind,
    scales: Mapping[str, float],
    blocks: Sequence[ColumnGroup],
    space: ForceSpace,
    excess: float | None = None,
) -> Regression | None:
    """Choose groups of terms by forward selection, the one of most evidence first.

    It gains evidence over noise of `excess`, that of another surface which it is compared with,
    or what all blocks together leave. None where no force is told from noise. Scales are those
    of range and knots, and others where no block says another.

    References
    ----------
    .. [1] D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992).
    """
    equations = equations_of(kind, scales, blocks, space)
    if excess is None:
        excess = _excess(equations, scales["spread_n"], space)
    equations = equations.tempered(excess)
    best: tuple[float, float, list[int], list[int]] = (0.0, 1.0, [], [])
    for factor in SPREAD_FACTORS:
        spread = factor * scales["spread_n"]
        evidence, chosen, leading = _forward(equations, blocks, spread)
        if evidence > best[0]:
            best = evidence, spread, chosen, leading
    evidence, spread, chosen, leading = best
    if not chosen:
        return None
    level = next((i for i in leading if blocks[i].group == LEVEL), None)
    if level is not None:
        refined = _refined(kind, scales, [blocks[i] for i in leading], spread, space)
        blocks = [refined if i == level else block for i, block in enumerate(blocks)]
        equations = equations_of(kind, scales, blocks, space).tempered(excess)
        evidence = equations.solve(chosen, spread)[0]
    kept = tuple(blocks[i] for i in chosen)
    own = {**scales, "spread_n": spread}
    for block in kept:
        own |= block.scales
    every, first = (
        _coefficients(equations, blocks, some, spread) for some in (chosen, leading)
    )
    return Regression(kind, kept, own, every, evidence, first, excess)


def _coefficients(
    equations: Equations, blocks: Sequence[ColumnGroup], chosen: Sequence[int], spread: float
) -> dict[str, float]:
    """Solve for the coefficients of some blocks, by name [N]."""
    names = [name for i in chosen for name in blocks[i].names]
    return dict(zip(names, equations.solve(chosen, spread)[1].tolist(), strict=True))


def _excess(equations: Equations, spread: float, space: ForceSpace) -> float:
    """Chi squared per datum that all columns together leave, at least 1."""
    # The recovered motion is not exact. What no surface explains along it counts as noise, or
    # every group of terms would gain evidence by its errors.
    everything = range(len(equations.places))
    largest = max(SPREAD_FACTORS) * spread
    coefficients = equations.solve(everything, largest)[1]
    explained = float(
        2 * equations.right @ coefficients - coefficients @ equations.matrix @ coefficients
    )
    return max((space.cost_without - explained) / space.count, 1.0)


def _refined(
    kind: Kind,
    scales: Mapping[str, float],
    chosen: Sequence[ColumnGroup],
    spread: float,
    space: ForceSpace,
) -> ColumnGroup:
    """Give the block of the slow level with the time constant of most evidence."""
    # A run loses its phase where a slow change is off by a few per cent.
    at = next(i for i, block in enumerate(chosen) if block.group == LEVEL)
    block = chosen[at]

    def with_time(log_factor: float) -> ColumnGroup:
        time = block.scales["level_s"] * math.exp(log_factor)
        return dataclasses.replace(block, scales={**block.scales, "level_s": time})

    def loss(log_factor: float) -> float:
        own = [with_time(log_factor) if i == at else one for i, one in enumerate(chosen)]
        return -equations_of(kind, scales, own, space).solve(range(len(own)), spread)[0]

    reach = math.log(REFINED_WITHIN)
    found = scipy.optimize.minimize_scalar(
        loss, bounds=(-reach, reach), method="bounded", options={"xatol": REFINED_TO}
    )
    return with_time(float(found.x))


def _forward(
    equations: Equations, blocks: Sequence[ColumnGroup], spread: float
) -> tuple[float, list[int], list[int]]:
    """Add the block of most evidence until none gains enough, then drop needless ones."""
    chosen: list[int] = []
    leading: list[int] | None = None
    evidence = 0.0
    while True:
        open_ = [i for i in range(len(blocks)) if _fits(blocks, chosen, i)]
        tried = [(equations.solve([*chosen, i], spread)[0], i) for i in open_]
        gained = max(tried, default=(-math.inf, -1))
        if not gained[0] > evidence + MIN_GAIN:
            break
        if leading is None and gained[0] - evidence < LEADING_GAIN * gained[0]:
            leading = chosen
        evidence, chosen = gained[0], [*chosen, gained[1]]
        less = [
            (equations.solve([j for j in chosen if j != i], spread)[0], i) for i in chosen[:-1]
        ]
        lost = max(less, default=(-math.inf, -1))
        if lost[0] > evidence:
            evidence, chosen = lost[0], [j for j in chosen if j != lost[1]]
    return evidence, chosen, [i for i in leading or chosen if i in chosen]


def _fits(blocks: Sequence[ColumnGroup], chosen: Sequence[int], i: int) -> bool:
    """Whether a block may join others: one of each group, and no scale in two values."""
    if any(blocks[j].group == blocks[i].group for j in chosen):
        return False
    return all(
        blocks[j].scales.get(name, value) == value
        for j in chosen
        for name, value in blocks[i].scales.items()
    )


def equations_of(
    kind: Kind, scales: Mapping[str, float], blocks: Sequence[ColumnGroup], space: ForceSpace
) -> Equations:
    """Form the normal equations of all columns of all blocks."""
    series, places, count = [], [], 0
    motions = [one.motion for one in space.latents]
    for block in blocks:
        own = {**scales, **block.scales}
        series.append([
            np.stack([force_along(kind, own | {name: 1.0}, m) for name in block.names], axis=1)
            for m in motions
        ])  # fmt: skip
        places.append(np.arange(count, count + len(block.names)))
        count += len(block.names)
    forces = [np.concatenate([one[i] for one in series], axis=1) for i in range(len(motions))]
    matrix, right = space.normal_equations(space.lines_of(forces))
    return Equations((matrix + matrix.T) / 2, right, tuple(places))
