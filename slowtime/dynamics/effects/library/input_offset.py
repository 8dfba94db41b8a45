"""Inputs with a constant offset."""

import numpy as np

from slowtime.dynamics.effects.kind import InputChange, Kind, Parameter, Series, Several, Values


def lifted(series: Several, times: Series, p: Values) -> Several:
    """Add a constant to the recorded series."""
    return np.asarray(series + p[0])


KINDS = (
    Kind(
        name="input_bias",
        title="Input off by a constant",
        family="input",
        where="input",
        parameters=(
            Parameter(
                name="bias", unit="", meaning="constant on top of the recorded input, SI units"
            ),
        ),
        equation="input + b",
        source="",
        sentence="A constant acts that was not recorded, or was recorded and does not act.",
        action=InputChange(act=lifted),
    ),
)
