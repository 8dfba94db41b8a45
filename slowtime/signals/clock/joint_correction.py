"""One correction of the sampling rate for samples whose blocks each carry their own."""

import dataclasses
import math
from collections.abc import Iterable

from slowtime.signals.block import RateCorrection

AGREEMENT_SDS = 5.0
"""Difference of two estimates of one rate [standard deviations] up to which the rate is taken
to be constant. Source: `ClockTolerances.change`, from which on the clock model itself believes
in a change."""
_LEAST_SD = 1e-8
"""Standard deviation that a stated one counts as at least, in weights [1]. Source:
`ClockTolerances.wander`, the instability of any rate."""


@dataclasses.dataclass(frozen=True, slots=True)
class JointCorrection:
    """One correction for all blocks, and the range of those that contradict it.

    Parameters
    ----------
    correction
        The most exact estimate, of equal ones the latest; where others contradict it, the mean
        of all, weighted by their samples and inverse variances.
    lowest, highest
        Smallest and largest relative correction among the estimate and those that contradict
        it; both are `correction.relative` where none does.
    """

    correction: RateCorrection
    lowest: float
    highest: float

    @property
    def is_constant(self) -> bool:
        """Whether no estimate contradicts the most exact one."""
        return self.lowest == self.highest


def joint_correction(
    clocks: Iterable[tuple[RateCorrection | None, int]],
) -> JointCorrection | None:
    """Join the corrections that blocks of one nominal rate carry; None where none carries one.

    An estimate is made of all messages so far, so that a later one replaces earlier ones as
    long as the clock model has not begun anew. Early estimates are vague and state so.

    Parameters
    ----------
    clocks
        Correction and number of samples of each block of one device at one nominal rate, in
        the order of their time.

    Returns
    -------
    The correction, or None.
    """
    known = [(clock, count) for clock, count in clocks if clock is not None]
    if not known:
        return None
    best = known[0][0]
    for clock, _ in known:
        if clock.sd <= best.sd:
            best = clock
    others = [
        clock.relative
        for clock, _ in known
        if abs(clock.relative - best.relative) > AGREEMENT_SDS * math.hypot(clock.sd, best.sd)
    ]
    if not others:
        return JointCorrection(best, best.relative, best.relative)
    weights = [(c.relative, count / max(c.sd, _LEAST_SD) ** 2) for c, count in known]
    total = math.fsum(weight for _, weight in weights)
    mean = math.fsum(relative * weight for relative, weight in weights) / total
    spread = math.fsum(weight * (relative - mean) ** 2 for relative, weight in weights) / total
    sd = math.hypot(best.sd, math.sqrt(spread))
    return JointCorrection(
        RateCorrection(relative=mean, sd=sd),
        min(best.relative, *others),
        max(best.relative, *others),
    )
