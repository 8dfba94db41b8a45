"""Nominal frequency and damping, learnt from the first epochs."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from slowtime.evolution.change import PerReading, Series

OUTLIER = 3.5
"""Robust standard deviations from the median beyond which an epoch is not learnt from."""


@dataclasses.dataclass(frozen=True, slots=True)
class NominalOscillator:
    """Nominal frequency and damping with their standard deviations.

    Parameters
    ----------
    frequency, frequency_sd
        In the unit of the frequencies they were learnt from.
    damping_ratio, damping_ratio_sd
        NaN when no epoch had a damping ratio [1].
    epochs
        How many epochs the frequency was learnt from.
    rejected
        How many were left out as outliers or not usable.
    """

    frequency: float
    frequency_sd: float
    damping_ratio: float
    damping_ratio_sd: float
    epochs: int
    rejected: int

    @property
    def frequency_relative_sd(self) -> float:
        """What `stiffness_from_frequency` calls `nominal_relative_sd` [1]."""
        return self.frequency_sd / self.frequency

    @property
    def damping_relative_sd(self) -> float:
        """What `stiffness_and_mass` calls `nominal_damping_relative_sd` [1]."""
        return self.damping_ratio_sd / self.damping_ratio


def learn_nominal(
    frequency: Series,
    sd: PerReading,
    damping: Series | None = None,
    damping_sd: PerReading | None = None,
) -> NominalOscillator:
    """Nominal frequency and damping ratio: weighted means over epochs that agree.

    Epochs further than `OUTLIER` robust standard deviations from the weighted median are left
    out. If the rest scatter more than their standard deviations admit, the standard deviation
    of the mean is widened by what is missing (the Birge ratio), so that it stays honest when
    the structure was not quite still, or the readings not quite as good as they said.

    Parameters
    ----------
    frequency, sd
        Frequencies of the first epochs and their standard deviations, in any one unit;
        epochs that are NaN, infinite or not positive are passed over.
    damping, damping_sd
        Damping ratios and their standard deviations [1]; NaN where not identified.

    Returns
    -------
    Nominal frequency [unit of `frequency`] and damping ratio [1], with their standard
    deviations.

    Examples
    --------
    >>> nominal = learn_nominal(np.array([9.99, 10.01, 10.0, 14.0]), 0.01)
    >>> round(nominal.frequency, 6), round(nominal.frequency_sd, 4), nominal.rejected
    (10.0, 0.0058, 1)
    """
    mean, mean_sd, used = _agreed_mean(frequency, sd)
    if not used:
        raise ValueError(
            f"None of the {len(frequency)} epochs has a finite positive frequency with a "
            "standard deviation, so there is nothing to learn a nominal model from. Wait for "
            "epochs in which the mode is identified, or give the nominal frequency."
        )
    if damping is None or damping_sd is None:
        zeta, zeta_sd = np.nan, np.nan
    else:
        zeta, zeta_sd, _ = _agreed_mean(damping, damping_sd)
    return NominalOscillator(mean, mean_sd, zeta, zeta_sd, used, len(frequency) - used)


def _agreed_mean(values: Series, sds: PerReading) -> tuple[float, float, int]:
    """Weighted mean of the readings that agree, its standard deviation, their number."""
    all_sds = np.broadcast_to(np.asarray(sds, dtype=np.float64), values.shape)
    usable = np.isfinite(values) & np.isfinite(all_sds) & (values > 0.0) & (all_sds >= 0.0)
    if not usable.any():
        return np.nan, np.nan, 0
    x = values[usable]
    sd = np.maximum(all_sds[usable], 1e-9 * np.median(x))
    agree = _agreeing(x, sd)
    x, weight = x[agree], sd[agree] ** -2.0
    mean = float(np.average(x, weights=weight))
    scatter = float(weight @ (x - mean) ** 2) / max(len(x) - 1, 1)
    return mean, float(np.sqrt(max(1.0, scatter) / weight.sum())), len(x)


def _agreeing(
    x: Float[np.ndarray, " used"], sd: Float[np.ndarray, " used"]
) -> Bool[np.ndarray, " used"]:
    """Which readings lie within `OUTLIER` robust standard deviations of the median."""
    order = np.argsort(x)
    heaped = np.cumsum(sd[order] ** -2.0)
    centre = x[order[np.searchsorted(heaped, 0.5 * heaped[-1])]]
    score = np.abs(x - centre) / sd
    # The median absolute deviation widens the gate when the stated sds are too small.
    widen = max(1.0, 1.4826 * float(np.median(score)))
    agree: Bool[np.ndarray, " used"] = score <= OUTLIER * widen
    return agree
