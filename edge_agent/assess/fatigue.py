"""Counts stress cycles at one point, and sums their damage by Miner's rule."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from edge_agent.settings import PointSettings
from slowtime.fatigue.counter import Count, Counter
from slowtime_schemas.messages import CurveOfMessage, FatiguePoint


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class CycleCount:
    """Cycles and damage that were counted at a point.

    Parameters
    ----------
    missing, wrong
        Sums over samples of the variance that a virtual stress lacks, and of the squared
        error that its model may cause; 0 for a stress that a channel measures.
    """

    count: Count = dataclasses.field(default_factory=Count)
    unit: str = ""
    seconds: float = 0.0
    missing: float = 0.0
    wrong: float = 0.0
    reasons: tuple[str, ...] = ()


class Point:
    """Counts at one point."""

    def __init__(self, settings: PointSettings) -> None:
        self.settings = settings
        self._counter: Counter = settings.counter()

    def step(
        self,
        counted: CycleCount,
        stress: Float[np.ndarray, " time"],
        rate_hz: float,
        unit: str,
        *,
        missing: float = 0.0,
        wrong: float = 0.0,
        reasons: tuple[str, ...] = (),
    ) -> CycleCount:
        """Take samples of stress.

        `missing` is the variance that the samples lack, `wrong` the mean square of what may be
        wrong with them.
        """
        count = self._counter.step(counted.count, stress)
        return CycleCount(
            count=count,
            unit=unit,
            seconds=counted.seconds + len(stress) / rate_hz,
            missing=counted.missing + missing * len(stress),
            wrong=counted.wrong + wrong * len(stress),
            reasons=tuple(dict.fromkeys(counted.reasons + reasons)),
        )

    def told(self, counted: CycleCount, *, virtual: bool) -> FatiguePoint:
        """Convert to the message."""
        total, histogram = (
            self._counter.miner(counted.count),
            self._counter.total(counted.count),
        )
        factor = 1.0
        if virtual and counted.count.sum_of_squares > 0:
            # The estimate varies less than the stress does, by what the filters cannot tell;
            # half of the correction is taken for its standard deviation.
            lacking = 0.5 * math.log1p(counted.missing / counted.count.sum_of_squares)
            error = math.sqrt(counted.wrong / counted.count.sum_of_squares)
            factor = math.exp(lacking)
            total = total.with_stress_error(math.hypot(error, lacking / 2), factor)
        curve = self._counter.curve
        return FatiguePoint(
            name=self.settings.at,
            unit=counted.unit,
            source="virtual" if virtual else "channel",
            bins=tuple(sorted(histogram.half_cycles)),
            half_cycles=tuple(histogram.half_cycles[k] for k in sorted(histogram.half_cycles)),
            damage=total.median,
            closed_damage=counted.count.damage * factor**total.slope,
            ln_sd=total.ln_sd,
            slope=total.slope,
            curve=CurveOfMessage(
                constant=curve.constant,
                slope=curve.slope,
                knee=curve.knee,
                lower_slope=curve.lower_slope,
                cut_off=curve.cut_off,
                log10_sd=curve.log10_sd,
            ),
            seconds=counted.seconds,
            skipped=counted.count.skipped,
            reasons=counted.reasons + (("quasi_static_part_unseen",) if virtual else ()),
        )
