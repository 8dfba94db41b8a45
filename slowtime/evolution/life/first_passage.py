r"""First-passage times of sampled paths, crossings between grid points included.

Between two points of a diffusion with variance rate :math:`\sigma^2`, at distances a and b from
the threshold, the path is a Brownian bridge: it touches the threshold with probability
:math:`\exp(-2 a b / (\sigma^2 \Delta))`, whatever its drift.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, ndtr


def first_passage(
    above: Float[np.ndarray, "path later"],
    later: Float[np.ndarray, " later"],
    roughness: Float[np.ndarray, " path"],
    chance: Float[np.ndarray, " path"],
) -> Float[np.ndarray, " path"]:
    """Time at which each path first reaches zero from above.

    Parameters
    ----------
    above
        Distance of each path from the threshold at each time.
    later
        Times, ascending.
    roughness
        Variance that each path's diffusion gains over one unit of time; 0 for a path that is
        straight between its points.
    chance
        A uniform random number for each path, by which a bridge decides.

    Returns
    -------
    Times, infinite where zero is not reached.

    References
    ----------
    .. [1] P. Glasserman, "Monte Carlo Methods in Financial Engineering" (2004), section 6.4.
    """
    below = above <= 0.0
    crossed = below.any(axis=1)
    k = np.where(crossed, below.argmax(axis=1), 0)
    row, before = np.arange(len(above)), np.maximum(k - 1, 0)
    high, low = above[row, before], above[row, k]
    part = np.where(k > 0, high / np.where(high > low, high - low, 1.0), 0.0)
    at = later[before] + part * (later[k] - later[before])
    when = np.where(crossed, at, np.inf)
    rough = np.flatnonzero(roughness > 0.0)
    if rough.size:
        when[rough] = _bridged(above[rough], later, roughness[rough], chance[rough])
    return np.asarray(when)


def _bridged(
    above: np.ndarray, later: np.ndarray, roughness: np.ndarray, chance: np.ndarray
) -> np.ndarray:
    """Decide by one uniform number per path at which step it is first across."""
    product = np.maximum(above[:, :-1], 0.0) * np.maximum(above[:, 1:], 0.0)
    step = np.maximum(np.diff(later), 1e-300)
    touched = np.exp(np.maximum(-2.0 * product / (roughness[:, None] * step), -745.0))
    survived = np.cumprod(1.0 - touched, axis=1)
    gone = survived < chance[:, None]
    crossed = gone.any(axis=1)
    k = gone.argmax(axis=1)
    row = np.arange(len(above))
    start = np.where(k > 0, survived[row, np.maximum(k - 1, 0)], 1.0)
    # Within the step the time follows the bridge's law; the rest of the number says where.
    part = np.clip((start - chance) / np.maximum(start - survived[row, k], 1e-300), 0.0, 1.0)
    inside = _within(above[row, k], above[row, k + 1], roughness * step[k], part)
    at = later[k] + inside * step[k]
    at = np.where(above[:, 0] <= 0.0, later[0], at)
    return np.where(crossed | (above[:, 0] <= 0.0), at, np.inf)


def _within(
    first: np.ndarray, second: np.ndarray, variance: np.ndarray, part: np.ndarray
) -> np.ndarray:
    r"""Share of the step after which a bridge that touches zero does so first.

    With :math:`u / (1 - u)` the touching time is inverse Gaussian: mean :math:`a / |b|` and
    shape :math:`a^2 / \sigma^2 \Delta`. `part` is its probability.
    """
    a = np.maximum(first, 1e-12 * np.sqrt(variance))
    b = np.maximum(np.abs(second), 1e-9 * np.sqrt(variance))
    mean, shape = a / b, a**2 / variance
    low, high = np.zeros_like(a), np.ones_like(a)
    for _ in range(20):
        middle = 0.5 * (low + high)
        odds = middle / (1.0 - middle)
        below = inverse_gaussian_cdf(odds, mean, shape) < part
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(0.5 * (low + high))


def inverse_gaussian_cdf(
    t: np.ndarray | float, mean: np.ndarray | float, shape: np.ndarray | float
) -> np.ndarray:
    r"""Distribution function of the inverse Gaussian law.

    .. math:: F(t) = \Phi\left(\sqrt{\lambda/t} (t/m - 1)\right)
              + e^{2 \lambda / m} \Phi\left(-\sqrt{\lambda/t} (t/m + 1)\right)

    Parameters
    ----------
    t
        Times, positive.
    mean, shape
        :math:`m` and :math:`\lambda`, in the unit of t.

    Returns
    -------
    Probabilities [1].

    References
    ----------
    .. [1] R. S. Chhikara and J. L. Folks, "The Inverse Gaussian Distribution" (1989).
    """
    at = np.maximum(np.asarray(t, dtype=float), 1e-300)
    root = np.sqrt(shape / at)
    second = np.exp(np.minimum(2.0 * shape / mean + log_ndtr(-root * (at / mean + 1.0)), 0.0))
    return np.asarray(np.minimum(ndtr(root * (at / mean - 1.0)) + second, 1.0))
