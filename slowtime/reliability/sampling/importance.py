r"""Importance sampling about all design points, with an adaptive mixture.

.. math:: P = \frac1N \sum_i \frac{\phi(u_i)}{\bar h(u_i)} [g(u_i) \le 0], \quad
          \bar h = \sum_k \bar\pi_k h_k

with :math:`\bar\pi_k` the share of all samples that component k has drawn (the balance
heuristic of Veach and Guibas 1995).

A mixture that hardly draws where most failures lie believes its error small. Chains that walk
from failing points to the distribution of failures itself (`failure_chains`) see such places:
the mean of their ratios is the second moment of the weights over the probability, by another
road than the weights themselves.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from slowtime.reliability.design_points.search import (
    DesignPointSearch,
    Search,
    descend_from,
    explained,
    find_design_points,
    sensitivities,
)
from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import DesignPoint, Result, Stopping, sampled

from .failure_chains import walk
from .mixture_density import (
    LOOKOUT,
    Component,
    about,
    about_chains,
    broad,
    first_shares,
    floored,
    learnt_shares,
)

MOST_PLANNED = 20_000
PILOT = 250
"""Points from which shares are learnt first, beside eight per component."""

AT_ONCE = 5
"""Heaviest failures of a lesson that get a component."""

NOTABLE = 0.03
"""Share of one weight in a lesson from which its point gets a component."""

LENIENT = 0.9
"""Factor on the error that the points learnt from foresee, which is uncertain itself."""

NEAR = 1.0
"""Distance within which one component serves two heavy points."""

LESSONS = 6
"""Rounds of learning at most."""

RESTARTS = 2
FAR = 3.0
"""Times the target above which, with enough failures, the mixture is learnt again."""

KEPT = 0.35
"""Part of the shares that stays as before whatever was learnt."""

FIRST_ROUND = 300
LEAST_FAILED = 150
"""Failing points before which a coefficient of variation is not believed."""

EVEN = 0.02
"""Share of one weight above which sampling goes on although the target is met."""

HEAVY = 0.05
"""Share of one weight in the whole estimate at which it is not to be trusted."""

LEAST_TAUGHT = 10
"""[failures] From which anything is learnt. Source: a share that is told by ten is known to a
third."""

MISSED = 3.0
"""[1] Variance that chains see over that which the weights see, beyond which the interval is
doubted. Source: on mixtures that cover all failures the scatter of chains stays below
(`tests/slowtime/reliability/coverage.py`)."""

REACH = 36.0
"""Distance from the origin from which a design point is left out: the probability beyond it,
1e-283, is near the least that double precision holds."""


class MixtureSample:
    """All points drawn so far, with the ratio of each component at each."""

    def __init__(self, inputs: int, components: list[Component]) -> None:
        self.components = components
        self.u = np.empty((0, inputs))
        self.failed = np.empty(0, dtype=bool)
        self.log_ratios = np.empty((0, len(components)))
        self.drawn = np.zeros(len(components))
        self.walked = np.empty((0, inputs))
        """Ends of chains that walked from the failures [chain input]."""
        self.lowered: list[int] = []
        """Which components are tails that begin where chains ended."""

    def add_components(self, new: list[Component]) -> None:
        """Add components that have drawn nothing yet."""
        self.components = self.components + new
        columns = [component.log_ratio(self.u)[:, None] for component in new]
        self.log_ratios = np.concatenate([self.log_ratios, *columns], axis=1)
        self.drawn = np.concatenate([self.drawn, np.zeros(len(new))])

    def draw(
        self, g: Evaluator, share: np.ndarray, count: int, rng: np.random.Generator
    ) -> None:
        """Draw points by their shares, and evaluate the limit state there."""
        # Systematic counts: what a component gets differs from its share by less than one.
        edges = np.concatenate([[0.0], np.cumsum(share)]) * count / share.sum()
        counts = np.diff(np.floor(edges + rng.uniform())).astype(int)
        parts = zip(self.components, counts, strict=True)
        u = np.concatenate([c.draw(rng, int(k)) for c, k in parts if k])
        ratios = _log_ratios(self.components, u)
        self.failed = np.concatenate([self.failed, g(u) <= 0.0])
        self.u = np.concatenate([self.u, u])
        self.log_ratios = np.concatenate([self.log_ratios, ratios])
        self.drawn += counts

    def join(self, other: "MixtureSample") -> None:
        """Take over the points of another sample of the same components."""
        for name in ("u", "failed", "log_ratios"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(other, name)]))
        self.drawn = self.drawn + other.drawn

    def ratios(self) -> Float[np.ndarray, " sample"]:
        """Divide the standard normal density by that of the mixture."""
        if not len(self.u):
            return np.empty(0)
        return self._ratios(self.log_ratios)

    def ratios_at(
        self, other: "MixtureSample", which: np.ndarray
    ) -> Float[np.ndarray, " sample"]:
        """Ratios of the standard normal density to this mixture at points of another sample."""
        return self._ratios(other.log_ratios[which])

    def reached(self, points: Sequence[DesignPoint]) -> Bool[np.ndarray, " sample"]:
        """Which points a design point explains, or a tail that begins where chains ended."""
        beyond = np.isfinite(self.log_ratios[:, self.lowered]).any(axis=1)
        return np.asarray(explained(self.u, list(points)) | beyond)

    def missed(self) -> float:
        """Second moment of the weights by the chains over that by the weights [1]."""
        # Much above one where chains end in failures that were hardly drawn.
        weight = self.weights()
        if not len(self.walked) or not weight.any():
            return 0.0
        most = weight.max()
        own = float(np.mean((weight / most) ** 2) / np.mean(weight / most)) * most
        return float(np.mean(self.ratios_of(self.walked)) / own)

    def ratios_of(self, u: Float[np.ndarray, "point input"]) -> Float[np.ndarray, " point"]:
        """Divide the standard normal density by that of the mixture, at any points."""
        return self._ratios(_log_ratios(self.components, u))

    def _ratios(self, log_ratios: Float[np.ndarray, "point component"]) -> np.ndarray:
        with np.errstate(divide="ignore"):
            share = np.log(self.drawn / self.drawn.sum())
        return np.asarray(np.exp(-np.logaddexp.reduce(share + log_ratios, axis=1)))

    def weights(self) -> Float[np.ndarray, " sample"]:
        """Contribution of each point to the probability, times their number."""
        return np.where(self.failed, self.ratios(), 0.0)


def _log_ratios(components: Sequence[Component], u: np.ndarray) -> np.ndarray:
    return np.stack([component.log_ratio(u) for component in components], axis=1)


def importance(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    search: Search | None = None,
    points: DesignPointSearch | None = None,
) -> Result:
    """Sample by importance from a mixture about all design points.

    Broad components look everywhere else; a point that fails there, and that no design point
    explains, starts a further search. Where few weights make up the estimate, it warns.

    Parameters
    ----------
    problem
        Inputs and limit state.
    rng
        Generator of the samples.
    stopping
        Targets of the sampling.
    search
        Settings of the search for design points.
    points
        Design points that are already known; no others are searched for beforehand.

    Returns
    -------
    Probability of failure, with its interval and the design points.
    """
    g = Evaluator(problem)
    found = find_design_points(g, rng, search) if points is None else points
    sample, about_points = explore(g, rng, stopping, found, search or Search())
    weight = sample.weights()
    value, variation = _estimate(sample)
    return sampled(
        "importance",
        value,
        variation,
        g.calls,
        stopping,
        design_points=tuple(
            sensitivities(problem, p) for p in sorted(about_points, key=lambda p: abs(p.beta))
        ),
        # Chains that have walked tell better what a search without a design point suspects.
        warnings=(
            *(() if found.points or len(sample.walked) else found.warnings),
            *_doubts(sample, weight),
        ),
    )


def explore(
    g: Evaluator,
    rng: np.random.Generator,
    stopping: Stopping,
    found: DesignPointSearch,
    search: Search,
) -> tuple[MixtureSample, list[DesignPoint]]:
    """Draw until the target is met; the sample that counts, and all design points."""
    # Shares are learnt from points that are not counted: a mixture that has seen its own points
    # underestimates what lies between them.
    points = [point for point in found.points if abs(point.beta) < REACH]
    components = [c for point in points for c in about(point)] + broad(g.problem.size)
    learning = MixtureSample(g.problem.size, components)
    share = first_shares(components)
    restarts = 0
    while True:
        share = _learn(g, learning, share, points, search, stopping, rng)
        counted = MixtureSample(g.problem.size, learning.components)
        again, variation = False, np.inf
        while not again:
            if len(counted.u):
                more = _more(variation, len(counted.u), stopping)
            else:
                more = _needed(learning, share, stopping)
            counted.draw(g, share, _allowed(g, stopping, more), rng)
            variation = _foreseen(counted, learning)
            failed = int(counted.failed.sum())
            met = variation <= stopping.variation and failed >= LEAST_FAILED
            if (met and _even(counted, learning)) or g.calls >= stopping.calls:
                return counted, points
            far = variation > FAR * stopping.variation and failed >= LEAST_FAILED
            again = restarts < RESTARTS and far
        restarts += 1
        learning.join(counted)


def _needed(learning: MixtureSample, share: np.ndarray, stopping: Stopping) -> int:
    """Points for the target, decided before any is drawn: no luck of theirs ends it."""
    failed = learning.failed
    if not failed.any():
        return FIRST_ROUND
    theirs = learning.ratios()[failed]
    logs = np.log(share / share.sum()) + learning.log_ratios[failed]
    spread = _spread(theirs, np.exp(-np.logaddexp.reduce(logs, axis=1)), len(learning.u))
    return int(np.clip(spread / stopping.variation**2, FIRST_ROUND, MOST_PLANNED))


def _foreseen(counted: MixtureSample, learning: MixtureSample) -> float:
    """Coefficient of variation by the points counted, or those learnt from if that is more."""
    # Between components few points carry much. A sample that has met none of them believes its
    # error small; the other sample has had chances of its own. Its second moment is that of the
    # mixture that counts: the mean of its weights times those.
    value, variation = _estimate(counted)
    failed = learning.failed
    if not value > 0.0 or not failed.any():
        return variation
    theirs = learning.ratios()[failed]
    spread = max(_spread(theirs, counted.ratios_at(learning, failed), len(failed)), 0.0)
    if len(learning.walked):
        counted.walked = learning.walked
        spread = max(spread, float(np.mean(counted.ratios_of(learning.walked))) / value - 1.0)
    return max(variation, float(np.sqrt(spread / len(counted.u))) * LENIENT)


def _spread(
    drawn: Float[np.ndarray, " failed"], counted: Float[np.ndarray, " failed"], count: int
) -> float:
    """Variance of the weights over their squared mean, by ratios at the points that failed."""
    # Over all `count` points, of which those that did not fail add nothing. Ratios are scaled
    # first, since the squares of very small ones would vanish.
    most = float(drawn.max())
    square = float(np.sum(drawn / most * (counted / most)))
    return square * count / float(np.sum(drawn / most)) ** 2 - 1.0


def _even(counted: MixtureSample, learning: MixtureSample) -> bool:
    """Whether no point, nor one learnt from were it to come again, carries too much."""
    weight = counted.weights()
    most = weight.max()
    if learning.failed.any():
        most = max(most, counted.ratios_at(learning, learning.failed).max())
    return bool(most <= EVEN * weight.sum())


def _learn(
    g: Evaluator,
    learning: MixtureSample,
    share: np.ndarray,
    points: list[DesignPoint],
    search: Search,
    stopping: Stopping,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw and learn until no point is much heavier than others; components are added."""
    # Chains say at which distances along the axes of design points failures lie. A heavy
    # failure that nothing explains starts a descent to a further design point; any other gets a
    # component of its own.
    unseen = True
    for number in range(LESSONS):
        count = PILOT + 8 * len(learning.components)
        learning.draw(g, share, _allowed(g, stopping, count), rng)
        weight = learning.weights()
        seen: list[Component] = []
        if unseen and g.calls < stopping.calls:
            unseen = _walked(g, learning, weight, rng)
            seen = about_chains(learning.walked, points)
            first = len(learning.components)
            learning.add_components(seen)
            learning.lowered += [first + k for k, c in enumerate(seen) if c.kind == "tail"]
        new, at = _further(g, learning, weight, points, search)
        points += new
        own = [c for point in new for c in about(point)] + at
        learning.add_components(own)
        added = len(seen) + len(own)
        share = np.append(share, np.full(added, share.mean()))
        share = _learnt(learning, share / share.sum(), points)
        # The second round is drawn from what was learnt, and tells how well that does.
        if (number and not added) or g.calls >= stopping.calls:
            break
    return share


def _walked(
    g: Evaluator, learning: MixtureSample, weight: np.ndarray, rng: np.random.Generator
) -> bool:
    """Let chains walk from the failures; whether they end where few points were drawn."""
    failed = learning.failed
    if failed.sum() < LEAST_TAUGHT:
        return True
    learning.walked = walk(g, learning.u[failed], weight[failed], rng)
    return bool(learning.missed() > MISSED)


def _allowed(g: Evaluator, stopping: Stopping, count: int) -> int:
    return max(min(count, stopping.calls - g.calls), 1)


def _estimate(sample: MixtureSample) -> tuple[float, float]:
    """Probability and its coefficient of variation."""
    # As if each point came from the mixture. That components get fixed numbers of points
    # lessens the error somewhat; by their own spreads it was underestimated where they get few.
    weight = sample.weights()
    value = float(weight.mean()) if len(weight) else 0.0
    if value <= 0.0:
        return 0.0, np.inf
    # Scaled, since the squares of very small weights would vanish.
    return value, float((weight / value).std(ddof=1) / np.sqrt(len(weight)))


def _learnt(sample: MixtureSample, before: np.ndarray, points: list[DesignPoint]) -> np.ndarray:
    """Shares by what failed so far, and in part as before: few failures teach little."""
    weight = sample.weights()
    failed = sample.failed
    if failed.sum() < LEAST_TAUGHT:
        return before
    wide = np.array([component.kind == "broad" for component in sample.components])
    start = np.full(len(wide), 1.0 / len(wide))
    part = weight[failed] / weight.sum()
    # What nothing explains lies between components, where few points carry much.
    between = float(part[~sample.reached(points)[failed]].sum())
    doubt = min(4.0 * between, 1.0)
    if _spherical(points, sample.u.shape[1]):
        doubt = 1.0
    lookout = LOOKOUT + doubt * (0.5 - LOOKOUT)
    logs = sample.log_ratios[failed]
    if len(sample.walked):
        # Chains say where failures are, the weights how many: where they agree, so do both.
        logs = np.concatenate([logs, _log_ratios(sample.components, sample.walked)])
        ends = np.full(len(sample.walked), 0.5 / len(sample.walked))
        part = np.concatenate([0.5 * part, ends])
    learnt = learnt_shares(logs, part, start, wide, lookout=lookout)
    kept = KEPT * (1.0 + doubt)
    return floored((1.0 - kept) * learnt + kept * before, wide, lookout)


def _spherical(points: list[DesignPoint], inputs: int) -> bool:
    """Whether there are more tangent planes than a polyhedron needs."""
    return len(points) > 2 * inputs + 2


def _more(variation: float, drawn: int, stopping: Stopping) -> int:
    """As many points as the target still needs, but at most as many as there are."""
    if not drawn:
        return FIRST_ROUND
    if not np.isfinite(variation):
        return drawn
    needed = drawn * ((variation / stopping.variation) ** 2 - 1.0)
    return int(np.clip(1.05 * needed, 50, drawn))


def _further(
    g: Evaluator,
    sample: MixtureSample,
    weight: np.ndarray,
    points: list[DesignPoint],
    search: Search,
) -> tuple[list[DesignPoint], list[Component]]:
    """Design points and components for the heaviest failures."""
    heavy = np.flatnonzero(weight > NOTABLE * weight.sum())
    heavy = heavy[np.argsort(-weight[heavy])]
    reached = sample.reached(points)
    new: list[DesignPoint] = []
    at: list[Component] = []
    centres: list[np.ndarray] = []
    for which in heavy:
        u = sample.u[which]
        if any(np.linalg.norm(u - centre) < NEAR for centre in centres):
            continue
        centres.append(u)
        known = points + new
        told = reached[which] or explained(u[None], new)[0]
        if known and not told and not _spherical(known, len(u)):
            point = descend_from(g, u, known, search)
            if point is not None:
                new.append(point)
                continue
        size = float(np.linalg.norm(u))
        at.append(Component("shift", u / size, size))
        if len(centres) == AT_ONCE:
            break
    return new, at


def _doubts(sample: MixtureSample, weight: np.ndarray) -> tuple[str, ...]:
    if not weight.sum() > 0.0:
        return ()
    heaviest = float(weight.max() / weight.sum())
    if heaviest > HEAVY:
        return (
            f"One point of {len(weight)} carries {100 * heaviest:.0f} % of the probability: "
            "failures lie where few points were drawn, and the interval is too narrow. Use "
            "subset simulation.",
        )
    if sample.missed() > MISSED:
        return (
            f"Chains that walk from the failures see {sample.missed():.2g} times the variance "
            "that the points drawn see: failures lie where few were drawn, and the interval is "
            "too narrow. Use subset simulation.",
        )
    return ()
