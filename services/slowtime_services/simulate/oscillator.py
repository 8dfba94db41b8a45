"""A simulated oscillator whose stiffness and mass change in slow time.

Within an epoch the structure stands still in slow time: t_s is so much slower than t that one
record sees one oscillator (Ganguli et al., "Digital Twin: A Dynamic System and Computing
Perspective", CRC Press 2023, section 5.2).
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from slowtime.dynamics.sdof.oscillator import Oscillator
from slowtime.dynamics.sdof.simulation import ambient_acceleration, simulate

from .evolutions import Evolution, Unchanged, renewals
from .field_types import Positive
from .measurement import LASTING, EvolvingStructure, Record


class SimulatedStructure(EvolvingStructure):
    """One degree of freedom that evolves in slow time and is listened to now and then.

    Stiffness and mass change as their evolutions say; the damping coefficient stays as built.

    Parameters
    ----------
    frequency_hz, damping_ratio, mass_kg
        As built: undamped natural frequency [Hz], damping ratio [1], mass [kg].
    stiffness, mass
        Relative change in slow time.
    excitation
        ``"ambient"``: white force, band-limited by the sampling, response already stationary;
        ``"hammer"``: one blow at the start of the record, then free decay, whose first peak
        is `acceleration_rms` on average.
    """

    kind: Literal["oscillator"] = "oscillator"
    frequency_hz: Positive = 5.0
    damping_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.02
    mass_kg: Positive = 1.0
    stiffness: Evolution = Unchanged()
    mass: Evolution = Unchanged()
    excitation: Literal["ambient", "hammer"] = "ambient"
    channel: str = "acceleration"

    @property
    def channels(self) -> tuple[str, ...]:
        """The one acceleration."""
        return (self.channel,)

    @property
    def nominal(self) -> Oscillator:
        """Structure as built."""
        return Oscillator.from_modal(self.frequency_hz, self.damping_ratio, self.mass_kg)

    def truth(self, epoch: int) -> dict[str, float]:
        """Return the true values of an epoch.

        With a temperature also ``lasting.stiffness_change``, without what that does.
        """
        dk, dm = self._changes(epoch)
        built = self.nominal
        now = self._oscillator(epoch)
        known = {
            "stiffness_change": dk,
            "mass_change": dm,
            "frequency_hz": now.natural_frequency / (2 * math.pi),
            "damping_ratio": built.damping_ratio / math.sqrt((1 + dk) * (1 + dm)),
        }
        if self.temperature is not None:
            lasting = self.stiffness.at(epoch * self.slow_time_step)
            known[f"{LASTING}stiffness_change"] = lasting
        return known

    def renewals(self, epoch: int) -> int | None:
        """Return the number of renewals of stiffness and mass before an epoch."""
        return renewals((self.stiffness, self.mass), epoch * self.slow_time_step)

    def _highest_hz(self) -> float:
        return self.frequency_hz

    def _changes(self, epoch: int) -> tuple[float, float]:
        slow_time = epoch * self.slow_time_step
        dk = self._warmed(self.stiffness.at(slow_time), epoch)
        return dk, self.mass.at(slow_time)

    def _oscillator(self, epoch: int) -> Oscillator:
        dk, dm = self._changes(epoch)
        built = self.nominal
        return Oscillator(
            built.mass_kg * (1 + dm),
            built.damping_n_s_per_m,
            built.stiffness_n_per_m * (1 + dk),
        )

    def _response(self, epoch: int, rng: np.random.Generator) -> Record:
        now, built = self._oscillator(epoch), self.nominal
        omega = built.natural_frequency
        if self.excitation == "ambient":
            # White force of one-sided PSD S makes the variance S / (8 zeta omega^3 m^2) of
            # displacement (maths of a lightly damped oscillator), omega^4 times that of
            # acceleration near the resonance.
            psd = (self.mass_kg * self.acceleration_rms) ** 2 * 8 * self.damping_ratio / omega
            heard = ambient_acceleration(now, self.samples, self.rate_hz, rng, force_psd=psd)
        else:
            velocity = rng.uniform(0.7, 1.3) * self.acceleration_rms / omega
            momentum = velocity * self.mass_kg
            rest = np.zeros(self.samples)
            start = (0.0, momentum / now.mass_kg)
            heard = simulate(now, rest, self.rate_hz, initial=start)[2]
        return heard[:, None]
