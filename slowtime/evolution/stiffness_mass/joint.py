r"""Joint estimate of stiffness and mass from frequency and damping.

With :math:`x_1 = \ln(1 + \Delta_m)`, :math:`x_2 = \ln(1 + \Delta_k)` and
:math:`x_3 = \ln(c / c_0)` the readings are linear in the unknowns,

.. math:: \ln(\omega_s / \omega_0) = (x_2 - x_1) / 2, \qquad
          \ln(\zeta_s / \zeta_0) = x_3 - (x_1 + x_2) / 2 ,

so that Gaussian priors and errors make a Gaussian posterior in closed form. The relative error
of the damping passes one to one into both unknowns, whatever the damping ratio; only their
difference is known as well as the frequency is.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, UInt32

from slowtime.evolution.change import (
    Change,
    PerReading,
    Series,
    at_least,
    check_level,
    flags,
    under,
)
from slowtime.evolution.reasons import (
    RECOMMENDED_DISTANCE,
    UNCERTAIN_DAMPING,
    UNCERTAIN_RATIO,
    Reason,
)

LARGEST_SHARE = 0.5
"""Posterior over prior standard deviation above which the prior, not the data, has spoken."""

_UNKNOWN = 1e3  # relative sd that stands for a damping that was not measured


@dataclasses.dataclass(frozen=True, slots=True)
class JointChange:
    """Changes of stiffness and of mass estimated together.

    Parameters
    ----------
    stiffness, mass
        Each with its own standard deviation and interval. Where the two cannot be told
        apart they carry `Reason.NOT_SEPARABLE` and are not valid.
    stiffness_over_mass
        Change of stiffness over mass, known from the frequency alone.
    correlation
        Between the errors of ``ln(1 + stiffness)`` and ``ln(1 + mass)`` [1].
    separable
        Whether the readings tell mass from stiffness, or one of the two was known so much
        better beforehand that the frequency alone tells the other.
    """

    stiffness: Change
    mass: Change
    stiffness_over_mass: Change
    correlation: Float[np.ndarray, " time"]
    separable: Bool[np.ndarray, " time"]


@dataclasses.dataclass(frozen=True, slots=True)
class _Flat:
    """Estimates of (x1, x2) without priors on them, and their covariance."""

    mass: Series
    stiffness: Series
    mass_variance: Series
    stiffness_variance: Series
    covariance: Series
    determinant: Series


def stiffness_and_mass(
    frequency_ratio: Series,
    frequency_relative_sd: PerReading,
    damping_ratio: Series,
    damping_relative_sd: PerReading,
    *,
    damping_ratio_0: PerReading,
    correlation: PerReading = 0.0,
    prior_stiffness_sd: float = 0.3,
    prior_mass_sd: float = 0.3,
    damping_coefficient_sd: PerReading = 0.1,
    nominal_relative_sd: PerReading = 0.0,
    nominal_damping_relative_sd: PerReading = 0.0,
    level: float = 0.95,
) -> JointChange:
    r"""Stiffness and mass from natural frequency and damping ratio, if they can be told apart.

    Parameters
    ----------
    frequency_ratio
        Natural (undamped) frequency over the nominal one, :math:`\omega_s / \omega_0` [1].
    frequency_relative_sd
        Its relative standard deviation [1].
    damping_ratio
        :math:`\zeta_s` [1]; NaN or not positive where none was identified.
    damping_relative_sd
        Its relative standard deviation [1].
    damping_ratio_0
        :math:`\zeta_0` of the nominal model [1].
    correlation
        Between the errors of frequency and damping ratio [1].
    prior_stiffness_sd, prior_mass_sd
        What was believed before: standard deviations of :math:`\ln(1 + \Delta_k)` and
        :math:`\ln(1 + \Delta_m)` about zero [1]; ``np.inf`` for no belief.
    damping_coefficient_sd
        How much the damping coefficient may change by itself, with temperature, amplitude
        or friction: standard deviation of :math:`\ln(c / c_0)` [1]. The default of 10 % is
        what real joints do; 0 supposes that it never changes.
    nominal_relative_sd, nominal_damping_relative_sd
        Relative standard deviations of the nominal frequency and damping ratio [1].
    level
        Probability of the intervals [1].

    Returns
    -------
    Joint
        `value` is the posterior median :math:`e^{x} - 1` (so is unchanged by taking logs,
        unlike a mean), `sd` that of the lognormal posterior, the intervals equal-tailed.

    References
    ----------
    .. [1] R. Ganguli et al., "Digital Twin: A Dynamic System and Computing Perspective",
       CRC Press (2023), eq. 5.48-5.53.

    Examples
    --------
    >>> both = stiffness_and_mass(
    ...     np.array([0.9]), 0.001, np.array([0.02]), 0.02,
    ...     damping_ratio_0=0.02, damping_coefficient_sd=0.0)
    >>> both.stiffness.value.round(3), both.mass.value.round(3), both.separable
    (array([-0.1]), array([0.111]), array([ True]))
    """
    quantile = check_level(level)
    _check(
        damping_ratio_0=damping_ratio_0,
        correlation=correlation,
        prior_stiffness_sd=prior_stiffness_sd,
        prior_mass_sd=prior_mass_sd,
        damping_coefficient_sd=damping_coefficient_sd,
        nominal_relative_sd=nominal_relative_sd,
        nominal_damping_relative_sd=nominal_damping_relative_sd,
    )
    ratio, ratio_sd, reasons = _frequency(
        frequency_ratio, frequency_relative_sd, nominal_relative_sd
    )
    known = (damping_ratio > 0.0) & np.isfinite(damping_ratio)
    known &= np.isfinite(damping_relative_sd) & np.greater_equal(damping_relative_sd, 0.0)
    damping_sd = np.hypot(damping_relative_sd, nominal_damping_relative_sd)
    damping_sd = np.where(known, np.minimum(damping_sd, _UNKNOWN), _UNKNOWN)
    shrinkage = np.log(np.where(known, damping_ratio, damping_ratio_0) / damping_ratio_0)
    coefficient_variance = np.square(damping_coefficient_sd)
    flat = _flat(
        np.log(ratio), shrinkage, ratio_sd, damping_sd, correlation, coefficient_variance
    )
    return _conclude(
        flat,
        _precision(prior_mass_sd),
        _precision(prior_stiffness_sd),
        quantile,
        reasons,
        flags(~known, Reason.DAMPING_UNKNOWN)
        | flags(
            known & (damping_sd**2 + coefficient_variance > UNCERTAIN_DAMPING**2),
            Reason.DAMPING_UNCERTAIN,
        ),
        (ratio, ratio_sd),
    )


def _frequency(
    ratio: Series, relative_sd: PerReading, nominal_relative_sd: PerReading
) -> tuple[Series, Series, UInt32[np.ndarray, " time"]]:
    sd = np.asarray(relative_sd, dtype=np.float64)
    finite = np.isfinite(ratio) & np.isfinite(sd)
    positive = ratio > 0.0
    usable = finite & positive & (sd >= 0.0)
    clean = np.where(usable, ratio, np.nan)
    total = np.where(usable, np.hypot(sd, nominal_relative_sd), np.nan)
    reasons = (
        flags(~finite, Reason.NOT_FINITE)
        | flags(finite & ~positive, Reason.NOT_POSITIVE)
        | flags(np.abs(1.0 - clean) >= RECOMMENDED_DISTANCE, Reason.BEYOND_RECOMMENDED)
        | flags(total > UNCERTAIN_RATIO, Reason.TOO_UNCERTAIN)
        | flags(finite & (sd < 0.0), Reason.NEGATIVE_SD)
    )
    return clean, total, reasons


def _flat(
    log_frequency: Series,
    log_damping: Series,
    frequency_sd: Series,
    damping_sd: Series,
    correlation: PerReading,
    coefficient_variance: PerReading,
) -> _Flat:
    """Solve the two readings for mass and stiffness; the coefficient is noise to both."""
    own = frequency_sd**2 + damping_sd**2 + coefficient_variance
    cross = 2.0 * correlation * frequency_sd * damping_sd
    return _Flat(
        mass=-log_frequency - log_damping,
        stiffness=log_frequency - log_damping,
        mass_variance=own + cross,
        stiffness_variance=own - cross,
        covariance=damping_sd**2 - frequency_sd**2 + coefficient_variance,
        # Written out, because the difference of products would cancel all its digits.
        determinant=4.0
        * frequency_sd**2
        * (damping_sd**2 * (1.0 - np.square(correlation)) + coefficient_variance),
    )


def _conclude(
    flat: _Flat,
    mass_precision: float,
    stiffness_precision: float,
    quantile: float,
    reasons: UInt32[np.ndarray, " time"],
    damping_reasons: UInt32[np.ndarray, " time"],
    frequency: tuple[Series, Series],
) -> JointChange:
    """Meet the flat estimates with the priors; judge what the readings have added."""
    v1, v2, c = flat.mass_variance, flat.stiffness_variance, flat.covariance
    i1, i2, d = mass_precision, stiffness_precision, flat.determinant
    scale = 1.0 / (1.0 + v1 * i1 + v2 * i2 + d * i1 * i2)
    mass_sd = np.sqrt((v1 + d * i2) * scale)
    stiffness_sd = np.sqrt((v2 + d * i1) * scale)
    mass = ((1.0 + v2 * i2) * flat.mass - c * i2 * flat.stiffness) * scale
    stiffness = ((1.0 + v1 * i1) * flat.stiffness - c * i1 * flat.mass) * scale
    product = mass_sd * stiffness_sd
    correlation = np.where(
        product > 0.0, c * scale / np.where(product > 0.0, product, 1.0), 0.0
    )
    share = np.maximum(mass_sd * np.sqrt(i1), stiffness_sd * np.sqrt(i2))
    separable = (share <= LARGEST_SHARE) & (damping_reasons == 0)
    if _one_is_known(mass_precision, stiffness_precision):
        separable |= ~np.isnan(share)
    refusal = damping_reasons | np.uint32(Reason.NOT_SEPARABLE)
    reasons_both = reasons | np.where(separable, np.uint32(0), refusal)
    ratio, relative_sd = frequency
    on_stiffness, on_mass, on_ratio = _lognormal(
        np.array([stiffness, mass, 2.0 * np.log(ratio)]),
        np.array([stiffness_sd, mass_sd, 2.0 * relative_sd]),
        quantile,
        (reasons_both, reasons_both, reasons),
    )
    return JointChange(
        on_stiffness, on_mass, on_ratio, np.clip(correlation, -1.0, 1.0), separable
    )


def _one_is_known(mass_precision: float, stiffness_precision: float) -> bool:
    """Whether frequency and priors alone pin the less known of the two beyond its prior."""
    more, less = (
        max(mass_precision, stiffness_precision),
        min(mass_precision, stiffness_precision),
    )
    return less <= LARGEST_SHARE**2 * (more + less) and more > 0.0


def _lognormal(
    log: Float[np.ndarray, "change time"],
    log_sd: Float[np.ndarray, "change time"],
    quantile: float,
    reasons: tuple[UInt32[np.ndarray, " time"], ...],
) -> tuple[Change, ...]:
    """Make changes, one per row, whose ``ln(1 + change)`` is Gaussian."""
    sd = np.minimum(log_sd, _WIDEST)
    value = np.expm1(log)
    spread = (1.0 + value) * np.exp(0.5 * sd**2) * np.sqrt(np.expm1(sd**2))
    half = quantile * sd
    low, high = np.expm1(log - half), np.expm1(log + half)
    return tuple(
        Change(value[i], spread[i], low[i], high[i], why == 0, why)
        for i, why in enumerate(reasons)
    )


_WIDEST = 10.0  # sd of a logarithm; a factor of 22,000 either way is as good as unknown


def _precision(sd: float) -> float:
    return float(1.0 / np.square(sd))


def _check(*, damping_ratio_0: PerReading, correlation: PerReading, **sds: PerReading) -> None:
    if not (at_least(damping_ratio_0, 1e-9) and under(damping_ratio_0, 1.0)):
        raise ValueError(
            f"damping_ratio_0={damping_ratio_0} is outside (0, 1). Mass and stiffness are told "
            "apart by the damping alone, so its nominal value must be known: give a ratio such "
            "as 0.02, or learn it from the first epochs."
        )
    if not (at_least(correlation, -1.0) and at_least(-correlation, -1.0)):
        raise ValueError(
            f"correlation={correlation} is outside [-1, 1]. Give the correlation between the "
            "errors of frequency and damping ratio, 0 if unknown."
        )
    for name, sd in sds.items():
        zero_allowed = not name.startswith("prior")
        if not at_least(sd, 0.0 if zero_allowed else 1e-9):
            raise ValueError(
                f"{name}={sd} is not a standard deviation. Give a relative one, such as 0.1, "
                f"{'0 if exact' if zero_allowed else 'np.inf for no belief'}."
            )
