r"""Detection of breaks in the line of a clock.

At each of the K places between two points, the line may step by :math:`\delta` or change its
slope by it. Both are a third regressor beside level and slope; n points give the likelihood
ratio :math:`\Lambda_k = (R_0 / R_k)^{\nu / 2}` of the sums of squared residuals with and
without it, and the score :math:`\sqrt{2 \ln \Lambda_k}`. A score beyond a threshold is a
change. Below it, a change is possible all the same: the slope after the last point is averaged
over all places, with the weights

.. math:: w_0 = 1, \qquad w_k = \frac{\pi}{2 K} \, n^{-1/2} \, \Lambda_k ,

the Bayesian information criterion's, where :math:`\pi` are the prior odds of a change [1].

References
----------
.. [1] A. E. Raftery, "Bayesian model selection in social research", Sociological Methodology
   25 (1995) 111-163, sec. 4.
"""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float

from .line_fit import Line, Points

CLIP = 3.0
"""Distance, in standard deviations, that counts at most as evidence of a change."""
PRIOR_ODDS = 0.05
"""Of a change within what is remembered. More odds cover small changes better, and widen the
interval of a clock that never changes: 0.05 widens it by 14 %, 0.2 by 40 %, in the median."""
ALIKE = 9.0
"""Difference of squared scores up to which two explanations are both kept: a likelihood ratio
of 90."""


@dataclasses.dataclass(frozen=True, slots=True)
class LineBreak:
    """Where a line breaks.

    Parameters
    ----------
    first
        Position of the first span that is after it as good as certainly.
    kind
        'step' of the delay, or 'rate' of its slope.
    size, score
        Step [s] or change of slope, and how many standard deviations that is.
    turned
        Change of slope that explains the points about as well; 0 where none does.
    """

    first: int
    kind: str
    size: float
    score: float
    turned: float


@dataclasses.dataclass(frozen=True, slots=True)
class Breaks:
    """Every place where a line may break in one way.

    Parameters
    ----------
    kind
        'step' of the delay, or 'rate' of its slope.
    positions
        Index of the first point after each.
    sizes
        Step [s] or change of slope, of points whose distance from the line is clipped.
    raw
        The same, of points as they are.
    scores
        Standard deviations that these are.
    shift, growth
        What is added to the slope after the last point, and how many times its variance grows.
    """

    kind: str
    positions: tuple[int, ...]
    sizes: Float[np.ndarray, " place"]
    raw: Float[np.ndarray, " place"]
    scores: Float[np.ndarray, " place"]
    shift: Float[np.ndarray, " place"]
    growth: Float[np.ndarray, " place"]


def breaks_of(points: Points, line: Line, *, fewest: int, least_s: float) -> tuple[Breaks, ...]:
    """Scan the places where a step or a change of slope leaves enough points on either side.

    Distances from the line are clipped, so that a few late spans are no change.

    Parameters
    ----------
    points
        Points of the line.
    line
        Line through them.
    fewest, least_s
        Points, and sensor time between them [s], that must lie on either side.

    Returns
    -------
    Breaks of each kind, with their scores; none where there are too few points.
    """
    x, y = points.x, points.y
    free = len(x) - 3
    positions = _splits(x, fewest, least_s) if free >= 2 * fewest - 3 else []
    if not positions:
        return ()
    middle = x - x.mean()
    basis = np.linalg.qr(np.column_stack([np.ones_like(x), middle]))[0]
    far = y - line.level - line.slope * (x - line.x)
    far = np.clip(far - np.sort(far)[len(far) // 2], -CLIP * line.scatter, CLIP * line.scatter)
    residuals = far - basis @ (basis.T @ far)
    spread = float(middle @ middle)
    found = []
    for kind, regressors in (
        ("step", (x[:, None] >= x[positions]).astype(float)),
        ("rate", np.maximum(0.0, x[:, None] - x[positions])),
    ):
        own = regressors - basis @ (basis.T @ regressors)
        power = np.sum(own**2, axis=0)
        sizes = own.T @ residuals / power
        left = np.maximum(residuals @ residuals - sizes**2 * power, 1e-30)
        # Student's t as the normal deviate of the same probability, nearly: few points lie.
        scores = np.sqrt(free * np.log1p(sizes**2 * power / left))
        after = float(kind == "rate") - middle @ regressors / spread
        growth = 1.0 + after**2 * spread / power
        raw = own.T @ (y - basis @ (basis.T @ y)) / power
        found.append(Breaks(kind, tuple(positions), sizes, raw, scores, after * sizes, growth))
    return tuple(found)


def change_among(breaks: Iterable[Breaks], points: Points, score: float) -> LineBreak | None:
    """Find the break that explains the points best, if its score exceeds a threshold.

    Parameters
    ----------
    breaks
        Breaks of each kind, with their scores.
    points
        Points of the line.
    score
        Threshold of the score [standard deviations].

    Returns
    -------
    The change; None where no score exceeds the threshold.
    """
    ranked = sorted(breaks, key=_highest, reverse=True)
    if not ranked or _highest(ranked[0]) <= score:
        return None
    best = ranked[0]
    at = int(np.argmax(best.scores))
    least = best.scores[at] ** 2 - ALIKE
    # What may still be before the change would bend all that follows.
    last = int(np.flatnonzero(best.scores**2 >= least)[-1])
    turns = [one for one in ranked if one.kind == "rate" and _highest(one) ** 2 > least]
    turned = float(turns[0].raw[np.argmax(turns[0].scores)]) if turns else 0.0
    return LineBreak(
        first=points.kept[best.positions[last]],
        kind=best.kind,
        size=float(best.raw[at]),
        score=float(best.scores[at]),
        turned=turned,
    )


def doubted(line: Line, breaks: Iterable[Breaks], count: int) -> Line:
    """Average the slope over the possible breaks, each by its weight.

    Parameters
    ----------
    line
        Line through the points.
    breaks
        Breaks of each kind, with their scores.
    count
        Points behind the line.

    Returns
    -------
    The line, with the slope and its standard deviation averaged.
    """
    scans = tuple(breaks)
    if not scans:
        return line
    scores = np.concatenate([one.scores for one in scans])
    prior = PRIOR_ODDS / len(scores) / math.sqrt(count)
    weights = np.append(prior * np.exp(scores**2 / 2), 1.0)
    weights /= weights.sum()
    shift = np.append(np.concatenate([one.shift for one in scans]), 0.0)
    growth = np.append(np.concatenate([one.growth for one in scans]), 1.0)
    mean = float(weights @ shift)
    variance = float(weights @ (growth * line.slope_sd**2 + (shift - mean) ** 2))
    return dataclasses.replace(line, slope=line.slope + mean, slope_sd=math.sqrt(variance))


def _highest(breaks: Breaks) -> float:
    return float(breaks.scores.max())


def _splits(x: Float[np.ndarray, " span"], fewest: int, least_s: float) -> list[int]:
    enough: Bool[np.ndarray, " span"] = (x - x[0] >= least_s) & (x[-1] - x >= least_s)
    return [at for at in range(fewest, len(x) - fewest + 1) if enough[at]]
