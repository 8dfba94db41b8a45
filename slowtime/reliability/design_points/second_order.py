r"""Second-order reliability method: curvatures at design points (Breitung, Tvedt)."""

from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from slowtime.reliability.problem import Evaluator, Problem
from slowtime.reliability.result import Result, Stopping, approximated

from .multinormal import union_of_halfspaces
from .search import Search, require_design_points, sensitivities

STEP = 1e-2
"""Second differences in standard normal space."""

Formula = Literal["breitung", "tvedt"]


def sorm(
    problem: Problem,
    rng: np.random.Generator,
    stopping: Stopping,
    *,
    formula: Formula = "breitung",
    search: Search | None = None,
) -> Result:
    r"""Second-order reliability method.

    Each design point's half-space is corrected by its principal curvatures
    :math:`\kappa_i`; several points count as in FORM, each with its own correction.

    .. math:: P_f \approx \Phi(-\beta) \prod_i (1 + \beta \kappa_i)^{-1/2} \quad
              \text{(Breitung)}

    Tvedt's formula adds two terms that matter where :math:`\beta` is small.

    References
    ----------
    .. [1] K. Breitung, "Asymptotic approximations for multinormal integrals", J. Eng. Mech.
       110 (1984) 357-366.
    .. [2] L. Tvedt, "Distribution of quadratic forms in normal space", J. Eng. Mech. 116
       (1990) 1183-1197.
    """
    if formula not in ("breitung", "tvedt"):
        raise ValueError(f"formula={formula!r}. Allowed: 'breitung', 'tvedt'.")
    g = Evaluator(problem)
    found = require_design_points(g, rng, search)
    warnings = list(found.warnings)
    plain = total = 0.0
    bent = 0
    for point in found.points:
        kappa = curvatures(g, point.u, point.alpha)
        corrected = second_order(point.beta, kappa, formula)
        if not np.isfinite(corrected) or not 0.0 <= corrected <= 1.0:
            bent += 1
            corrected = point.probability
        plain += point.probability
        total += corrected
    if bent:
        warnings.append(
            f"At {bent} of {len(found.points)} design points the limit state curves too "
            "strongly for SORM; their first-order values are used. Use a sampling method."
        )
    # The ratio of the union to the sum is taken over from the half-spaces.
    overlap = union_of_halfspaces(found.points, rng) / plain
    return approximated(
        f"sorm-{formula}",
        min(total * overlap, 1.0),
        g.calls,
        why="an approximation: only curvature at the design points is counted",
        design_points=tuple(sensitivities(problem, point) for point in found.points),
        warnings=tuple(warnings),
    )


def curvatures(
    g: Evaluator, u: Float[np.ndarray, " input"], alpha: Float[np.ndarray, " input"]
) -> Float[np.ndarray, " curvature"]:
    """Principal curvatures of a limit state at a design point, positive where it bends away.

    They are in rising order [1 / standard deviation]; NaN where they cannot be computed.
    """
    size = len(u)
    if size == 1:
        return np.empty(0)
    basis = np.linalg.qr(np.column_stack([alpha, np.eye(size)]))[0]
    tangent = basis[:, 1:].T
    count = size - 1
    rows, columns = np.triu_indices(count)
    steps = STEP * tangent
    # Four corners of each pair; of a direction with itself, two ends and the middle twice.
    corners = [
        u + a * steps[rows] + b * steps[columns]
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))
    ]
    values = g(np.concatenate(corners)).reshape(4, -1)
    second = (values[0] - values[1] - values[2] + values[3]) / (4.0 * STEP**2)
    hessian = np.zeros((count, count))
    hessian[rows, columns] = hessian[columns, rows] = second
    ends = g(np.stack([u + STEP * alpha, u - STEP * alpha]))
    slope = abs(float(ends[0] - ends[1])) / (2.0 * STEP)
    if not slope > 0.0 or not np.all(np.isfinite(hessian)):
        return np.full(count, np.nan)
    return np.asarray(np.linalg.eigvalsh(hessian / slope))


def second_order(
    beta: float, kappa: Float[np.ndarray, " curvature"], formula: Formula
) -> float:
    """Probability beyond a paraboloid by Breitung's or Tvedt's formula.

    NaN where the formula has none.

    References
    ----------
    .. [1] K. Breitung, "Asymptotic approximations for multinormal integrals", J. Eng. Mech. 110
       (1984) 357-366.
    .. [2] L. Tvedt, "Distribution of quadratic forms in normal space: application to structural
       reliability", J. Eng. Mech. 116 (1990) 1183-1197.

    Examples
    --------
    >>> round(second_order(3.0, np.zeros(2), "tvedt") / 0.0013498980316, 6)
    1.0
    """
    first = float(ndtr(-beta))
    if not np.all(1.0 + beta * kappa > 0.0):
        return float("nan")
    one = float(np.prod((1.0 + beta * kappa) ** -0.5))
    if formula == "breitung":
        return first * one
    if not np.all(1.0 + (beta + 1.0) * kappa > 0.0):
        return float("nan")
    two = float(np.prod((1.0 + (beta + 1.0) * kappa) ** -0.5))
    three = float(np.real(np.prod((1.0 + (beta + 1j) * kappa) ** -0.5)))
    mills = beta * first - float(np.exp(-0.5 * beta**2) / np.sqrt(2.0 * np.pi))
    return first * one + mills * (one - two) + (beta + 1.0) * mills * (one - three)
