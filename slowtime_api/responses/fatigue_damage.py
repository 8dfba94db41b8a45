"""Stress cycles by rainflow, and the fatigue damage that they sum to."""

import dataclasses
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from slowtime.fatigue.counter import Count
from slowtime.fatigue.miner import TimeToFailure, equivalent_range
from slowtime.fatigue.spectral import METHODS, SpectralMoments, damage_rate
from slowtime.signals.spectra import welch
from slowtime_api.arguments import fields_named
from slowtime_api.plotting import Axes, new_figure, save
from slowtime_api.results import Result
from slowtime_api.signals import Signals
from slowtime_services.argument_checks import NotNegative, Positive, checked
from slowtime_services.files import find_column
from slowtime_services.virtual_sensors.settings import PointCurve

from .virtual_quantities import VirtualQuantity

YEAR_S = 365.25 * 86_400
"""Julian year [s]."""
SPECTRAL_WINDOWS = 16
"""Windows of a record whose spectra are averaged for spectral methods [1]."""
QUANTILES = (0.05, 0.5, 0.95)
"""Quantiles of the time to failure that are stated [1]."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FatigueDamage(Result):
    """Cycles of a stress, and Miner's sum with its scatter.

    Parameters
    ----------
    point, unit
        Channel or virtual quantity of the stress, and its unit.
    seconds
        Length of the record that was counted [s].
    cycles
        Number of cycles; a half cycle counts as one half.
    largest_range, equivalent_range
        Largest stress range, and that of as many equal cycles of the same damage, in the unit.
    damage, damage_sd, damage_lo, damage_hi
        Median of Miner's sum [1], its standard deviation, and ends of its 95 % interval.
    damage_per_year
        Median damage if the record repeats for ever [1/year].
    years_to_failure
        Time to the critical sum by probability, if the record repeats for ever [year]; infinite
        where it is never reached.
    spectral_damage_per_year
        The same damage by spectral method [1/year].
    ranges, range_cycles
        Histogram: stress ranges in the unit, and cycles of each.
    skipped
        Samples that could not be used.
    reasons
        Reasons for larger errors than stated.
    """

    point: str
    unit: str
    seconds: float
    cycles: float
    largest_range: float
    equivalent_range: float
    damage: float
    damage_sd: float
    damage_lo: float
    damage_hi: float
    damage_per_year: float
    years_to_failure: dict[float, float]
    spectral_damage_per_year: dict[str, float]
    ranges: Float[np.ndarray, " range"]
    range_cycles: Float[np.ndarray, " range"]
    skipped: int
    reasons: tuple[str, ...]

    @property
    def heading(self) -> str:
        """What was counted, in a line."""
        return f"{self.point}: {self.cycles:.0f} cycles in {self.seconds:.0f} s"

    def rows(self) -> list[dict[str, Any]]:
        """Return the numbers, each with its unit.

        Returns
        -------
        One dictionary per number: ``what``, ``value`` and ``unit``.
        """
        named = [
            ("largest range", self.largest_range, self.unit),
            ("equivalent range", self.equivalent_range, self.unit),
            ("Miner's sum, median", self.damage, "1"),
            ("Miner's sum, 2.5 %", self.damage_lo, "1"),
            ("Miner's sum, 97.5 %", self.damage_hi, "1"),
            ("damage at this rate", self.damage_per_year, "1/year"),
            *(
                (f"time to failure, {100 * share:g} %", years, "years")
                for share, years in self.years_to_failure.items()
            ),
            *(
                (f"spectral: {method}", value, "1/year")
                for method, value in self.spectral_damage_per_year.items()
            ),
        ]
        return [{"what": what, "value": value, "unit": unit} for what, value, unit in named]

    @checked
    def plot(self, path: str | Path | None = None) -> Axes:
        """Draw how many cycles exceed each stress range.

        Parameters
        ----------
        path
            File to write (.png, .pdf, .svg); None for none.

        Returns
        -------
        The matplotlib axes.
        """
        (axes,) = new_figure()
        order = np.argsort(-self.ranges)
        axes.step(np.cumsum(self.range_cycles[order]), self.ranges[order], where="post")
        axes.set(xlabel="cycles above the range", ylabel=f"stress range [{self.unit}]")
        axes.set_xscale("log")
        return save(axes, path)


@checked
def fatigue_damage(
    stress: Signals | VirtualQuantity,
    *,
    channel: str | None = None,
    detail_category: Positive | None = None,
    constant: Positive | None = None,
    slope: Positive | None = None,
    knee: NotNegative = 0.0,
    lower_slope: Positive | None = None,
    cut_off: NotNegative = 0.0,
    log10_sd: NotNegative = 0.2,
    mean_stress: Literal["none", "goodman", "gerber"] = "none",
    strength: Positive | None = None,
    constant_mean: float = 0.0,
) -> FatigueDamage:
    """Count stress cycles by rainflow and sum their fatigue damage, with its scatter.

    Parameters
    ----------
    stress
        Signals of a measured stress, or a stress that `slowtime.virtual` estimated; the errors
        of the estimate are part of the scatter.
    channel
        Channel of the stress, where the signals have several.
    detail_category
        Detail category of EN 1993-1-9, such as 71; the stress is then in MPa.
    constant, slope
        Constant and slope of an S-N curve of stress ranges, at the median: N = constant /
        range^slope. Give either these or a detail category.
    knee
        Stress range below which `lower_slope` holds.
    lower_slope
        Slope below the knee.
    cut_off
        Stress range below which there is no damage.
    log10_sd
        Standard deviation of log10 of the life; DNV-RP-C203 takes 0.2 for welded steel [1].
    mean_stress
        Correction for the mean stress of cycles; needs `strength`.
    strength
        Tensile strength, in the unit of the stress.
    constant_mean
        Stress at rest, which accelerations do not show, in the unit of the stress.

    Returns
    -------
    Miner's sum with its interval, the time to failure, spectral estimates and the histogram of
    ranges.

    Raises
    ------
    ValueError
        If the curve is not stated once, or the channel is not.

    References
    ----------
    .. [1] ASTM E1049-85, Standard Practices for Cycle Counting in Fatigue Analysis.

    Examples
    --------
    >>> stress = Signals(50.0 * np.sin(np.arange(1000) * 0.2 * np.pi), 10.0, ["s"], "MPa")
    >>> found = fatigue_damage(stress, detail_category=71)
    >>> round(found.largest_range, 1), round(found.cycles)
    (96.6, 100)
    """
    with fields_named({}):
        point = PointCurve(
            detail_category=detail_category, constant=constant, slope=slope, knee=knee,
            lower_slope=lower_slope, cut_off=cut_off, log10_sd=log10_sd,
            mean_stress=mean_stress, strength=strength, constant_mean=constant_mean,
        )  # fmt: skip
    if isinstance(stress, VirtualQuantity):
        if channel is not None:
            raise ValueError(
                f"channel={channel!r} was given with a virtual quantity. Leave it out."
            )
        found = stress.signals()
        values, name, unit = found.samples[:, 0], stress.name, stress.unit
        errors, reasons = (stress.missing_variance, stress.model_variance), stress.reasons
    else:
        values, name, unit = _channel(stress, channel)
        errors, reasons = (0.0, 0.0), ()
    return _damage(values, stress.rate_hz, point, errors, (name, unit, reasons))


def _channel(signals: Signals, channel: str | None) -> tuple[Any, str, str]:
    """Return samples, name and unit of the channel of stress."""
    record = signals.record
    if channel is None and len(record.channels) != 1:
        raise ValueError(
            f"The record has {len(record.channels)} channels: {', '.join(record.channels)}. "
            "Name the one of stress."
        )
    column = 0 if channel is None else find_column(channel, record.channels)
    return record.samples[:, column], record.channels[column], record.units[column] or "1"


def _damage(
    stress: Any,
    rate_hz: float,
    point: PointCurve,
    errors: tuple[float, float],
    told: tuple[str, str, tuple[str, ...]],
) -> FatigueDamage:
    """Count and sum; `errors` are variances of missing modes and of the model."""
    counter, curve = point.counter(), point.curve
    count = counter.step(Count(), np.asarray(stress, dtype=float))
    total, histogram = counter.miner(count), counter.total(count)
    seconds = (count.samples - count.skipped) / rate_hz
    missing, wrong = errors
    if missing or wrong:
        size = count.sum_of_squares / max(1, count.samples)
        lacking = 0.5 * np.log1p(missing / size) if size else 0.0
        error = np.sqrt(wrong / size) if size else 0.0
        total = total.with_stress_error(
            float(np.hypot(error, lacking / 2)), float(np.exp(lacking))
        )
    rate = total.median / seconds if seconds else 0.0
    left = TimeToFailure.of(total, rate)
    low, high = total.interval()
    length = max(8, len(stress) // SPECTRAL_WINDOWS)
    spectrum = welch(np.asarray(stress, float)[:, None], rate_hz, segment_s=length / rate_hz)
    density = spectrum.density[:, 0]
    moments = SpectralMoments.of(spectrum.frequency_hz, density) if density.any() else None
    methods = METHODS if moments is not None else ()
    return FatigueDamage(
        point=told[0], unit=told[1], reasons=told[2], seconds=seconds,
        cycles=float(histogram.counts.sum()),
        largest_range=float(histogram.ranges.max()) if histogram.half_cycles else 0.0,
        equivalent_range=equivalent_range(histogram, curve.slope),
        damage=total.median, damage_lo=low, damage_hi=high, damage_sd=total.sd,
        damage_per_year=rate * YEAR_S,
        years_to_failure={p: left.quantile(p) / YEAR_S for p in QUANTILES},
        spectral_damage_per_year={
            method: damage_rate(moments, curve, method) * YEAR_S
            for method in methods
            if moments is not None
        },
        ranges=histogram.ranges, range_cycles=histogram.counts, skipped=count.skipped,
    )  # fmt: skip
