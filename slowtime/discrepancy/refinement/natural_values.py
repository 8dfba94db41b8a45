"""Parameters near the value of the simplest form of their law, held at that value."""

from collections.abc import Mapping

import numpy as np

from slowtime.discrepancy.calibration import try_refit
from slowtime.discrepancy.estimation.model_evidence import natural_value, sds_from_natural_value
from slowtime.discrepancy.hypothesis import Hypothesis
from slowtime.dynamics.effects import Kind

MAX_SDS = 2.0
"""[standard deviations] From its natural value, up to which a parameter is held there. Source:
95 % of estimates whose true value is the natural one."""


def hold_natural_values(hypothesis: Hypothesis, kinds: Mapping[str, Kind]) -> Hypothesis:
    """Fit the last model again, its parameters at their natural values where they are near."""
    # An exponent of 1.002 ± 0.002 is 1, and what it was correlated with is known better then. A
    # parameter whose natural value is that of a constant stays free, as that is.
    last = hypothesis.last
    held = {
        name: natural[0]
        for name in last.prior.names
        if (natural := natural_value(last, name)) is not None
        and natural[1] == 0.0
        and sds_from_natural_value(last, name) <= MAX_SDS
    }
    if not held or hypothesis.final or not hypothesis.last_fits_whole_records:
        return hypothesis
    names = list(last.plant.entries)
    values = last.values.copy()
    values[[names.index(name) for name in held]] = np.array(list(held.values()))
    fit = try_refit(
        last.plant, hypothesis.trials, noise=last.noise, values=values, states=last.states,
        free=[name for name in last.prior.names if name not in held], horizons=(1.0,),
    )  # fmt: skip
    if fit is None or fit.cost - last.cost > MAX_SDS**2 * len(held):
        return hypothesis
    return hypothesis.with_last(fit, kinds)
