"""Rainflow count of a stream, with its cycles and Miner's sum at any time.

Where a stream is cut changes nothing: the points that no cycle has closed are carried over.
"""

import dataclasses

import numpy as np

from .curves import SNCurve
from .cycles import Cycles, Points, Series, extract, residue_cycles, turning_points
from .histogram import Histogram
from .mean_stress import MeanStress
from .miner import MinerSum

LONGEST_RESIDUE = 4096
"""Points that are carried over at most. Ranges of a residue decrease strictly: noise leaves
some tens of points; what is longer was made by hand, and its largest ranges become half
cycles."""
_NOTHING = np.zeros(0)


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Count:
    """What a counter has seen.

    Parameters
    ----------
    residue
        Points whose ranges are not closed; the last is the latest sample.
    histogram
        Of the ranges that are closed, corrected for their mean.
    damage, upper_damage
        Miner's sum of these, and the part of it that is above the knee of the curve [1].
    samples, skipped
        How many were taken, and how many of them were not finite.
    sum, sum_of_squares
        Of the samples that were taken.
    """

    residue: Points = dataclasses.field(default_factory=lambda: _NOTHING)
    histogram: Histogram = dataclasses.field(default_factory=Histogram)
    damage: float = 0.0
    upper_damage: float = 0.0
    samples: int = 0
    skipped: int = 0
    sum: float = 0.0
    sum_of_squares: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Counter:
    """Counts cycles of a stream and adds up their damage.

    Examples
    --------
    >>> counter = Counter(curve=SNCurve(constant=1e6, slope=3.0))
    >>> wave = np.tile([3.0, -2.0, 1.0, -3.0], 500)
    >>> whole = counter.step(Count(), wave)
    >>> cut = counter.step(counter.step(Count(), wave[:1233]), wave[1233:])
    >>> cut.histogram == whole.histogram, counter.total(whole).half_cycles
    (True, {25: 1000, 41: 999})
    """

    curve: SNCurve
    mean_stress: MeanStress = dataclasses.field(default_factory=MeanStress)

    def step(self, count: Count, series: Series) -> Count:
        """Process samples; those that are not finite are skipped and counted.

        Parameters
        ----------
        count
            State after the samples before.
        series
            Stress at equal steps, in the unit of the curve.

        Returns
        -------
        State after the samples.
        """
        finite = np.isfinite(series)
        skipped = len(series) - int(finite.sum())
        taken = series[finite] if skipped else series
        if not len(taken):
            return dataclasses.replace(
                count, samples=count.samples + skipped, skipped=count.skipped + skipped
            )
        cycles, residue = extract(turning_points(np.concatenate([count.residue, taken])))
        if len(residue) > LONGEST_RESIDUE:
            cut = len(residue) - LONGEST_RESIDUE
            cycles = cycles.then(residue_cycles(residue[: cut + 1]))
            residue = residue[cut:]
        damage, upper = self._damage(cycles)
        return Count(
            residue=residue,
            histogram=count.histogram + Histogram.of(self.mean_stress.corrected(cycles)),
            damage=count.damage + damage,
            upper_damage=count.upper_damage + upper,
            samples=count.samples + len(series),
            skipped=count.skipped + skipped,
            sum=count.sum + float(taken.sum()),
            sum_of_squares=count.sum_of_squares + float(taken @ taken),
        )

    def total(self, count: Count) -> Histogram:
        """Histogram with what is not closed as half cycles, as ASTM E1049 ends a count."""
        return count.histogram + Histogram.of(
            self.mean_stress.corrected(residue_cycles(count.residue))
        )

    def miner(self, count: Count) -> MinerSum:
        """Miner's sum up to the latest sample, what is not closed as half cycles."""
        damage, upper = self._damage(residue_cycles(count.residue))
        return MinerSum.of(self.curve, count.damage + damage, count.upper_damage + upper)

    def _damage(self, cycles: Cycles) -> tuple[float, float]:
        corrected = self.mean_stress.corrected(cycles)
        each = corrected.counts * self.curve.damage(corrected.ranges)
        upper = each[corrected.ranges >= self.curve.knee]
        return float(each.sum()), float(upper.sum())
