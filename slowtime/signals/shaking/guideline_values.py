"""Peak velocities up to which buildings are not expected to be damaged: DIN 4150-3 (2016)."""

from typing import Literal

import numpy as np
from jaxtyping import Float

Building = Literal["industrial", "residential", "sensitive"]
Place = Literal["foundation", "top_floor", "ceiling"]

FREQUENCIES_HZ = (1.0, 10.0, 50.0, 100.0)
"""[Hz] Corners of the values at foundations, which are straight between them (table 1)."""

AT_FOUNDATION = {
    "industrial": (20.0, 20.0, 40.0, 50.0),
    "residential": (5.0, 5.0, 15.0, 20.0),
    "sensitive": (3.0, 3.0, 8.0, 10.0),
}
"""[mm/s] Short vibration, any direction, at `FREQUENCIES_HZ` (table 1)."""

ELSEWHERE = {
    ("top_floor", "short"): {"industrial": 40.0, "residential": 15.0, "sensitive": 8.0},
    ("ceiling", "short"): {"industrial": 20.0, "residential": 20.0},
    ("top_floor", "lasting"): {"industrial": 10.0, "residential": 5.0, "sensitive": 2.5},
    ("ceiling", "lasting"): {"industrial": 10.0, "residential": 10.0},
}
"""[mm/s] At any frequency: horizontal in the plane of the top floor, and vertical in ceilings
(tables 1 and 4). For ceilings of sensitive buildings none is given: it is agreed case by
case."""


def guideline_value(
    frequency_hz: Float[np.ndarray, " value"],
    building: Building,
    place: Place = "foundation",
    duration: Literal["short", "lasting"] = "short",
) -> Float[np.ndarray, " value"]:
    """Give the guideline value of the peak velocity [m/s].

    Damage is not expected below it; above it, damage does not follow.

    Parameters
    ----------
    frequency_hz
        Dominating frequency of the vibration [Hz]. It matters at foundations.
    building
        ``industrial``, ``residential``, or ``sensitive`` as listed buildings are.
    place
        ``foundation``, any direction; ``top_floor``, horizontal; ``ceiling``, vertical.
    duration
        ``short``, as of blasts; ``lasting``, where fatigue or resonance may occur.

    Raises
    ------
    ValueError
        Where the standard gives no value.
    """
    frequency = np.asarray(frequency_hz, dtype=float)
    if place == "foundation" and duration == "short":
        values = np.interp(frequency, FREQUENCIES_HZ, AT_FOUNDATION[building])
        return np.where(np.isnan(frequency), np.nan, 1e-3 * values)
    found = ELSEWHERE.get((place, duration), {}).get(building)
    if found is None:
        raise ValueError(
            f"DIN 4150-3 gives no value for {duration} vibration of a {building} building at "
            f"its {place.replace('_', ' ')}. Measure at the top floor instead."
        )
    return np.full(frequency.shape, 1e-3 * found)
