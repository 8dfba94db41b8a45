"""The two model evolutions of stiffness and mass used in the book."""

import numpy as np
from jaxtyping import Float

Series = Float[np.ndarray, " time"]


def stiffness_change(
    time_in_periods: Series,
    *,
    rate: float = 4e-4,
    ripple: float = 0.05,
    ripple_rate: float = 2e-2,
) -> Series:
    r"""Relative change of stiffness by fatigue: a decay with a small oscillation (eq. 5.12).

    .. math:: \Delta_k(t_s) = e^{-\alpha_k t_s}
              \frac{1 + \epsilon_k \cos(\beta_k t_s)}{1 + \epsilon_k} - 1

    Parameters
    ----------
    time_in_periods
        :math:`t_s / T_0` [1]; the book leaves the unit out, but its figure 5.3 fixes it.
    rate, ripple, ripple_rate
        :math:`\alpha_k`, :math:`\epsilon_k`, :math:`\beta_k`, the rates per period [1].

    Examples
    --------
    >>> stiffness_change(np.array([0.0, 1000.0])).round(4)
    array([ 0.    , -0.3486])
    """
    breathing = (1 + ripple * np.cos(ripple_rate * time_in_periods)) / (1 + ripple)
    change: Series = np.exp(-rate * time_in_periods) * breathing - 1
    return change


def mass_change(
    time_in_periods: Series, *, amplitude: float = 0.25, rate: float = 0.15
) -> Series:
    r"""Relative change of mass as a sawtooth, such as fuel taken on and burnt (eq. 5.13).

    .. math:: \Delta_m(t_s) = \epsilon_m \, \mathrm{SawTooth}(\beta_m (t_s - \pi / \beta_m))

    Parameters
    ----------
    time_in_periods
        :math:`t_s / T_0` [1].
    amplitude, rate
        :math:`\epsilon_m` [1] and :math:`\beta_m` per period [1]; a tooth lasts
        :math:`2 \pi / \beta_m` periods, and fewer than two readings a tooth alias it.

    Examples
    --------
    >>> mass_change(np.array([0.0, 10.0])).round(4)
    array([0.    , 0.1194])
    """
    turns = rate * time_in_periods / (2.0 * np.pi) + 0.5
    change: Series = amplitude * (2.0 * (turns - np.floor(turns)) - 1.0)
    return change
