r"""Correction of Schwarz's penalty for parameters that tolerances already bound.

Schwarz's half a logarithm of the data for each parameter supposes that every sample informs it.
A parameter that is known to one part in three has been informed little, and costs little
evidence. With a prior as wide as the parameters :math:`\theta` themselves, Laplace's
approximation gives

.. math:: \tfrac12 \log \det (I + D \Sigma^{-1} D), \quad D = \mathrm{diag} |\theta|

in place of :math:`\tfrac k2 \log n`. The tolerance of a damping is mostly a guess, so rivals
that differ only in how far they move it are not told apart for certain. Schwarz's stricter
penalty decides whether an effect is accepted; this one decides between rivals.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.discrepancy.calibration import Fit
from slowtime.discrepancy.candidates.parameter_scan import is_constant_change
from slowtime.discrepancy.thresholds import LIMITS
from slowtime.dynamics.effects import Kind

from .model_evidence import FittedCandidate, undetermined_parameters
from .significance import nothing_of

TOLERANCE_FACTOR = 5.0
"""[1] By which a tolerance may have been stated too small. Source: docs/decisions/0024."""
MISSTATED_PROBABILITY = 0.2
"""[probability] Prior that the tolerance of a damping was stated too small, where a candidate
moves it. Source: docs/decisions/0024."""


def leniency(
    named: FittedCandidate, kinds: Mapping[str, Kind], bare: Fit | None = None
) -> float:
    """Log evidence [nats] to give back to a candidate before it is compared with its rivals.

    It is what Schwarz's criterion charged too much for its parameters, and what dampings cost
    whose tolerance may be too small, and which `bare` does not move as far.
    """
    before = {} if bare is None else bare.pulls
    pulls = [
        pull
        for name, pull in named.fit.pulls.items()
        if name[0] == "damping" and abs(pull) > abs(before.get(name, 0.0)) + 1
    ]
    return _narrowed(named, kinds) + doubted(pulls)


def doubted(pulls: Sequence[float]) -> float:
    """Log evidence [nats] of constants by their pulls [stated tolerances]."""
    # Each tolerance is true, or too small by the factor `TOLERANCE_FACTOR`.
    either = np.logaddexp(
        np.log(1 - MISSTATED_PROBABILITY), np.log(MISSTATED_PROBABILITY) + relief(pulls)
    )
    return float(either.sum())


def relief(pulls: Sequence[float]) -> Float[np.ndarray, " pull"]:
    """Log evidence [nats] of each pull [stated tolerances] if its tolerance is too small."""
    excess = np.square(np.asarray(pulls, dtype=float)) / 2
    return np.asarray(excess * (1 - TOLERANCE_FACTOR**-2) - np.log(TOLERANCE_FACTOR))


def _narrowed(named: FittedCandidate, kinds: Mapping[str, Kind]) -> float:
    """Give what Schwarz took too much from numbers of the last effect."""
    kind, fit = kinds[named.effect.kind], named.fit
    which, hidden = len(named.description.effects) - 1, undetermined_parameters(fit)
    own = [
        at
        for at, name in enumerate(fit.prior.names)
        if name[:2] == ("effect", which) and name not in hidden
    ]
    if is_constant_change(kind) or not own:
        # A number that is not known is the limit of a simpler law.
        return 0.0
    size, sd = np.abs(fit.free[own] - nothing_of(kind)), fit.inflated_sd[own]
    if not (size >= LIMITS.seen_sds * sd).all():
        return 0.0
    scale = sd / fit.sd[own] / size
    inner = fit.covariance[np.ix_(own, own)] * np.outer(scale, scale)
    cost = np.sum(np.log1p(1 / np.maximum(np.linalg.eigvalsh(inner), 1e-300))) / 2
    return float(max(len(own) / 2 * np.log(fit.data) - cost, 0.0))
