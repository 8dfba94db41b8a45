"""Faulty inputs: wrong gain, time delay."""

import numpy as np

from slowtime.dynamics.effects.kind import InputChange, Kind, Parameter, Series, Several, Values
from slowtime.signals.interpolation import at_instants


def gained(series: Several, times: Series, p: Values) -> Several:
    """Multiply the recorded series by a factor."""
    return np.asarray(p[0] * series)


def delayed(series: Several, times: Series, p: Values) -> Several:
    """Delay the recorded series."""
    rate_hz = (len(times) - 1) / (times[-1] - times[0])
    return at_instants(series, (times - times[0] - p[0]) * rate_hz)


KINDS = (
    Kind(
        name="input_gain",
        title="Input off by a factor",
        family="input",
        where="input",
        parameters=(
            Parameter(
                name="gain", unit="", meaning="factor on the recorded input", nonzero=True
            ),
        ),
        equation="input × g",
        source="",
        sentence="The input is larger or smaller than recorded.",
        action=InputChange(act=gained),
    ),
    Kind(
        name="input_delay",
        title="Late input",
        family="input",
        where="input",
        parameters=(
            Parameter(name="delay_s", unit="s", meaning="delay behind the recorded input"),
        ),
        equation="input(t − τ)",
        source="",
        sentence="The input acts later than recorded.",
        action=InputChange(act=delayed),
    ),
)
