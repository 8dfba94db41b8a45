r"""Orthonormal polynomials of each input distribution, and their products.

Monic polynomials of any law obey :math:`\pi_{k+1} = (x - a_k) \pi_k - b_k \pi_{k-1}`; with
:math:`\psi_k = \pi_k / \lVert \pi_k \rVert` they are orthonormal, so that the mean of an
expansion is its first coefficient and its variance the sum of the squares of the others.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

Law = Any
"""A frozen distribution of `scipy.stats`."""

NODES = 16
"""Of the quadrature that stands for a law without closed recurrence, in each interval."""

TAILS = np.array([0.0, *(10.0**-k for k in range(30, 0, -1)), 0.5])
"""Probabilities between which it is done, from either end: quantiles grow as logarithms."""

MOST_TERMS = 3000


def recurrence(law: Law, degree: int) -> tuple[np.ndarray, np.ndarray]:
    r"""Coefficients :math:`a_0 \dots a_p` and :math:`b_0 = 1, b_1 \dots b_p` of a law.

    Closed for the uniform (Legendre) and the normal law (Hermite); for any other by
    Stieltjes' procedure on Gauss–Legendre nodes of its probability.

    Examples
    --------
    >>> from scipy import stats
    >>> recurrence(stats.norm(), 2)[1]
    array([1., 1., 2.])
    """
    k = np.arange(degree + 1, dtype=float)
    name = getattr(getattr(law, "dist", None), "name", "")
    if name == "uniform":
        lo, hi = law.support()
        half = 0.5 * (hi - lo)
        b = np.where(k > 0, k**2 / np.where(k > 0, 4.0 * k**2 - 1.0, 1.0), 0.0) * half**2
        a = np.full(degree + 1, 0.5 * (hi + lo))
    elif name == "norm":
        a, b = np.full(degree + 1, float(law.mean())), k * float(law.var())
    else:
        a, b = _stieltjes(law, degree)
    return a, np.concatenate([[1.0], b[1:]])


def _stieltjes(law: Law, degree: int) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    widths = np.diff(TAILS)
    tail = (TAILS[:-1, None] + 0.5 * widths[:, None] * (nodes + 1.0)).ravel()
    points = np.concatenate([law.ppf(tail), law.isf(tail)])
    weight = np.tile((0.5 * widths[:, None] * weights).ravel(), 2)
    if not np.isfinite(points).all():
        raise ValueError(
            f"The law {law!r} has quantiles that are not finite. Give a law with finite "
            "moments, such as scipy.stats.lognorm(s=0.1)."
        )
    a, b = np.zeros(degree + 1), np.zeros(degree + 1)
    before, now, norm_before = np.zeros_like(points), np.ones_like(points), 1.0
    for k in range(degree + 1):
        norm = float(weight @ now**2)
        a[k] = float(weight @ (points * now**2)) / norm
        b[k] = norm / norm_before if k else 0.0
        before, now, norm_before = now, (points - a[k]) * now - b[k] * before, norm
    return a, b


def polynomials(
    x: Float[np.ndarray, " sample"], law: Law, degree: int
) -> Float[np.ndarray, "sample degree"]:
    r"""Orthonormal polynomials :math:`\psi_0 \dots \psi_p` of a law, at points.

    Parameters
    ----------
    x
        Points of one input, in its unit.
    law
        Distribution of the input.
    degree
        Highest degree p.

    Returns
    -------
    Values of the polynomials, from degree 0 to p.

    Examples
    --------
    >>> from scipy import stats
    >>> polynomials(np.array([0.5, 1.0]), stats.uniform(0, 1), 1).round(4)
    array([[1.    , 0.    ],
           [1.    , 1.7321]])
    """
    a, b = recurrence(law, degree)
    root = np.sqrt(b)
    values = np.ones((len(x), degree + 1))
    for k in range(degree):
        lower = root[k] * values[:, k - 1] if k else 0.0
        values[:, k + 1] = ((x - a[k]) * values[:, k] - lower) / root[k + 1]
    return values


def indices(
    inputs: int, degree: int, *, interaction: int | None = None, q_norm: float = 1.0
) -> Int[np.ndarray, "term input"]:
    r"""Degrees of each term: :math:`(\sum_i \alpha_i^q)^{1/q} \le p`, few inputs at a time.

    Parameters
    ----------
    inputs
        Number of inputs.
    degree
        Largest degree p of a term.
    interaction
        Most inputs in one term; all of them if None.
    q_norm
        Below 1 it drops terms in many inputs (hyperbolic truncation, Blatman and Sudret 2011).

    Returns
    -------
    Degree of each input in each term.

    Examples
    --------
    >>> indices(2, 2).tolist()
    [[0, 0], [0, 1], [0, 2], [1, 0], [1, 1], [2, 0]]
    """
    if degree < 1:
        raise ValueError(f"{degree=} leaves a constant only. Give 1 or more.")
    if not 0.0 < q_norm <= 1.0:
        raise ValueError(f"{q_norm=} is outside (0, 1]. Give 1 for all terms of a degree.")
    most = inputs if interaction is None else min(interaction, inputs)
    rows = [np.zeros(inputs, dtype=int)]
    for together in range(1, min(most, degree) + 1):
        shapes = [
            shape
            for shape in _compositions(degree, together)
            if sum(float(one) ** q_norm for one in shape) <= degree**q_norm + 1e-9
        ]
        if not shapes:
            break
        for which in itertools.combinations(range(inputs), together):
            block = np.zeros((len(shapes), inputs), dtype=int)
            block[:, which] = shapes
            rows.extend(block)
            if len(rows) > 4 * MOST_TERMS:
                raise ValueError(
                    f"Degree {degree} in {inputs} inputs has more than {4 * MOST_TERMS} "
                    "terms. Lower degree, interaction or q_norm."
                )
    found: Int[np.ndarray, "term input"] = np.array(sorted(rows, key=lambda row: row.tolist()))
    return found


def _compositions(total: int, parts: int) -> list[tuple[int, ...]]:
    """Positive degrees, as many as `parts`, that add up to `total` at most."""
    cuts = itertools.combinations(range(1, total + 1), parts)
    return [tuple(np.diff((0, *cut)).tolist()) for cut in cuts]


def products(
    x: Float[np.ndarray, "sample input"],
    laws: Sequence[Law],
    terms: Int[np.ndarray, "term input"],
) -> Float[np.ndarray, "sample term"]:
    """Products of one orthonormal polynomial per input, for each term.

    Parameters
    ----------
    x
        Points, each input in its own unit.
    laws
        Distribution of each input.
    terms
        Degree of each input in each term.

    Returns
    -------
    Values of the products.
    """
    values = np.ones((len(x), len(terms)))
    for i, law in enumerate(laws):
        table = polynomials(x[:, i], law, int(terms[:, i].max(initial=0)))
        used = terms[:, i] > 0
        values[:, used] *= table[:, terms[used, i]]
    return values


@dataclasses.dataclass(slots=True)
class PolynomialBasis:
    """Products of polynomials on inputs that come scaled to the box of a design.

    Remembers its answer for the points asked last: a search asks for the same again and again.
    """

    laws: Sequence[Law]
    terms: Int[np.ndarray, "term input"]
    lo: Float[np.ndarray, " input"]
    width: Float[np.ndarray, " input"]
    last: tuple[np.ndarray, np.ndarray] | None = dataclasses.field(default=None, repr=False)

    def __call__(self, unit: Float[np.ndarray, "sample input"]) -> np.ndarray:
        """Design matrix at points in units of the box."""
        last = self.last
        if last is None or last[0] is not unit:
            last = unit, products(self.lo + self.width * unit, self.laws, self.terms)
            self.last = last
        return last[1]
