"""Mixture of the laws that a history allows: the model that a twin adopts."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.estimation import hyperparameters
from slowtime.history_diagnosis.data.history import FeatureHistory
from slowtime.history_diagnosis.laws.laplace import (
    LaplaceFit,
    Point,
    evidence_function,
    log_process_prior,
    maximize_evidence,
    process_variants,
    shape_space,
)
from slowtime.history_diagnosis.laws.terms import ScreenedHistory, Term
from slowtime.history_diagnosis.likelihood.whitening import MaternProcess
from slowtime.history_diagnosis.selection.forward_selection import ModelComparison

_DRAWS = 32
"""[points] Of the importance sampling around each fit. Source: a bound on computing time."""
_NARROW_WIDTH = 1.0
"""[widths of the Laplace approximation] Of half the proposals. Source: the approximation
itself."""
_WIDE_WIDTH = 2.0
"""[widths of the Laplace approximation] Of the other half, which covers tails that are heavier
than Gaussian. Source: docs/what_decides.md: half and double change no answer."""
_SCALES = np.tile([_NARROW_WIDTH, _WIDE_WIDTH], _DRAWS // 2)
_LEAST_CURVATURE = 0.05
"""[1] Least eigenvalue of the scaled curvature. Source: docs/what_decides.md: half and double
change no answer."""
_LEAST_WEIGHT = 2e-3
"""[1] Of a member that is kept. Source: docs/what_decides.md: half and double change no
answer."""
_MOST_MEMBERS = 16
"""[members] Kept at most. Source: a bound on computing time."""
_LEAST_RIVAL = 0.02
"""[probability] Of a rival law that has a share in the band. Source: docs/what_decides.md: half
and double change no answer."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class EnsembleMember:
    """A law that the history allows, with its random process and weight [1]."""

    terms: tuple[Term, ...]
    process: MaternProcess
    weight: float


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class MixtureModel:
    """What a twin expects of later epochs.

    Parameters
    ----------
    past
        The history from which it was learnt.
    readings
        The same, scaled and screened.
    members
        Shapes of one law, with weights that sum to one.
    rivals
        Other laws that the history allows, with weights relative to the members, so that the
        band of a drift that is either linear or a power is as wide as both.
    names
        Of the effects that were adopted; none for the nominal model.
    before
        The model that it replaces; None for the nominal one.
    """

    past: FeatureHistory
    readings: ScreenedHistory
    members: tuple[EnsembleMember, ...]
    rivals: tuple[EnsembleMember, ...] = ()
    names: tuple[str, ...] = ()
    before: "MixtureModel | None" = None


def build_model(
    past: FeatureHistory,
    readings: ScreenedHistory,
    terms: tuple[Term, ...],
    process: MaternProcess,
    before: MixtureModel | None = None,
    rivals: tuple[EnsembleMember, ...] = (),
) -> MixtureModel:
    """Fit all terms together, with each variant of the process, and sample a mixture."""
    fits = [
        maximize_evidence(readings, (), terms, start) for start in process_variants(process)
    ]
    names = tuple(term.law.name for term in terms)
    return MixtureModel(past, readings, _sample(readings, fits), rivals, names, before)


def rival_members(comparisons: Sequence[ModelComparison]) -> tuple[EnsembleMember, ...]:
    """Return the rivals of each chosen term, no term included, with relative weights."""
    found = []
    for comparison in comparisons:
        chosen, *others = comparison.options
        found += [
            EnsembleMember(o.fit.terms, o.fit.process, o.probability / chosen.probability)
            for o in others
            if o.probability > _LEAST_RIVAL
        ]
    return tuple(found)


def undo(model: MixtureModel) -> MixtureModel:
    """Return the model as it was before the adoption.

    Raises
    ------
    ValueError
        If the model is the nominal one.
    """
    if model.before is None:
        raise ValueError(
            "This is the nominal model: nothing was adopted, so nothing can be undone. Undo a "
            "model that `adopt` gave."
        )
    return model.before


def _sample(readings: ScreenedHistory, fits: list[LaplaceFit]) -> tuple[EnsembleMember, ...]:
    """Draw members by importance sampling around the fits, from fixed (quasi-random) points."""
    drawn: list[tuple[float, tuple[Term, ...], MaternProcess]] = []
    for fit in fits:
        space = shape_space(readings, (), fit.terms, fit.process)
        score_at = evidence_function(readings, space)
        prior = (
            log_process_prior(fit.process) - np.log(np.ptp(space.box, axis=1) + 1e-300).sum()
        )
        if not len(space.start):
            drawn.append((fit.peak + prior, fit.terms, fit.process))
            continue
        factor = _covariance_factor(score_at, space.start, np.array(fit.spreads), space.box)
        log_volume = np.linalg.slogdet(factor)[1]
        for z, scale in zip(_normal_points(len(factor)), _SCALES, strict=True):
            point = space.start + scale * (factor @ z)
            score = score_at(point)
            if np.isfinite(score):
                proposal = float(_log_proposal(scale * z) - log_volume)
                weight = score + prior - proposal - np.log(_DRAWS)
                drawn.append((weight, space.terms_at(point), space.process_at(point)))
    weights = np.array([one[0] for one in drawn])
    shares = np.exp(weights - weights.max())
    shares /= shares.sum()
    best = [i for i in np.argsort(-shares)[:_MOST_MEMBERS] if shares[i] > _LEAST_WEIGHT]
    total = float(shares[best].sum())
    return tuple(
        EnsembleMember(drawn[i][1], drawn[i][2], float(shares[i]) / total) for i in best
    )


def _normal_points(dimensions: int) -> Float[np.ndarray, "draw coordinate"]:
    """Quasi-random standard normal points, the first of them at the origin."""
    points = hyperparameters.quasi_random_points(_DRAWS, dimensions)
    points[0] = 0.0
    return points


def _log_proposal(z: Point) -> float:
    """Log density of the mixture of narrow and wide proposals."""
    parts = [
        -0.5 * float(z @ z) / w**2 - len(z) * np.log(np.sqrt(2.0 * np.pi) * w)
        for w in (_NARROW_WIDTH, _WIDE_WIDTH)
    ]
    return float(np.logaddexp(*parts) - np.log(2.0))


def _covariance_factor(
    score: Callable[[np.ndarray], float],
    peak: Point,
    spreads: Point,
    box: Float[np.ndarray, "coordinate 2"],
) -> Float[np.ndarray, "coordinate coordinate"]:
    """Factor of the covariance around a peak, by differences as wide as the peak itself."""
    # A lag and the length of the random process compensate each other: along that ridge the
    # peak is wider than along either coordinate.
    count = len(peak)
    curvature = np.eye(count)
    for i in range(count):
        for j in range(i):
            corners = []
            for first, second in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
                point = peak.copy()
                point[[i, j]] += np.array([first, second]) * spreads[[i, j]]
                corners.append(score(np.clip(point, box[:, 0], box[:, 1])))
            mixed = -0.25 * (corners[0] + corners[1] - corners[2] - corners[3])
            if np.isfinite(mixed):
                curvature[i, j] = curvature[j, i] = np.clip(mixed, -0.95, 0.95)
    values, vectors = np.linalg.eigh(curvature)
    root = vectors / np.sqrt(np.maximum(values, _LEAST_CURVATURE))
    factor: Float[np.ndarray, "coordinate coordinate"] = spreads[:, None] * root
    return factor
