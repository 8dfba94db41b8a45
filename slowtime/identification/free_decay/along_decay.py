"""One number for the damping of a decay where one holds; else a value with its range."""

import dataclasses

import numpy as np
from jaxtyping import Float

from slowtime.identification.estimates import Identified, Measured

from .amplitude_law import STRONG, DecayLaw, decay_law
from .envelope import decay_envelope

DEPENDS = "depends_on_amplitude"
"""Flag of a mode whose damping or frequency is not one number along its decay."""
OTHER = 3.0
"""Distance of a mode from the frequency along the decay, beyond a half-bandwidth, from which it
was another motion that was fitted [standard deviations]."""
BEATS = "beats"
"""Flag of a mode whose damping may be the beat with another one."""


def along_decay(
    mode: Identified, samples: Float[np.ndarray, "time channel"], rate_hz: float
) -> tuple[Identified, DecayLaw | None]:
    """Compare a mode of a free decay with its course along the decay.

    The mode has at least the error that its difference from the whole decay tells. Where
    damping or frequency depend on amplitude, it has the values at the middle amplitude and a
    standard deviation that spans those at amplitudes down to a tenth of the largest. The law is
    None where the decay is too short for one.
    """
    try:
        law = decay_law(decay_envelope(samples, rate_hz, near_hz=mode.frequency_hz.value))
    except ValueError:
        return mode, None
    strong = law.amplitude > STRONG * law.amplitude[0]
    natural = law.frequency_hz / np.sqrt(1.0 - law.damping**2)
    damping, frequency = law.damping[strong], natural[strong]
    middle = len(damping) // 2
    if law.one_number:
        told = float(np.mean(law.damping_sd[strong]))
        hz, sd = float(frequency[middle]), float(law.frequency_sd_hz[strong][middle])
        if abs(hz - mode.frequency_hz.value) > float(damping[middle]) * hz + OTHER * sd:
            # A drive that stopped within the record, of which a stretch was fitted.
            return dataclasses.replace(
                mode,
                frequency_hz=Measured(hz, sd),
                damping_ratio=Measured(float(damping[middle]), told),
                correlation=0.0,
            ), law
        return dataclasses.replace(
            mode, damping_ratio=_spanning(mode.damping_ratio, float(damping[middle]), told)
        ), law
    flags = (*mode.flags, DEPENDS, *((BEATS,) if law.beats else ()))
    own = float(law.damping_sd[strong][middle]), float(law.frequency_sd_hz[strong][middle])
    changed = dataclasses.replace(
        mode,
        damping_ratio=_covering(damping, middle, own[0]),
        frequency_hz=_covering(frequency, middle, own[1]),
        correlation=0.0,
        flags=flags,
    )
    return changed, law


def along_decay_note(
    mode: Identified, samples: Float[np.ndarray, "time channel"], rate_hz: float
) -> str:
    """Say at which amplitude a mode with `DEPENDS` is stated, and what the decay tells."""
    _, law = along_decay(mode, samples, rate_hz)
    if law is None:
        return ""
    strong = law.amplitude[law.amplitude > STRONG * law.amplitude[0]]
    return (
        f"mode at {mode.frequency_hz.value:.4g} Hz: {law.sentence} Its values are those "
        f"at amplitude {strong[len(strong) // 2]:.3g}, with the range down to a tenth of the "
        "largest; `slowtime modes distortion --decay` prints the table."
    )


def _spanning(given: Measured, other: float, other_sd: float) -> Measured:
    """Enlarge an error where another estimate differs by more than two of both."""
    apart = abs(given.value - other)
    if apart <= 2 * float(np.hypot(given.sd, other_sd)):
        return given
    return Measured(given.value, max(given.sd, apart / 2))


def _covering(values: Float[np.ndarray, " point"], middle: int, own: float) -> Measured:
    value = float(values[middle])
    return Measured(value, max(own, float(np.abs(values - value).max())))
