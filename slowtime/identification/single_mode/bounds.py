"""Cramér–Rao bounds of frequency and damping, for free decay and ambient response."""

import numpy as np


def free_decay_bound(
    *, decay_rate: float, duration_s: float, rate_hz: float, snr: float
) -> float:
    r"""Cramér-Rao bound on the sd of decay rate and damped frequency of a free decay [rad/s].

    .. math:: \mathrm{var}\, \omega_d = \mathrm{var}\, \alpha
              = \frac{1}{\mathrm{SNR}_0 f_s (J_2 - J_1^2 / J_0)}, \qquad
              J_k = \int_0^T t^k e^{-2 \alpha t} dt

    Parameters
    ----------
    decay_rate
        :math:`\alpha = \zeta \omega_n` [1/s], positive.
    duration_s, rate_hz
        T [s] and f_s [Hz].
    snr
        :math:`A^2 / 2 \sigma^2` at t = 0 [1].

    Returns
    -------
    Standard deviation [rad/s].

    Examples
    --------
    A long record, where the bound tends to :math:`8 \alpha^3 / (\mathrm{SNR}_0 f_s)`:

    >>> sd = free_decay_bound(decay_rate=0.63, duration_s=60.0, rate_hz=1e3, snr=100.0)
    >>> round(sd / (8 * 0.63**3 / 1e5) ** 0.5, 6)
    1.0
    """
    b, t = 2 * decay_rate, duration_s
    end = np.exp(-b * t)
    j0 = (1 - end) / b
    j1 = (1 - end * (1 + b * t)) / b**2
    j2 = (2 - end * (2 + 2 * b * t + (b * t) ** 2)) / b**3
    return float(1 / np.sqrt(snr * rate_hz * (j2 - j1**2 / j0)))


def ambient_law(
    damping_ratio: float, cycles: float, *, reach: float = np.inf
) -> tuple[float, float]:
    r"""Uncertainty law of ambient identification: sd of f over f, and sd of ln zeta.

    .. math:: \sqrt{\frac{\zeta}{2 \pi N_c B_f}}, \qquad
              \sqrt{\frac{1}{2 \pi \zeta N_c B_\zeta}}

    without noise, for the band :math:`f (1 \pm \kappa \zeta)`, with
    :math:`B_f = \tfrac{2}{\pi} (\arctan \kappa - \kappa / (\kappa^2 + 1))` and
    :math:`B_\zeta = \tfrac{2}{\pi} (\arctan \kappa + \kappa / (\kappa^2 + 1)
    - 2 \arctan^2 \kappa / \kappa)`.

    Parameters
    ----------
    damping_ratio
        Damping ratio zeta [1].
    cycles
        Number :math:`N_c` of natural periods in the record.
    reach
        Half width :math:`\kappa` of the band, in half-power half widths [1].

    Returns
    -------
    Relative standard deviation of the frequency, and that of the damping ratio [1].

    References
    ----------
    .. [1] S.-K. Au, "Uncertainty law in ambient modal identification", MSSP 48 (2014).

    Examples
    --------
    Ten minutes at 1 Hz and 1 % damping know the damping to 16 % at best:

    >>> round(ambient_law(0.01, 600.0)[1], 3)
    0.163
    """
    angle = np.arctan(reach)
    side = 0.0 if np.isinf(reach) else reach / (reach**2 + 1)
    of_f = 2 / np.pi * (angle - side)
    of_z = 2 / np.pi * (angle + side - (0.0 if np.isinf(reach) else 2 * angle**2 / reach))
    return (
        float(np.sqrt(damping_ratio / (2 * np.pi * cycles * of_f))),
        float(np.sqrt(1 / (2 * np.pi * damping_ratio * cycles * of_z))),
    )


def ambient_bound(
    damping_ratio: float, cycles: float, *, snr: float, reach: float
) -> tuple[float, float]:
    r"""Cramér-Rao bounds for unknown level and noise floor: sd of f over f, and of ln zeta.

    Inverse Fisher information of :math:`S \propto 1 / (1 + u^2) + 1 / g` in frequency,
    damping, level and floor, over :math:`|u| < \kappa`; g is the density of the peak over
    that of the floor.

    Parameters
    ----------
    damping_ratio, cycles
        :math:`\zeta` and :math:`N_c = f T`.
    snr
        g [1].
    reach
        :math:`\kappa` [1].

    Returns
    -------
    Relative standard deviation of the frequency, and that of the damping ratio [1].
    """
    u = np.sinh(np.linspace(-np.arcsinh(reach), np.arcsinh(reach), 20001))
    shape = 1 / (1 + u**2)
    slopes = np.stack([2 * u * shape**2 / damping_ratio, 2 * u**2 * shape**2, shape, 0 * u + 1])
    slopes = slopes / (shape + 1 / snr)
    spacing = np.gradient(u)
    information = damping_ratio * cycles * (slopes * spacing) @ slopes.T
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    return float(sd[0]), float(sd[1])
