"""Which kind of excitation a measured input is: hammer blows, or a continuous force."""

from typing import Literal

import numpy as np
from jaxtyping import Float

Excitation = Literal["hammer", "shaker"]

PULSE_SHARE = 0.05
"""[1] Largest share of samples above `PULSE_LEVEL` of a record of blows. A Gaussian force has
80 % of its samples above a twentieth of its peak, a sine nearly all."""

PULSE_LEVEL = 0.05
"""[peak] Level for this share."""


def kind_of_excitation(force: Float[np.ndarray, "time input"]) -> Excitation:
    """Tell hammer blows, a single input that is nearly always at rest, from a shaker.

    Examples
    --------
    >>> blows = np.zeros((1000, 1))
    >>> blows[100:103] = 5.0
    >>> kind_of_excitation(blows)
    'hammer'
    """
    if force.shape[1] > 1:
        return "shaker"
    size = np.abs(force[:, 0] - np.median(force[:, 0]))
    busy = np.mean(size > PULSE_LEVEL * size.max()) if size.max() > 0 else 1.0
    return "hammer" if busy < PULSE_SHARE else "shaker"
