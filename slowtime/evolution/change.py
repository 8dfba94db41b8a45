"""Series of relative changes, and the checks that all their estimators share."""

import dataclasses
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, UInt32
from scipy.special import ndtri

from .reasons import RECOMMENDED_DISTANCE, UNCERTAIN_RATIO, Reason

Series: TypeAlias = Float[np.ndarray, " time"]
PerReading: TypeAlias = Float[np.ndarray, " time"] | float
"""One value per reading, or one for all of them."""

_SMALLEST, _LARGEST = 1e-50, 1e50  # beyond these a fourth power leaves the range of a float

FlatIn = Literal["frequency", "change"]
"""Of what a bounded prior is flat: the frequency ratio, or the change itself."""


@dataclasses.dataclass(frozen=True, slots=True)
class Change:
    """Relative change of a property, one entry per reading; NaN where nothing can be said.

    Parameters
    ----------
    value
        The estimate [1]: -0.1 once a tenth is gone.
    sd
        Its standard deviation [1].
    lo, hi
        Ends of its interval [1]; `hi` of a mass is infinite where the frequency cannot be
        told from zero, which is never valid.
    valid
        Whether nothing stands against it: ``reasons == 0``.
    reasons
        Combination of `Reason`, put into words by `explain`.
    """

    value: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    lo: Float[np.ndarray, " time"]
    hi: Float[np.ndarray, " time"]
    valid: Bool[np.ndarray, " time"]
    reasons: UInt32[np.ndarray, " time"]

    def __len__(self) -> int:
        """Count the readings."""
        return len(self.value)


@dataclasses.dataclass(frozen=True, slots=True)
class Readings:
    """Frequency ratios made safe to compute with: NaN instead of anything nonsensical."""

    ratio: Float[np.ndarray, " time"]
    sd: Float[np.ndarray, " time"]
    nominal_relative_sd: PerReading
    quantile: float
    reasons: UInt32[np.ndarray, " time"]

    @property
    def total_sd(self) -> Series:
        """Standard deviation of the ratio from reading and nominal frequency together."""
        total: Series = np.hypot(self.sd, self.ratio * self.nominal_relative_sd)
        return total

    def interval(self) -> tuple[Series, Series]:
        r"""Interval of the true ratio, exact for Gaussian reading and nominal frequency.

        With :math:`\hat f \sim N(f, \sigma^2)` and :math:`\hat f_0 \sim N(f_0, \sigma_0^2)`
        the ratio :math:`r = f / f_0` makes :math:`\hat f - r \hat f_0` a zero-mean Gaussian,
        so that :math:`(\hat r - r)^2 \le z^2 (s^2 + r^2 e^2)` holds with the probability asked
        for (Fieller's theorem); its two roots are the ends, the lower one cut at zero.
        """
        z, e = self.quantile, self.nominal_relative_sd
        shrink = 1.0 - (z * e) ** 2
        half = z * np.sqrt(self.sd**2 * shrink + (self.ratio * e) ** 2)
        return np.maximum((self.ratio - half) / shrink, 0.0), (self.ratio + half) / shrink


def flags(condition: Bool[np.ndarray, " time"], reason: Reason) -> UInt32[np.ndarray, " time"]:
    """Bit flag of a reason where a condition holds, 0 elsewhere."""
    flagged: UInt32[np.ndarray, " time"] = np.multiply(condition, int(reason), dtype=np.uint32)
    return flagged


def at_least(values: PerReading, least: float) -> bool:
    """Whether all values are at least `least`; NaN is not.

    Returns
    -------
    True if all are.
    """
    if isinstance(values, np.ndarray):
        return bool((values >= least).all())
    return values >= least


def under(values: PerReading, most: float) -> bool:
    """Whether all values are below `most`; NaN is not.

    Parameters
    ----------
    values
        Values.
    most
        Limit.

    Returns
    -------
    True if all are.
    """
    if isinstance(values, np.ndarray):
        return bool((values < most).all())
    return values < most


def check_level(level: float) -> float:
    """Give the standard normal quantile of a two-sided interval of probability `level`.

    Parameters
    ----------
    level
        Probability of the interval.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(
            f"{level=} is not a probability between 0 and 1. Give 0.95 for a 95 % interval."
        )
    return float(ndtri(0.5 + 0.5 * level))


def check_damping(damping_ratio_0: PerReading, *, below: float) -> None:
    """Check that the nominal damping ratio lies in the range of a formula.

    Parameters
    ----------
    damping_ratio_0
        Nominal damping ratio [1].
    below
        Ratio that it must stay below [1].

    Raises
    ------
    ValueError
        Where the ratio is outside [0, below).
    """
    if not (at_least(damping_ratio_0, 0.0) and under(damping_ratio_0, below)):
        raise ValueError(
            f"damping_ratio_0={damping_ratio_0} is outside [0, {below:.4g}), where the nominal "
            "oscillator rings as the formula supposes. Give a ratio such as 0.02, not a "
            "percentage such as 2; and 0 when the frequencies are natural, not damped."
        )


def check_nominal(nominal_relative_sd: PerReading, quantile: float) -> None:
    """Check that the nominal frequency is known well enough for a bounded interval of a ratio.

    Parameters
    ----------
    nominal_relative_sd
        Standard deviation of the nominal frequency over that frequency [1].
    quantile
        Half width of the interval [standard deviations].

    Raises
    ------
    ValueError
        Where the deviation is negative or at least 1 / max(quantile, 1).
    """
    most = 1.0 / max(quantile, 1.0)
    if not (at_least(nominal_relative_sd, 0.0) and under(nominal_relative_sd, most)):
        raise ValueError(
            f"nominal_relative_sd={nominal_relative_sd} is outside [0, {most:.3g}). From "
            f"{most:.3g} on, the ratio to the nominal frequency has no finite interval. Give "
            "sd(f0)/f0 as a fraction, such as 0.001. If the nominal frequency really is that "
            "uncertain, estimate it from more epochs."
        )


def read(
    ratio: Series,
    ratio_sd: PerReading,
    *,
    damping_ratio_0: PerReading,
    nominal_relative_sd: PerReading,
    level: float,
) -> Readings:
    """Check the readings and replace those that cannot be used by NaN, saying why.

    The distance is the signed one, nominal minus current: the norm of eq. 5.17 could not
    tell stiffening from softening.

    Parameters
    ----------
    ratio
        Frequency over the nominal one [1].
    ratio_sd
        Standard deviation of the ratio [1].
    damping_ratio_0
        Nominal damping ratio [1].
    nominal_relative_sd
        Relative standard deviation of the nominal frequency [1].
    level
        Probability of the interval.

    Returns
    -------
    Usable readings with the reasons of the others.
    """
    quantile = check_level(level)
    check_nominal(nominal_relative_sd, quantile)
    sd = np.asarray(ratio_sd, dtype=np.float64)
    finite = (np.abs(ratio) < _LARGEST) & (np.abs(sd) < _LARGEST)
    positive = ratio > _SMALLEST
    usable = finite & positive & (sd >= 0.0)
    clean = np.where(usable, ratio, np.nan)
    clean_sd = np.where(usable, sd, np.nan)
    distance = np.abs(np.sqrt(1.0 - np.square(damping_ratio_0)) - clean)
    reasons = (
        flags(~finite, Reason.NOT_FINITE)
        | flags(finite & ~positive, Reason.NOT_POSITIVE)
        | flags(finite & (sd < 0.0), Reason.NEGATIVE_SD)
        | flags(distance >= RECOMMENDED_DISTANCE, Reason.BEYOND_RECOMMENDED)
        | flags(clean_sd > UNCERTAIN_RATIO * clean, Reason.TOO_UNCERTAIN)
    )
    return Readings(clean, clean_sd, nominal_relative_sd, quantile, reasons)
