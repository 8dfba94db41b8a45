r"""Mixtures of von Mises–Fisher directions and Nakagami radii.

.. math:: h(r, a) = \sum_k \pi_k \, N(r; m_k, \Omega_k) \, f_{vMF}(a; \mu_k, \kappa_k)

A component costs n + 3 parameters instead of the (n + 1)(n + 2) / 2 of a normal density, so
that it can be learnt in many inputs (Wang and Song 2016; Papaioannou et al. 2019).
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln, ive, logsumexp

Points = Float[np.ndarray, "sample input"]
STEPS = 25
LEAST_KAPPA, MOST_KAPPA = 1e-2, 1e4
LEAST_M, MOST_M = 0.5, 1e4


@dataclasses.dataclass(frozen=True, slots=True)
class PolarMixture:
    """Parameters of the mixture."""

    share: Float[np.ndarray, " component"]
    mean: Float[np.ndarray, "component input"]
    kappa: Float[np.ndarray, " component"]
    shape: Float[np.ndarray, " component"]
    spread: Float[np.ndarray, " component"]

    def log_parts(self, u: Points) -> Float[np.ndarray, "sample component"]:
        """Logarithm of share times density of each component."""
        radius = np.linalg.norm(u, axis=1)
        ways = u / radius[:, None]
        size = u.shape[1]
        direction = _log_vmf_constant(size, self.kappa) + self.kappa * (ways @ self.mean.T)
        m, w = self.shape, self.spread
        log_r = np.log(radius)[:, None]
        radial = (
            np.log(2.0) + m * np.log(m / w) - gammaln(m)
            + (2.0 * m - 1.0) * log_r - m / w * radius[:, None] ** 2
        )  # fmt: skip
        # Polar to Cartesian: the density in u divides by r^(n-1).
        return np.asarray(np.log(self.share) + direction + radial - (size - 1) * log_r)

    def log_density(self, u: Points) -> Float[np.ndarray, " sample"]:
        """Logarithm of the density of the mixture."""
        return np.asarray(logsumexp(self.log_parts(u), axis=1))

    def draw(self, rng: np.random.Generator, count: int) -> Points:
        """Random points."""
        counts = rng.multinomial(count, self.share / self.share.sum())
        parts = []
        for k, number in enumerate(counts):
            square = rng.gamma(self.shape[k], self.spread[k] / self.shape[k], size=number)
            ways = _vmf(rng, self.mean[k], float(self.kappa[k]), int(number))
            parts.append(np.sqrt(square)[:, None] * ways)
        return np.concatenate(parts)


def fit(
    u: Points, weights: Float[np.ndarray, " sample"], components: int, rng: np.random.Generator
) -> PolarMixture:
    """Fit a mixture to weighted points by expectation maximisation of the likelihood."""
    weights = weights / weights.sum()
    ways = u / np.linalg.norm(u, axis=1, keepdims=True)
    centres = _spread_out(ways, weights, components, rng)
    # Hard assignment to the nearest centre begins the iteration.
    nearest = np.argmax(ways @ centres.T, axis=1)
    parts = np.eye(len(centres))[nearest]
    found = _maximised(u, ways, weights[:, None] * parts)
    for _ in range(STEPS):
        logs = found.log_parts(u)
        parts = np.exp(logs - logsumexp(logs, axis=1, keepdims=True))
        found = _maximised(u, ways, weights[:, None] * parts)
    return found


def _maximised(u: np.ndarray, ways: np.ndarray, parts: np.ndarray) -> PolarMixture:
    parts = parts[:, parts.sum(axis=0) > 1e-4]
    share = parts.sum(axis=0)
    size = u.shape[1]
    total = parts.T @ ways
    length = np.linalg.norm(total, axis=1)
    mean = np.where(length[:, None] > 1e-12, total / np.maximum(length, 1e-300)[:, None], 0.0)
    mean[length <= 1e-12, 0] = 1.0
    r = np.clip(length / share, 0.0, 0.999)
    kappa = np.clip((r * size - r**3) / (1.0 - r**2), LEAST_KAPPA, MOST_KAPPA)
    square = np.sum(u**2, axis=1)
    spread = square @ parts / share
    fourth = square**2 @ parts / share
    with np.errstate(divide="ignore", invalid="ignore"):
        shape = spread**2 / (fourth - spread**2)
    shape = np.clip(np.where(np.isfinite(shape), shape, MOST_M), LEAST_M, MOST_M)
    return PolarMixture(share / share.sum(), mean, kappa, shape, spread)


def _spread_out(
    ways: np.ndarray, weights: np.ndarray, components: int, rng: np.random.Generator
) -> np.ndarray:
    """Centres far from each other, as k-means++ takes them."""
    centres = [ways[rng.choice(len(ways), p=weights)]]
    for _ in range(components - 1):
        gap = np.maximum(1.0 - np.max(ways @ np.stack(centres).T, axis=1), 0.0) * weights
        if not gap.sum() > 1e-12:
            break
        centres.append(ways[rng.choice(len(ways), p=gap / gap.sum())])
    return np.stack(centres)


def _log_vmf_constant(size: int, kappa: np.ndarray) -> np.ndarray:
    """Logarithm of the normalising constant on the sphere."""
    if size == 1:
        return np.asarray(-np.logaddexp(kappa, -kappa))
    order = 0.5 * size - 1.0
    with np.errstate(divide="ignore"):
        log_bessel = np.log(ive(order, kappa)) + kappa
    # For small arguments the series' first term, which does not underflow.
    small = order * np.log(0.5 * kappa) - gammaln(order + 1.0) + 0.25 * kappa**2 / (order + 1.0)
    log_bessel = np.where(np.isfinite(log_bessel), log_bessel, small)
    return np.asarray(order * np.log(kappa) - 0.5 * size * np.log(2.0 * np.pi) - log_bessel)


def _vmf(rng: np.random.Generator, mean: np.ndarray, kappa: float, count: int) -> np.ndarray:
    """Random directions by Wood's rejection method (1994)."""
    size = len(mean)
    if size == 1:
        up = rng.uniform(size=count) < 1.0 / (1.0 + np.exp(-2.0 * kappa))
        return np.asarray(np.where(up, mean[0], -mean[0])[:, None])
    b = (size - 1.0) / (2.0 * kappa + np.sqrt(4.0 * kappa**2 + (size - 1.0) ** 2))
    x = (1.0 - b) / (1.0 + b)
    c = kappa * x + (size - 1.0) * np.log(1.0 - x**2)
    along = np.empty(0)
    while len(along) < count:
        z = rng.beta(0.5 * (size - 1.0), 0.5 * (size - 1.0), size=2 * count + 16)
        w = (1.0 - (1.0 + b) * z) / (1.0 - (1.0 - b) * z)
        kept = kappa * w + (size - 1.0) * np.log(1.0 - x * w) - c >= np.log(
            rng.uniform(size=len(z))
        )
        along = np.concatenate([along, w[kept]])
    along = along[:count]
    across = rng.standard_normal((count, size))
    across -= (across @ mean)[:, None] * mean
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(along[:, None] * mean + np.sqrt(1.0 - along**2)[:, None] * across)
