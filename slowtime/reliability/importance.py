r"""Importance sampling about all design points, its mixture learnt while it runs.

.. math:: P = \frac1N \sum_i \frac{\phi(u_i)}{\bar h(u_i)} [g(u_i) \le 0], \quad
          \bar h = \sum_k \bar\pi_k h_k

with :math:`\bar\pi_k` the share of all samples that component k has drawn (the balance
heuristic of Veach and Guibas 1995), so that samples of every round count.
"""

import numpy as np
from jaxtyping import Float

from .mixture import Component, about, broad, first_shares, learnt_shares
from .problem import Evaluator, Problem
from .result import DesignPoint, Result, Stopping, sampled
from .search import (
    Found,
    Search,
    descend_from,
    explained,
    find_design_points,
    sensitivities,
)

FIRST_ROUND = 300
LEAST_FAILED = 100
"""Failing points before which a coefficient of variation is not believed."""

EVEN = 0.02
"""Share of one weight above which sampling goes on although the target is met."""

HEAVY = 0.05
"""Share of one weight in the whole estimate at which it is not to be trusted."""

MOST_FURTHER = 20
"""Design points added because samples failed that no known one explains."""


class Sample:
    """All points drawn so far, with the ratio of each component at each."""

    def __init__(self, inputs: int, components: list[Component]) -> None:
        self.components = components
        self.u = np.empty((0, inputs))
        self.failed = np.empty(0, dtype=bool)
        self.log_ratios = np.empty((0, len(components)))
        self.drawn = np.zeros(len(components))

    def add_components(self, new: list[Component]) -> None:
        self.components = self.components + new
        columns = [component.log_ratio(self.u)[:, None] for component in new]
        self.log_ratios = np.concatenate([self.log_ratios, *columns], axis=1)
        self.drawn = np.concatenate([self.drawn, np.zeros(len(new))])

    def draw(
        self, g: Evaluator, share: np.ndarray, count: int, rng: np.random.Generator
    ) -> None:
        # Systematic counts: what a component gets differs from its share by less than one.
        edges = np.concatenate([[0.0], np.cumsum(share)]) * count / share.sum()
        counts = np.diff(np.floor(edges + rng.uniform())).astype(int)
        parts = zip(self.components, counts, strict=True)
        u = np.concatenate([c.draw(rng, int(k)) for c, k in parts if k])
        ratios = np.stack([component.log_ratio(u) for component in self.components], axis=1)
        self.failed = np.concatenate([self.failed, g(u) <= 0.0])
        self.u = np.concatenate([self.u, u])
        self.log_ratios = np.concatenate([self.log_ratios, ratios])
        self.drawn += counts

    def ratios(self) -> Float[np.ndarray, " sample"]:
        """Standard normal density over that of the mixture."""
        with np.errstate(divide="ignore"):
            share = np.log(self.drawn / self.drawn.sum())
        return np.asarray(np.exp(-np.logaddexp.reduce(share + self.log_ratios, axis=1)))

    def weights(self) -> Float[np.ndarray, " sample"]:
        """Contribution of each point to the probability, times their number."""
        return np.where(self.failed, self.ratios(), 0.0)


def importance(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    search: Search | None = None,
    points: Found | None = None,
) -> Result:
    """Importance sampling with a mixture about all design points.

    Broad components look everywhere else; a point that fails there, and that no design point
    explains, starts a further search. Where few weights make up the estimate, it warns.

    Parameters
    ----------
    search
        Settings of the search for design points.
    points
        Design points that are already known; no others are searched for beforehand.
    """
    g = Evaluator(problem)
    found = find_design_points(g, rng, search) if points is None else points
    sample, about_points = explore(g, rng, stopping, found, search or Search())
    weight = sample.weights()
    value, variation = _estimate(weight)
    warnings = () if found.points else found.warnings
    return sampled(
        "importance",
        value,
        variation,
        g.calls,
        stopping,
        design_points=tuple(
            sensitivities(problem, p) for p in sorted(about_points, key=lambda p: abs(p.beta))
        ),
        warnings=(*warnings, *_degenerate(weight)),
    )


def explore(
    g: Evaluator, rng: np.random.Generator, stopping: Stopping, found: Found, search: Search
) -> tuple[Sample, list[DesignPoint]]:
    """Draw until the target is met; the sample, and the design points known at the end."""
    points = list(found.points)
    components = [c for point in points for c in about(point)] + broad(g.problem.size)
    sample = Sample(g.problem.size, components)
    share = first_shares(components)
    further = 0
    count = FIRST_ROUND + 10 * len(components)
    while True:
        sample.draw(g, share, min(count, max(stopping.calls - g.calls, 1)), rng)
        weight = sample.weights()
        value, variation = _estimate(weight)
        hits = int(sample.failed.sum())
        if g.calls >= stopping.calls:
            return sample, points
        if further < MOST_FURTHER and value > 0.0:
            new = _unexplained(g, sample, weight, points, search)
            if new:
                further += len(new)
                points += new
                sample.add_components([c for point in new for c in about(point)])
                share = _learnt(sample, weight)
                count = FIRST_ROUND
                continue
        even = value > 0.0 and weight.max() <= EVEN * weight.sum()
        if variation <= stopping.variation and hits >= LEAST_FAILED and even:
            return sample, points
        share = _learnt(sample, weight) if hits >= 10 else share
        count = _more(variation, len(weight), stopping)


def _estimate(weight: np.ndarray) -> tuple[float, float]:
    value = float(weight.mean())
    if value <= 0.0:
        return 0.0, np.inf
    return value, float(weight.std(ddof=1) / np.sqrt(len(weight)) / value)


def _learnt(sample: Sample, weight: np.ndarray) -> np.ndarray:
    failed = sample.failed
    start = np.full(len(sample.components), 1.0 / len(sample.components))
    wide = np.array([component.kind == "broad" for component in sample.components])
    return learnt_shares(sample.log_ratios[failed], weight[failed] / weight.sum(), start, wide)


def _more(variation: float, drawn: int, stopping: Stopping) -> int:
    """As many points as the target still needs, but at most as many as there are."""
    if not np.isfinite(variation):
        return drawn
    needed = drawn * ((variation / stopping.variation) ** 2 - 1.0)
    return int(np.clip(1.05 * needed, 100, max(drawn, FIRST_ROUND)))


def _unexplained(
    g: Evaluator,
    sample: Sample,
    weight: np.ndarray,
    points: list[DesignPoint],
    search: Search,
) -> list[DesignPoint]:
    """A design point near the heaviest failing sample beyond no known tangent plane."""
    if not points:
        return []
    heavy = np.flatnonzero(weight > HEAVY / 5.0 * weight.sum())
    heavy = heavy[~explained(sample.u[heavy], points)]
    if not len(heavy):
        return []
    start = sample.u[heavy[int(np.argmax(weight[heavy]))]]
    point = descend_from(g, start, points, search)
    return [] if point is None else [point]


def _degenerate(weight: np.ndarray) -> tuple[str, ...]:
    if not weight.sum() > 0.0:
        return ()
    heaviest = float(weight.max() / weight.sum())
    if heaviest <= HEAVY:
        return ()
    return (
        f"One point of {len(weight)} carries {100 * heaviest:.0f} % of the probability: "
        "failures lie where few points were drawn, and the interval is too narrow. Use subset "
        "simulation.",
    )
