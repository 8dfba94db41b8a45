"""Frequency and damping of a structure with given changes of stiffness and mass."""

import numpy as np

from slowtime.evolution.change import PerReading, Series


def natural_frequency_ratio(stiffness_change: Series, mass_change: PerReading = 0.0) -> Series:
    r"""Natural frequency over the nominal one (eq. 5.51).

    .. math:: \omega_s / \omega_0 = \sqrt{(1 + \Delta_k) / (1 + \Delta_m)}

    Parameters
    ----------
    stiffness_change
        Relative change of stiffness [1].
    mass_change
        Relative change of mass [1].

    Returns
    -------
    Ratio [1].
    """
    ratio: Series = np.sqrt((1.0 + stiffness_change) / (1.0 + mass_change))
    return ratio


def damping_ratio(
    stiffness_change: Series,
    mass_change: PerReading = 0.0,
    *,
    damping_ratio_0: PerReading,
    damping_coefficient_change: PerReading = 0.0,
) -> Series:
    r"""Damping ratio of the changed structure (eq. 5.52, with :math:`c` free to change).

    .. math:: \zeta_s = \frac{(1 + \Delta_c) \zeta_0}{\sqrt{(1 + \Delta_k)(1 + \Delta_m)}}

    Parameters
    ----------
    stiffness_change
        Relative change of stiffness [1].
    mass_change
        Relative change of mass [1].
    damping_ratio_0
        Nominal damping ratio [1].
    damping_coefficient_change
        Relative change of the damping coefficient [1].

    Returns
    -------
    Damping ratio [1].
    """
    coefficient = 1.0 + np.asarray(damping_coefficient_change)
    ratio: Series = (coefficient * damping_ratio_0) / np.sqrt(
        (1.0 + stiffness_change) * (1.0 + mass_change)
    )
    return ratio


def damped_frequency_ratio(
    stiffness_change: Series,
    mass_change: PerReading = 0.0,
    *,
    damping_ratio_0: PerReading,
    damping_coefficient_change: PerReading = 0.0,
) -> Series:
    r"""Damped frequency over the nominal *undamped* one (eq. 5.53).

    .. math:: \frac{\omega_{ds}}{\omega_0} = \frac{\sqrt{(1 + \Delta_k)(1 + \Delta_m)
              - (1 + \Delta_c)^2 \zeta_0^2}}{1 + \Delta_m}

    NaN where the changed structure would not ring.

    Parameters
    ----------
    stiffness_change
        Relative change of stiffness [1].
    mass_change
        Relative change of mass [1].
    damping_ratio_0
        Nominal damping ratio [1].
    damping_coefficient_change
        Relative change of the damping coefficient [1].

    Returns
    -------
    Ratio [1].
    """
    coefficient = 1.0 + np.asarray(damping_coefficient_change)
    mass = 1.0 + np.asarray(mass_change)
    under = (1.0 + stiffness_change) * mass - np.square(coefficient * damping_ratio_0)
    ratio: Series = np.sqrt(np.where(under >= 0.0, under, np.nan)) / mass
    return ratio
