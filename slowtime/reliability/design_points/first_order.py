r"""First-order methods: mean value (Cornell) and FORM (Hasofer–Lind)."""

import numpy as np
import scipy
from scipy.special import ndtr

from slowtime.reliability.problem import Conditional, Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, approximated

from .multinormal import union_of_halfspaces
from .search import Search, require_design_points, sensitivities

SHARE = 1e-3
"""Step of the derivatives at the mean, over each standard deviation."""


def mean_value(problem: Problem, rng: np.random.Generator, stopping: Stopping) -> Result:
    r"""Cornell's index: mean over standard deviation of the linearised limit state (eq. 4.9).

    .. math:: \beta = \frac{g(\mu)}{\sqrt{\nabla g^T C \, \nabla g}}

    It depends on how the limit state is written: `r - s` and `log(r / s)` are one event and
    have two indices. FORM does not have that fault.

    Examples
    --------
    >>> from slowtime.reliability.random_inputs.marginals import marginal
    >>> inputs = {"r": marginal("normal", mean=10.0, sd=1.2),
    ...           "s": marginal("normal", mean=5.0, sd=0.9)}
    >>> book = Problem(inputs, lambda x: x[:, 0] - x[:, 1])
    >>> round(mean_value(book, np.random.default_rng(0), Stopping()).beta, 6)
    3.333333
    """
    g = Evaluator(problem)
    mean, covariance = moments(problem)
    sd = np.sqrt(np.diag(covariance))
    u = problem.standard(mean + np.diag(SHARE * sd))
    values = g(np.concatenate([problem.standard(mean[None]), u]))
    slope = (values[1:] - values[0]) / (SHARE * sd)
    spread = float(np.sqrt(slope @ covariance @ slope))
    warnings = (
        "Mean-value index: it depends on how the limit state is written. Compare with FORM.",
    )
    if not spread > 0.0 or not np.isfinite(spread):
        raise ValueError(
            "The limit state does not vary at the mean of the inputs, so it has no mean-value "
            "index. Use FORM or a sampling method."
        )
    beta = float(values[0]) / spread
    return approximated(
        "mean-value",
        float(ndtr(-beta)),
        g.calls,
        why="an approximation of unknown error",
        warnings=warnings,
    )


def moments(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Mean [input] and covariance [input input] of the inputs; no call of the limit state."""
    laws = list(problem.inputs.values())
    if not problem.dependence and not any(isinstance(law, Conditional) for law in laws):
        return np.array([law.mean for law in laws]), np.diag([law.sd**2 for law in laws])
    # Fixed quasi-random points: the answer is the same each time.
    points = scipy.stats.qmc.MultivariateNormalQMC(np.zeros(problem.size), rng=0).random(2**14)
    x = problem.physical(np.asarray(points))
    covariance = np.atleast_2d(np.cov(x, rowvar=False))
    for k, law in enumerate(laws):
        if not isinstance(law, Conditional):
            scale = law.sd / np.sqrt(covariance[k, k])
            covariance[k] *= scale
            covariance[:, k] *= scale
    mean = [
        float(x[:, k].mean()) if isinstance(law, Conditional) else law.mean
        for k, law in enumerate(laws)
    ]
    return np.array(mean), covariance


def form(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    search: Search | None = None,
) -> Result:
    r"""First-order reliability method: tangent planes at the design points.

    With one design point :math:`P_f = \Phi(-\beta)`; with several, the probability of the
    union of the half-spaces beyond their tangent planes, by the multivariate normal
    distribution.

    Parameters
    ----------
    problem
        Inputs and limit state.
    rng
        Generator of the probes.
    stopping
        Targets of sampling; this method does not use them.
    search
        Settings of the search; `Search(rounds=0)` takes the first point that is found.

    Returns
    -------
    Probability of failure, and the design points.
    """
    g = Evaluator(problem)
    found = require_design_points(g, rng, search)
    points = tuple(sensitivities(problem, point) for point in found.points)
    warnings = found.warnings
    if len(points) > 1:
        warnings = (
            f"{len(points)} design points: the probability is that of the union of their "
            "half-spaces.",
            *warnings,
        )
    return approximated(
        "form",
        union_of_halfspaces(points, rng),
        g.calls,
        why="an approximation: the curvature of the limit state is neglected",
        design_points=points,
        warnings=warnings,
    )


__all__ = ["form", "mean_value", "moments"]
