r"""Change of stiffness from frequency, with mass and damping constant.

.. math:: m_0 \ddot u + c_0 \dot u + k_0 (1 + \Delta_k(t_s)) u = f
   \quad\Rightarrow\quad r = \omega_{ds} / \omega_0 = \sqrt{1 + \Delta_k - \zeta_0^2}
"""

import numpy as np

from slowtime.evolution.change import (
    Change,
    FlatIn,
    PerReading,
    Readings,
    Series,
    check_damping,
    read,
)

from . import bounded_posterior


def stiffness_from_frequency(
    ratio: Series,
    ratio_sd: PerReading,
    *,
    damping_ratio_0: PerReading = 0.0,
    nominal_relative_sd: PerReading = 0.0,
    bounds: tuple[PerReading, PerReading] | None = None,
    flat_in: FlatIn = "frequency",
    level: float = 0.95,
) -> Change:
    r"""Relative change of stiffness, with its uncertainty, from a measured frequency ratio.

    Squaring a noisy ratio adds its variance, :math:`E[\hat r^2] = r^2 + s^2`, so the estimate
    is

    .. math:: \hat\Delta_k = \hat r^2 - s^2 - (1 - \zeta_0^2), \qquad
              \widehat{\mathrm{var}} = 4 s^2 \hat r^2 - 2 s^4,

    both unbiased, and the first of least variance among the unbiased. The interval is the
    square of the interval of :math:`r`, hence as exact as that one.

    Parameters
    ----------
    ratio
        Measured frequency over the nominal *undamped* one [1]: natural frequencies with
        ``damping_ratio_0=0``, or damped ones with the nominal damping ratio.
    ratio_sd
        Standard deviation of `ratio` from its reading alone [1]; 0 for exact data.
    damping_ratio_0
        :math:`\zeta_0` of the nominal model [1].
    nominal_relative_sd
        Standard deviation of the nominal frequency over itself [1]. The error it stands for
        is the same in every reading: averaging readings does not make it smaller.
    bounds
        Least and greatest change that physics allows, such as ``(-0.9, 0.0)`` for a
        structure that can only degrade. Then `value` is the most likely change within them,
        `sd` that of the posterior, and the interval the one of highest posterior density.
        Average unbounded estimates, never bounded ones: the bias of each adds up.
    flat_in
        Of what the prior within the bounds is flat.
    level
        Probability of the interval [1].

    Returns
    -------
    Relative change of stiffness [1], with standard deviation and interval.

    Notes
    -----
    Below one standard deviation from zero frequency the estimate is held at zero stiffness;
    such readings are never valid.

    References
    ----------
    .. [1] R. Ganguli et al., "Digital Twin: A Dynamic System and Computing Perspective",
       CRC Press (2023), eq. 5.20, which is this without :math:`s^2`.

    Examples
    --------
    >>> found = stiffness_from_frequency(np.array([1.0, 0.9]), 0.001)
    >>> found.value.round(6), found.sd.round(6)
    (array([-1.00000e-06, -1.90001e-01]), array([0.002 , 0.0018]))
    """
    check_damping(damping_ratio_0, below=1.0)
    readings = read(
        ratio,
        ratio_sd,
        damping_ratio_0=damping_ratio_0,
        nominal_relative_sd=nominal_relative_sd,
        level=level,
    )
    ground = 1.0 - np.square(damping_ratio_0)
    if bounds is not None:
        return bounded_posterior.bounded_change(
            readings, bounded_posterior.StiffnessScale(ground), bounds, flat_in, level
        )
    return _unbounded(readings, ground)


def _unbounded(readings: Readings, ground: PerReading) -> Change:
    r2, s2 = readings.ratio**2, readings.sd**2
    e2 = np.square(readings.nominal_relative_sd)
    # A nominal frequency that is itself uncertain inflates the mean of 1/f0^2 by 1 + 3 e^2.
    value = np.maximum(r2 - s2, 0.0) / (1.0 + 3.0 * e2) - ground
    variance = np.maximum(4.0 * s2 * r2 - 2.0 * s2**2, 2.0 * s2**2) + 4.0 * e2 * r2**2
    low, high = readings.interval()
    return Change(
        value,
        np.sqrt(variance),
        low**2 - ground,
        high**2 - ground,
        readings.reasons == 0,
        readings.reasons,
    )
