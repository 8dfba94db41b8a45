"""What models leave, in; the accelerometer that tells what no structure could do, out.

A structure that is held has no lasting acceleration: over a record its mean is what speed has
gained, by the time. What an accelerometer tells beyond that is its own, however much else is
missing; and with that in the way, how records begin tells of nothing.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from slowtime.dynamics.effects import Kind, Place
from slowtime.signals.spectra import transform

from .candidates import Candidate
from .floor import floats
from .naming import Named, refitted
from .records import Trial
from .refit import Fit, slowest_hz

KINDS = ("sensor_bias", "sensor_drift")
BELOW, LINES = 0.3, 3
"""Times the lowest natural frequency below which a structure does not vibrate; and how many
lines of a record have to lie there for anything to be said."""
STANDS = 100.0
"""Times the power of those lines that the mean must have."""


def standing(fit: Fit, trials: Sequence[Trial]) -> Place | None:
    """Say which accelerometer stands off the most, if one does."""
    if len(fit.states) != len(trials) or floats(fit.plant.description):
        return None
    heights = [_height(fit, trials, i) for i in range(len(fit.plant.description.sensors))]
    best = int(np.argmax(heights))
    if heights[best] < STANDS:
        return None
    return Place("sensor", fit.plant.description.sensors[best].channel)


def put_right(
    before: Fit,
    place: Place,
    tried: Sequence[Candidate],
    trials: Sequence[Trial],
    kinds: Mapping[str, Kind],
) -> Named | None:
    """Refit a constant error or a drift there; None where it stands off all the same."""
    own = [one.effect for one in tried if one.effect.place == place]
    laws = [effect for effect in own if effect.kind in KINDS]
    every = [refitted(before, e, trials, kinds, None, horizons=(1.0,)) for e in laws]
    best = max((one for one in every if one), key=lambda one: one.score, default=None)
    return None if best is None or standing(best.fit, trials) == place else best


def _height(fit: Fit, trials: Sequence[Trial], sensor: int) -> float:
    """Power of the mean over that of the slow lines beside it, where it is most."""
    if fit.plant.description.sensors[sensor].quantity != "acceleration":
        return 0.0
    lowest = slowest_hz(fit.plant)
    found = 0.0
    for residual, trial in zip(fit.residual, trials, strict=True):
        if not trial.used[:, sensor].all() or not lowest:
            continue
        frequency, spectrum = transform(residual[:, [sensor]], trial.rate_hz)
        power = np.abs(spectrum[:, 0]) ** 2
        slow = power[1:][frequency[1:] < BELOW * lowest]
        if len(slow) >= LINES:
            found = max(found, float(power[0] / max(slow.mean(), 1e-300)))
    return found
