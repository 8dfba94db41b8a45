r"""First passages of degradation laws whose parameters are known.

All take a distance to the threshold that is left and a time ahead, and condition on survival
until now: the state now is given, and it has not crossed.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincc

from slowtime.evolution.life.first_passage import inverse_gaussian_cdf

Values = float | Float[np.ndarray, "..."]


def wiener_first_passage(
    ahead: Values, *, distance: Values, drift: Values, sigma: Values
) -> Float[np.ndarray, "..."]:
    r"""Probability that a Wiener process with drift has passed a threshold.

    For :math:`\mu > 0` the time is inverse Gaussian with mean :math:`z / \mu` and shape
    :math:`z^2 / \sigma^2`. With a drift away from the threshold it may never be reached.

    Parameters
    ----------
    drift, sigma
        :math:`\mu` towards the threshold [quantity / time], and :math:`\sigma` [quantity /
        root of time].

    Returns
    -------
    Probability [1].

    References
    ----------
    .. [1] R. S. Chhikara and J. L. Folks, "The Inverse Gaussian Distribution" (1989).

    Examples
    --------
    >>> round(float(wiener_first_passage(1.0, distance=1.0, drift=1.0, sigma=1.0)), 4)
    0.6681
    """
    z, mu = np.asarray(distance, dtype=float), np.asarray(drift, dtype=float)
    _check_positive("distance", z)
    _check_positive("sigma", np.asarray(sigma, dtype=float))
    pace = np.maximum(np.abs(mu), 1e-12 * z)
    reached = inverse_gaussian_cdf(
        np.asarray(ahead, dtype=float), z / pace, z**2 / np.square(sigma)
    )
    away = np.exp(np.where(mu < 0.0, 2.0 * mu * z / np.square(sigma), 0.0))
    return np.asarray(np.where(np.asarray(ahead) > 0.0, away * reached, 0.0))


def gamma_first_passage(
    ahead: Values, *, distance: Values, shape_rate: Values, rate: Values
) -> Float[np.ndarray, "..."]:
    r"""Probability that a gamma process has passed a threshold.

    .. math:: P(T \le t) = \Gamma(\alpha t, \beta z) / \Gamma(\alpha t)

    Parameters
    ----------
    shape_rate, rate
        :math:`\alpha` [1 / time] and :math:`\beta` [1 / quantity].

    Returns
    -------
    Probability [1].

    References
    ----------
    .. [1] J. M. van Noortwijk, "A survey of the application of gamma processes in maintenance"
       (2009).
    """
    t = np.asarray(ahead, dtype=float)
    for name, value in (("distance", distance), ("shape_rate", shape_rate), ("rate", rate)):
        _check_positive(name, np.asarray(value, dtype=float))
    shape = np.maximum(np.asarray(shape_rate) * t, 1e-300)
    return np.asarray(np.where(t > 0.0, gammaincc(shape, np.asarray(rate) * distance), 0.0))


def load_survival(
    ahead: Float[np.ndarray, " later"],
    event_rate: Values,
    failure_probability: Float[np.ndarray, "path later"],
    *,
    weights: Float[np.ndarray, " path"] | None = None,
) -> Float[np.ndarray, " later"]:
    r"""Probability of survival under load events that come as a Poisson process.

    .. math:: S(t) = \mathrm{E} \exp\left(-\lambda \int_0^t p(s)\,ds\right)

    with the average over paths outside the exponential: what is unknown but fixed in time, such
    as the capacity, is shared by all events.

    Parameters
    ----------
    event_rate
        :math:`\lambda` [1 / time], one number or one for each path.
    failure_probability
        p, that a load which comes then breaks the structure, for each path [1].
    """
    p = np.asarray(failure_probability, dtype=float)
    if ((p < 0.0) | (p > 1.0)).any():
        raise ValueError("failure_probability has entries outside 0 to 1. Give probabilities.")
    if not len(ahead) or ahead[0] != 0.0 or np.any(np.diff(ahead) < 0.0):
        raise ValueError(f"ahead={ahead} is not ascending from 0. Give such times.")
    middle = 0.5 * (p[:, 1:] + p[:, :-1]) * np.diff(ahead)
    area = np.concatenate([np.zeros((len(p), 1)), np.cumsum(middle, axis=1)], axis=1)
    hazard = np.reshape(event_rate, (-1, 1)) * area
    share = np.full(len(p), 1.0 / len(p)) if weights is None else weights / weights.sum()
    return np.asarray(share @ np.exp(-hazard))


def gamma_rate_survival(
    ahead: Values, *, shape: float, scale: float
) -> Float[np.ndarray, "..."]:
    r"""Probability of survival under failures at a constant rate whose law is a gamma law.

    .. math:: S(t) = (1 + \theta t)^{-k}
    """
    return np.asarray((1.0 + scale * np.asarray(ahead, dtype=float)) ** -shape)


def rate_given_survival(shape: float, scale: float, survived: float) -> tuple[float, float]:
    """Gamma law of a failure rate after a time without failures.

    The shape is in 1, the scale in 1 / time.
    """
    return shape, scale / (1.0 + scale * survived)


def _check_positive(name: str, value: np.ndarray) -> None:
    if not np.all(value > 0.0):
        raise ValueError(f"{name}={value} is not positive. Give a positive number.")


__all__ = [
    "gamma_first_passage",
    "gamma_rate_survival",
    "load_survival",
    "rate_given_survival",
    "wiener_first_passage",
]
