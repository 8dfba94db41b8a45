r"""Polyreference least-squares complex frequency-domain estimation (pLSCF) of poles.

Frequency responses are modelled by a right matrix fraction in the variable
:math:`z = e^{j \omega \Delta t}`,

.. math:: H_o(\omega) = B_o(z) A(z)^{-1}, \qquad
          A(z) = \sum_{r=0}^{n} A_r z^r, \quad A_0 = I ,

and the equation error :math:`w_o (B_o - H_o A)` is least squares in its coefficients. The
numerators are eliminated output by output. With the lowest coefficient fixed, poles that only
fit noise come out unstable [2]_ and are told from those of the structure; the poles are the
roots of :math:`\det A(z)`. The band alone is mapped onto the unit circle, with complex
coefficients, so that it needs no poles of negative frequency.

Errors of the poles travel to first order from draws of the noise of the frequency responses.

References
----------
.. [1] P. Guillaume, P. Verboven, S. Vanlanduit, H. Van der Auweraer, B. Peeters, "A
   poly-reference implementation of the least-squares complex frequency-domain estimator",
   IMAC 21 (2003).
.. [2] B. Cauberghe, P. Guillaume, P. Verboven, E. Parloo, S. Vanlanduit, "The influence of the
   parameter constraint on the stability of the poles and the discrimination capabilities of
   the stabilisation diagrams", MSSP 19 (2005).
"""

import numpy as np
from jaxtyping import Complex, Float

from slowtime.identification.subspace.poles import Poles

ARC = 0.8
"""[turns] Part of the unit circle that the band is mapped onto: of all of it, the two ends of
the band would have to be alike; of much less, the equations are ill-conditioned."""

DRAWS = 12
"""Draws of the noise; a standard deviation from them has an error of 15 %."""

ENDLESS_S = 1e9
"""[s] Duration stated for these poles, whose draws count in full."""


def polyreference_poles(
    frequency_hz: Float[np.ndarray, " row"],
    response: Complex[np.ndarray, "row output input"],
    sd: Float[np.ndarray, "row output input"],
    *,
    order: int,
    rng: np.random.Generator,
) -> Poles:
    """Poles of all orders up to the highest, with first-order errors.

    `order` is the highest of the denominator, one for each mode and input. Shapes are over the
    outputs.
    """
    low, high = frequency_hz[0], frequency_hz[-1]
    step_s = ARC / (high - low)
    centre = np.exp(2j * np.pi * (frequency_hz - low) * step_s)
    powers = centre[:, None] ** np.arange(-order, order + 1)
    weight = 1.0 / np.sqrt(np.mean(sd**2, axis=2))
    draws = (rng.standard_normal((DRAWS, *sd.shape)) * sd).astype(complex)
    draws += 1j * rng.standard_normal(draws.shape) * sd
    draws /= np.sqrt(2.0)
    normal, moved, numerators = _normal(powers, response, weight, draws, order)
    inputs = response.shape[2]
    parts = []
    for n in range(1, order + 1):
        alpha, errors = _coefficients(normal, moved, n, inputs)
        z, right, left = _roots(alpha)
        inside = np.angle(z) % (2 * np.pi) <= 2 * np.pi * min(ARC + 0.1, 1.0)
        z, right, left = z[inside], right[:, inside], left[:, inside]
        slope = _slope(alpha, z, left, right)
        of_z = z[:, None] ** np.arange(n + 1)
        change = np.einsum("ip,pr,drij,jp->dp", left.conj(), of_z, errors, right)
        shape = _shapes(numerators, alpha, z, right)
        pole = (np.log(np.abs(z)) + 1j * (np.angle(z) % (2 * np.pi))) / step_s
        parts.append((n, pole + 2j * np.pi * low, shape, -change / (slope * z * step_s)))
    return Poles(
        order=np.concatenate([np.full(len(part[1]), part[0]) for part in parts]),
        pole=np.concatenate([part[1] for part in parts]),
        shape=np.concatenate([part[2] for part in parts], axis=1),
        draws=np.concatenate([part[3] for part in parts], axis=1),
        shape_draws=None,
        duration_s=ENDLESS_S,
    )


def _toeplitz(sequence: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Matrix of blocks [column index - row index] of a sequence over lags -n to n."""
    middle = sequence.shape[0] // 2
    index = np.arange(columns) - np.arange(rows)[:, None] + middle
    blocks = sequence[index]
    if blocks.ndim == 2:
        return np.asarray(blocks)
    return np.asarray(
        blocks.transpose(0, 2, 1, 3).reshape(rows * blocks.shape[2], columns * blocks.shape[3])
    )


def _normal(
    powers: np.ndarray,
    response: np.ndarray,
    weight: np.ndarray,
    draws: np.ndarray,
    order: int,
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return the normal matrix of the denominator, its draws, and what gives numerators."""
    inputs, count = response.shape[2], order + 1
    normal = np.zeros((count * inputs, count * inputs), dtype=complex)
    moved = np.zeros((len(draws), *normal.shape), dtype=complex)
    numerators = []
    for output in range(response.shape[1]):
        h, w = response[:, output], weight[:, output] ** 2
        first = _toeplitz(w @ powers, count, count)
        cross = np.einsum("fr,fi->ri", powers * w[:, None], h)[:, None, :]
        second = _toeplitz(cross, count, count)
        solved = np.linalg.solve(first, second)
        numerators.append(solved)
        outer = np.einsum("fi,fj->fij", h.conj(), h)
        third = _toeplitz(np.tensordot(powers.T * w, outer, 1), count, count)
        normal += third - second.conj().T @ solved
        for number, draw in enumerate(draws[:, :, output]):
            change = _toeplitz((powers.T * w @ draw)[:, None, :], count, count)
            both = np.einsum("fi,fj->fij", h.conj(), draw)
            both = both + both.conj().transpose(0, 2, 1)
            own = _toeplitz(np.tensordot(powers.T * w, both, 1), count, count)
            mixed = change.conj().T @ solved
            moved[number] += own - mixed - mixed.conj().T
    return normal, moved, numerators


def _coefficients(
    normal: np.ndarray, moved: np.ndarray, n: int, inputs: int
) -> tuple[np.ndarray, np.ndarray]:
    """Denominator of order n, lowest coefficient 1, and its errors."""
    size = (n + 1) * inputs
    inner, first = normal[inputs:size, inputs:size], normal[inputs:size, :inputs]
    ridge = 1e-14 * np.trace(inner).real / len(inner) * np.eye(len(inner))
    inverse = np.linalg.inv(inner + ridge)
    alpha = np.concatenate([np.eye(inputs), -inverse @ first])
    errors = np.zeros((len(moved), n + 1, inputs, inputs), dtype=complex)
    change = moved[:, inputs:size, :size] @ alpha
    errors[:, 1:] = -(inverse @ change).reshape(len(moved), n, inputs, inputs)
    return alpha.reshape(n + 1, inputs, inputs), errors


def _roots(alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roots of the determinant, and right and left null vectors there."""
    n, inputs = len(alpha) - 1, alpha.shape[1]
    companion = np.zeros((n * inputs, n * inputs), dtype=complex)
    companion[:-inputs, inputs:] = np.eye((n - 1) * inputs)
    companion[-inputs:] = -np.concatenate(list(alpha[:0:-1]), axis=1)
    # Of 1 / z: the polynomial backwards, as its lowest coefficient is the one that is 1.
    reverse = np.linalg.eigvals(companion)
    z = 1.0 / reverse[np.abs(reverse) > 1e-6]
    at = np.einsum("pr,rij->pij", z[:, None] ** np.arange(n + 1), alpha)
    u, _, vh = np.linalg.svd(at)
    return z, vh[:, -1].conj().T, u[:, :, -1].T


def _slope(alpha: np.ndarray, z: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return derivative of the singular value at each root by z."""
    order = np.arange(1, len(alpha))
    of_z = order * z[:, None] ** (order - 1)
    return np.asarray(np.einsum("ip,pr,rij,jp->p", left.conj(), of_z, alpha[1:], right))


def _shapes(
    numerators: list[np.ndarray], alpha: np.ndarray, z: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Deflections of the outputs at each root, of unit norm."""
    n, inputs = len(alpha) - 1, alpha.shape[1]
    flat = alpha.reshape((n + 1) * inputs, inputs)
    rows = []
    for solved in numerators:
        beta = solved[:, : (n + 1) * inputs] @ flat
        of_z = z[:, None] ** np.arange(len(beta))
        rows.append(np.einsum("pr,rj,jp->p", of_z, beta, right))
    shape = np.stack(rows)
    return np.asarray(shape / np.maximum(np.linalg.norm(shape, axis=0), 1e-300))
