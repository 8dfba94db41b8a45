r"""Mixture densities for importance sampling, as ratios to the standard normal.

Along the axis :math:`a` of a design point the density is a normal one at its distance, or the
tail of the standard normal one from a little before it; across the axis nothing is changed.
Broad components widen all axes. Ratios therefore need the projections :math:`a^T u` and the
radius only, and stay exact in any number of inputs.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, ndtr, ndtri

from slowtime.reliability.result import DesignPoint

DEPTHS = (0.1, 0.5, 1.5)
"""By how much, over the index, the tail begins before a design point."""

LEAST_CHAINS = 5
"""[chains] That end about one design point before their distances are used. Source: the spread
of fewer is known to no better than a factor of two (chi-squared, 95 %)."""

SPREADS = (1.0, 2.5)
"""[standard deviations] Of the distances of chains, by which tails begin before their mean.
Source: all but 1 % of a normal distribution lies above the second."""

BROAD = (1.15, 1.4, 1.8, 2.5, 3.5)
"""Factors by which broad components widen all axes: for limit states without design points."""

FLOOR = 0.08
"""Share of the samples that is spread evenly over all components, whatever was learnt."""

LOOKOUT = 0.15
"""Share of the broad components at least: they see what the others do not."""


@dataclasses.dataclass(frozen=True, slots=True)
class Component:
    """One density of the mixture."""

    kind: str
    """``"shift"``, ``"tail"`` or ``"broad"``."""

    axis: Float[np.ndarray, " input"]
    at: float
    """Distance of the shift, start of the tail, or factor of the widening."""

    def log_ratio(self, u: Float[np.ndarray, "sample input"]) -> Float[np.ndarray, " sample"]:
        """Logarithm of this density over the standard normal one.

        Minus infinity where this density is zero.
        """
        if self.kind == "broad":
            square = np.sum(u**2, axis=1)
            return np.asarray(0.5 * square * (1.0 - self.at**-2) - u.shape[1] * np.log(self.at))
        along = u @ self.axis
        if self.kind == "shift":
            return np.asarray(self.at * along - 0.5 * self.at**2)
        return np.where(along > self.at, -log_ndtr(-self.at), -np.inf)

    def draw(self, rng: np.random.Generator, count: int) -> Float[np.ndarray, "sample input"]:
        """Random points of this density."""
        u = rng.standard_normal((count, len(self.axis)))
        if self.kind == "broad":
            return self.at * u
        along = u @ self.axis
        if self.kind == "shift":
            wanted = along + self.at
        else:
            wanted = -ndtri(ndtr(-self.at) * rng.uniform(size=count))
            wanted = np.maximum(wanted, self.at + 1e-12)
        return np.asarray(u + (wanted - along)[:, None] * self.axis)


def about(point: DesignPoint) -> list[Component]:
    """Components about one design point."""
    size = max(abs(point.beta), 1.0)
    tails = [Component("tail", point.alpha, point.beta - depth / size) for depth in DEPTHS]
    return [Component("shift", point.alpha, point.beta), *tails]


def about_chains(
    ends: Float[np.ndarray, "chain input"], points: Sequence[DesignPoint]
) -> list[Component]:
    """Components along the axes of design points, at the distances where chains ended.

    In many inputs a limit state that bends a little in each fails far before its tangent
    plane, or far beyond.

    Where a tenth of the chains lies about as far as a design point does, its own components
    serve.
    """
    if not points:
        return []
    axes = np.stack([point.alpha for point in points])
    along = ends @ axes.T
    nearest = np.argmax(along - [point.beta for point in points], axis=1)
    found = []
    for which, point in enumerate(points):
        theirs = along[nearest == which, which]
        depth = DEPTHS[-1] / max(abs(point.beta), 1.0)
        if len(theirs) < LEAST_CHAINS or abs(np.quantile(theirs, 0.1) - point.beta) < depth:
            continue
        mean, sd = float(theirs.mean()), float(theirs.std())
        found.append(Component("shift", point.alpha, mean))
        found += [Component("tail", point.alpha, mean - depth * sd) for depth in SPREADS]
    return found


def broad(inputs: int) -> list[Component]:
    """Components that widen all axes."""
    return [Component("broad", np.eye(inputs)[0], factor) for factor in BROAD]


def first_shares(components: Sequence[Component]) -> Float[np.ndarray, " component"]:
    """Shares before anything is known: by first-order probability; a fifth to broad ones."""
    size = np.array(
        [0.0 if c.kind == "broad" else max(float(ndtr(-c.at)), 1e-300) for c in components]
    )
    kinds = np.array([c.kind == "broad" for c in components])
    if kinds.all():
        return np.full(len(components), 1.0 / len(components))
    near = np.sqrt(size[~kinds])
    share = np.zeros(len(components))
    share[~kinds] = 0.8 * near / near.sum()
    share[kinds] = 0.2 / max(int(kinds.sum()), 1)
    return floored(share, kinds)


def floored(
    share: Float[np.ndarray, " component"], wide: np.ndarray, least: float = LOOKOUT
) -> Float[np.ndarray, " component"]:
    """Raise shares so that no component is without samples, nor the broad ones without enough.

    They sum to one; `least` is the least share of all broad components together.
    """
    share = (1.0 - FLOOR) * share / share.sum() + FLOOR / len(share)
    lookout = float(share[wide].sum())
    if lookout < least and not wide.all():
        # Among themselves by the root of what was learnt, so that none takes all.
        part = np.sqrt(share[wide])
        share[wide] = least * part / part.sum()
        share[~wide] *= (1.0 - least) / share[~wide].sum()
    return share


def learnt_shares(
    log_ratios: Float[np.ndarray, "sample component"],
    weights: Float[np.ndarray, " sample"],
    share: Float[np.ndarray, " component"],
    wide: np.ndarray,
    *,
    lookout: float = LOOKOUT,
    rounds: int = 30,
) -> Float[np.ndarray, " component"]:
    """Shares nearest to the failing points in cross-entropy, by expectation maximisation.

    It starts from `share`; `lookout` is the least share of all broad components together.
    """
    for _ in range(rounds):
        parts = np.log(share) + log_ratios
        parts = np.exp(parts - np.logaddexp.reduce(parts, axis=1, keepdims=True))
        share = weights @ parts
        share = np.maximum(share / share.sum(), 1e-12)
    return floored(share, wide, lookout)
