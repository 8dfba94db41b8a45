r"""System reliability: bounds, and series or parallel systems by multivariate normal.

Each part of a `System` is linearised at its design point. With indices :math:`\beta_k` and
correlations :math:`\rho_{kl} = \alpha_k^T \alpha_l`, a series system fails in the union of the
half-spaces, a parallel one in their intersection. Without parts, the design points of a single
limit state are taken for the parts of a series system.
"""

import numpy as np
from jaxtyping import Float
from scipy import integrate
from scipy.special import ndtr

from slowtime.reliability.problem import Evaluator, Problem, System
from slowtime.reliability.result import DesignPoint, Result, Stopping, approximated

from .multinormal import orthant, sequential
from .search import Search, find_design_points, sensitivities


def system(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    search: Search | None = None,
) -> Result:
    """Probability of a system by FORM of its parts, with Ditlevsen's bounds for a series.

    The bounds hold for the half-spaces. Of a parallel system they are the simple ones.

    References
    ----------
    .. [1] O. Ditlevsen, "Narrow reliability bounds for structural systems", J. Struct. Mech. 7
       (1979) 453-472.
    """
    limit_state = problem.limit_state
    points: list[DesignPoint] = []
    warnings: list[str] = []
    calls = 0
    kind = limit_state.kind if isinstance(limit_state, System) else "series"
    if isinstance(limit_state, System):
        for name, part in limit_state.parts.items():
            g = Evaluator(problem, part)
            found = find_design_points(g, rng, search)
            calls += g.calls
            if not found.points:
                warnings.append(f"Part {name!r}: {found.warnings[0]} It is left out.")
                continue
            # A part with several design points is a series of its own within a series.
            points += found.points if kind == "series" else found.points[:1]
            if kind == "parallel" and len(found.points) > 1:
                warnings.append(f"Part {name!r} has several design points; the nearest counts.")
    else:
        g = Evaluator(problem)
        found = find_design_points(g, rng, search)
        points, calls = list(found.points), g.calls
        warnings += found.warnings
    if not points:
        raise ValueError("No part has a design point. Use a sampling method instead.")
    betas = np.array([point.beta for point in points])
    alphas = np.stack([point.alpha for point in points])
    correlation = alphas @ alphas.T
    if kind == "series":
        value = sequential(betas, correlation, rng)
        bounds = ditlevsen(betas, correlation)
        # Of few parts the bounds are nearly one value, and the union is sampled.
        value = float(np.clip(value, *bounds))
    else:
        value = orthant(-betas, correlation, rng)
        bounds = parallel_bounds(betas, correlation)
    return approximated(
        "system",
        value,
        calls,
        why="an approximation: each part is replaced by a plane",
        design_points=tuple(sensitivities(problem, p) for p in sorted(points, key=_beta)),
        warnings=tuple(warnings),
        bounds=bounds,
    )


def _beta(point: DesignPoint) -> float:
    return point.beta


def joint(one: float, other: float, rho: float) -> float:
    r"""Probability that two standard normal variables exceed `one` and `other` together.

    As :math:`\Phi(-\beta_1) \Phi(-\beta_2) + \int_0^\rho \phi_2(\beta_1, \beta_2; r) \, dr`
    (Plackett 1954), which keeps its digits far out in the tail.

    References
    ----------
    .. [1] R. L. Plackett, "A reduction formula for normal multivariate integrals", Biometrika
       41 (1954) 351-360.

    Examples
    --------
    >>> round(joint(0.0, 0.0, 0.5), 9)  # 1/4 + arcsin(1/2) / 2 pi
    0.333333333
    """
    if rho >= 1.0 - 1e-9:
        return float(ndtr(-max(one, other)))
    if rho <= -1.0 + 1e-9:
        return float(max(ndtr(-one) - ndtr(other), 0.0))

    def density(angle: float) -> float:
        r = np.sin(angle)
        square = one**2 + other**2 - 2.0 * r * one * other
        return float(np.exp(-0.5 * square / np.cos(angle) ** 2) / (2.0 * np.pi))

    grown, _ = integrate.quad(density, 0.0, float(np.arcsin(rho)), epsabs=0.0, epsrel=1e-8)
    return max(float(ndtr(-one) * ndtr(-other)) + grown, 0.0)


def ditlevsen(
    betas: Float[np.ndarray, " part"], correlation: Float[np.ndarray, "part part"]
) -> tuple[float, float]:
    r"""Bounds of the probability of a union of half-spaces (Ditlevsen).

    .. math:: P_1 + \sum_{k=2} \max\Big(0, P_k - \sum_{l<k} P_{kl}\Big) \le P \le
              \sum_k P_k - \sum_{k=2} \max_{l<k} P_{kl}

    with the parts in falling order of their probabilities.

    Parameters
    ----------
    betas
        Reliability index of each part [1].
    correlation
        Correlations of the parts' safety margins [1].

    Returns
    -------
    Lower and upper bound of the probability [1].

    References
    ----------
    .. [1] O. Ditlevsen, "Narrow reliability bounds for structural systems", J. Struct. Mech. 7
       (1979) 453-472.

    Examples
    --------
    >>> lo, hi = ditlevsen(np.array([2.0, 3.0]), np.eye(2))
    >>> bool(lo == hi)  # of two parts they are exact
    True
    """
    order = np.argsort(betas)
    betas, correlation = betas[order], correlation[np.ix_(order, order)]
    alone = ndtr(-betas)
    lo = hi = float(alone[0])
    for k in range(1, len(betas)):
        pairs = [joint(betas[k], betas[i], float(correlation[k, i])) for i in range(k)]
        lo += max(float(alone[k]) - sum(pairs), 0.0)
        hi += float(alone[k]) - max(pairs)
    return min(lo, 1.0), min(hi, 1.0)


def parallel_bounds(
    betas: Float[np.ndarray, " part"], correlation: Float[np.ndarray, "part part"]
) -> tuple[float, float]:
    """Bounds of the probability of an intersection of half-spaces [1].

    The upper one is the least probability of a pair of parts. The lower one is the product of
    the parts' probabilities where no correlation is negative, and 0 otherwise.
    """
    alone = ndtr(-betas)
    pairs = [
        joint(betas[i], betas[j], float(correlation[i, j]))
        for i in range(len(betas))
        for j in range(i)
    ]
    lo = float(np.prod(alone)) if np.all(correlation >= -1e-12) else 0.0
    return lo, float(min([float(alone.min()), *pairs]))
