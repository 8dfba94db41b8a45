r"""Change of mass from frequency, with stiffness and damping constant.

.. math:: m_0 (1 + \Delta_m(t_s)) \ddot u + c_0 \dot u + k_0 u = f
   \quad\Rightarrow\quad r = \omega_{ds} / \omega_0 =
   \frac{\sqrt{1 + \Delta_m - \zeta_0^2}}{1 + \Delta_m}
"""

import math

import numpy as np

from slowtime.evolution.change import (
    Change,
    FlatIn,
    PerReading,
    Readings,
    Series,
    check_damping,
    flags,
    read,
)
from slowtime.evolution.reasons import UNCERTAIN_RATIO, Reason

from . import bounded_posterior


def mass_from_frequency(
    ratio: Series,
    ratio_sd: PerReading,
    *,
    damping_ratio_0: PerReading = 0.0,
    nominal_relative_sd: PerReading = 0.0,
    bounds: tuple[PerReading, PerReading] | None = None,
    flat_in: FlatIn = "frequency",
    level: float = 0.95,
) -> Change:
    r"""Relative change of mass, with its uncertainty, from a measured frequency ratio.

    The mass that gives :math:`r` is :math:`\mu = 1 + \Delta_m`,

    .. math:: \mu(r) = \frac{1 + \sqrt{1 - 4 r^2 \zeta_0^2}}{2 r^2}, \qquad
              \hat\Delta_m = \mu(\hat r) - \tfrac12 \mu''(\hat r) s^2 - 1 .

    No function of a Gaussian reading is unbiased for it (:math:`1/r^2` has a pole); the
    correction takes the bias from order :math:`s^2` to order :math:`s^4`. The standard
    deviation is :math:`|\mu'(\hat r)| s`. The interval is the image of the interval of
    :math:`r` under the monotone :math:`\mu`, hence as exact as that one.

    Parameters
    ----------
    ratio, ratio_sd, damping_ratio_0, nominal_relative_sd, bounds, flat_in, level
        As in `stiffness_from_frequency`; `damping_ratio_0` below 0.7071, where more mass
        means a lower damped frequency.

    Returns
    -------
    Relative change of mass [1], with standard deviation and interval.

    References
    ----------
    .. [1] R. Ganguli et al., "Digital Twin: A Dynamic System and Computing Perspective",
       CRC Press (2023), eq. 5.39, simplified: the same root, without its cancellations. It
       needs :math:`r \le 1/(2 \zeta_0)`, contrary to "valid for any values of zeta_0".

    Examples
    --------
    >>> found = mass_from_frequency(np.array([1.0, 0.8]), 0.001)
    >>> found.value.round(4), found.sd.round(4)
    (array([-0.    ,  0.5625]), array([0.002 , 0.0039]))
    """
    check_damping(damping_ratio_0, below=math.sqrt(0.5))
    readings = read(
        ratio,
        ratio_sd,
        damping_ratio_0=damping_ratio_0,
        nominal_relative_sd=nominal_relative_sd,
        level=level,
    )
    scale = bounded_posterior.MassScale(damping_ratio_0)
    if bounds is not None:
        return bounded_posterior.bounded_change(readings, scale, bounds, flat_in, level)
    return _unbounded(readings, scale)


def _unbounded(readings: Readings, scale: bounded_posterior.MassScale) -> Change:
    possible = readings.ratio <= scale.highest_ratio
    r = np.where(possible, readings.ratio, np.nan)
    s2 = readings.sd**2
    e2 = np.square(readings.nominal_relative_sd)
    mass, slope, curvature = scale.mass_and_derivatives(r)
    low, high = readings.interval()
    least, most = scale.change(np.minimum(high, scale.highest_ratio)), scale.change(low)
    # The curvature meets the reading's variance and, through r (1 + e), the nominal's too;
    # the mean of the ratio itself is off by r e^2.
    shift = 0.5 * curvature * (s2 + r**2 * e2) + slope * r * e2
    sd = -slope * np.sqrt(s2 + r**2 * e2)
    reasons = (
        readings.reasons
        | flags(readings.ratio > scale.highest_ratio, Reason.NO_SUCH_MASS)
        | flags(sd > 2.0 * UNCERTAIN_RATIO * mass, Reason.TOO_UNCERTAIN)
    )
    lo, hi = np.where(possible, least, np.nan), np.where(possible, most, np.nan)
    value = np.clip(mass - 1.0 - shift, lo, hi)
    return Change(value, sd, lo, hi, reasons == 0, reasons)
