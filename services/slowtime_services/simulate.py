"""A structure that ages while nobody looks: slow evolution in, blocks of samples out.

Every epoch is made from its own stream of random numbers, so that epoch 1000 is the same
whether or not the 999 before it were ever asked for. Within an epoch the structure stands still
in slow time: t_s is so much slower than t that one record sees one oscillator (Ganguli et al.,
"Digital Twin: A Dynamic System and Computing Perspective", CRC Press 2023, section 5.2).
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import BaseModel, ConfigDict, Field, model_validator

from slowtime.dynamics.degradation import mass_change, stiffness_change
from slowtime.dynamics.oscillator import Oscillator
from slowtime.dynamics.stepping import ambient_acceleration, simulate
from slowtime.signals.block import Block

ORIGIN_NS = 1_767_225_600_000_000_000
"""2026-01-01 UTC: where a simulator's own time begins unless told otherwise."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Constant(_Frozen):
    """Nothing changes after a first difference from the structure as built."""

    kind: Literal["constant"] = "constant"
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = 0.0

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change


class Linear(_Frozen):
    """A steady drift that stops at a limit."""

    kind: Literal["linear"] = "linear"
    rate: Annotated[
        float, Field(allow_inf_nan=False, description="Change per unit of slow time.")
    ] = -2e-4
    limit: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = -0.5

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        drift = self.rate * slow_time
        return max(drift, self.limit) if self.rate < 0 else min(drift, abs(self.limit))


class Step(_Frozen):
    """A sudden change, as after a collision."""

    kind: Literal["step"] = "step"
    at_slow_time: float = 100.0
    change: Annotated[float, Field(gt=-1, allow_inf_nan=False)] = -0.1

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        return self.change if slow_time >= self.at_slow_time else 0.0


class Fatigue(_Frozen):
    """Exponential loss with a ripple, eq. 5.12 of the book."""

    kind: Literal["fatigue"] = "fatigue"
    rate: NotNegative = 4e-4
    ripple: Annotated[float, Field(ge=0, lt=1)] = 0.05
    ripple_rate: NotNegative = 2e-2
    renewed_after: Positive | None = None
    """Slow time after which the structure is as built again, and so on; None for never."""

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        age = slow_time if self.renewed_after is None else slow_time % self.renewed_after
        series = stiffness_change(
            np.array([age]),
            rate=self.rate,
            ripple=self.ripple,
            ripple_rate=self.ripple_rate,
        )
        return float(series[0])


class FillingAndEmptying(_Frozen):
    """Mass that comes and goes in steps, as in a tank or an aircraft, eq. 5.13 of the book."""

    kind: Literal["filling"] = "filling"
    amplitude: NotNegative = 0.25
    rate: NotNegative = 0.15

    def at(self, slow_time: float) -> float:
        """Relative change at `slow_time`."""
        series = mass_change(np.array([slow_time]), amplitude=self.amplitude, rate=self.rate)
        return float(series[0])


Evolution = Annotated[
    Constant | Linear | Step | Fatigue | FillingAndEmptying, Field(discriminator="kind")
]


class Sensor(_Frozen):
    """How the accelerometer spoils what it measures."""

    noise: NotNegative = 0.05
    """Standard deviation of white noise, in `acceleration_rms`."""
    spikes_per_epoch: NotNegative = 0.0
    spike_size: Positive = 20.0
    """In `acceleration_rms`."""
    dropouts_per_epoch: NotNegative = 0.0
    dropout_s: NotNegative = 0.05
    dtype: Literal["<f8", "<f4"] = "<f4"


class Temperature(_Frozen):
    """A covariate that swings, and what it does to the stiffness."""

    mean_c: float = 12.0
    swing_c: NotNegative = 0.0
    period: Positive = 365.0
    """In slow time."""
    stiffness_per_c: float = 0.0
    """Relative change of stiffness per kelvin above `mean_c`."""


class SimulatedStructure(_Frozen):
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
        ``"hammer"``: one blow at the start of the record, then free decay.
    seconds, rate_hz
        Length and rate of each epoch's record.
    epochs
        How many there are; None for no end.
    slow_time_step
        From one epoch to the next, in `slow_time_unit`.
    interval_s
        From the start of one record to the start of the next, on the simulator's own clock.
    block_s
        Longest block; None for one block an epoch where no samples are missing.
    acceleration_rms
        Of the resonant part of the nominal structure's ambient response [m/s^2]; after a blow,
        what the first peak is on average.
    seed
        Decides every random number.
    """

    frequency_hz: Positive = 5.0
    damping_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.02
    mass_kg: Positive = 1.0
    stiffness: Evolution = Constant()
    mass: Evolution = Constant()
    excitation: Literal["ambient", "hammer"] = "ambient"
    seconds: Positive = 60.0
    rate_hz: Positive = 100.0
    epochs: Annotated[int, Field(ge=1)] | None = None
    slow_time_step: Positive = 1.0
    slow_time_unit: str = "T0"
    interval_s: Positive = 3600.0
    block_s: Positive | None = None
    acceleration_rms: Positive = 0.1
    sensor: Sensor = Sensor()
    temperature: Temperature | None = None
    start_ns: Annotated[int, Field(ge=0)] = ORIGIN_NS
    channel: str = "acceleration"
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _is_heard(self) -> "SimulatedStructure":
        if self.frequency_hz >= 0.4 * self.rate_hz:
            raise ValueError(
                f"frequency_hz={self.frequency_hz} is not below 0.4 of rate_hz={self.rate_hz}. "
                "Sample faster, or simulate a slower structure."
            )
        if self.samples < 16:
            raise ValueError(
                f"A record of seconds={self.seconds} at rate_hz={self.rate_hz} has "
                f"{self.samples} samples; at least 16 are needed. Record longer."
            )
        if self.interval_s < self.seconds:
            raise ValueError(
                f"interval_s={self.interval_s} is shorter than seconds={self.seconds}: records "
                "would overlap. Raise interval_s."
            )
        return self

    @property
    def samples(self) -> int:
        """Samples of one epoch."""
        return round(self.seconds * self.rate_hz)

    @property
    def nominal(self) -> Oscillator:
        """Structure as built."""
        return Oscillator.from_modal(self.frequency_hz, self.damping_ratio, self.mass_kg)

    def truth(self, epoch: int) -> dict[str, float]:
        """Tell what the simulator knows of an epoch, and a sensor does not."""
        dk, dm = self._changes(epoch)
        built = self.nominal
        now = self._oscillator(epoch)
        return {
            "stiffness_change": dk,
            "mass_change": dm,
            "frequency_hz": now.natural_frequency / (2 * math.pi),
            "damping_ratio": built.damping_ratio / math.sqrt((1 + dk) * (1 + dm)),
        }

    def epoch(self, number: int) -> tuple[Block, ...]:
        """Make the blocks of one epoch; several where samples are missing or `block_s` cuts."""
        seeds = np.random.SeedSequence(self.seed, spawn_key=(number,)).spawn(4)
        shake, noise, spikes, dropouts = (np.random.default_rng(seed) for seed in seeds)
        sigma = self.sensor.noise * self.acceleration_rms
        signal = self._response(number, shake) + sigma * noise.standard_normal(self.samples)
        signal = self._add_spikes(signal, spikes).astype(self.sensor.dtype)
        return tuple(self._cut(number, signal, self._present(dropouts)))

    def blocks(self, first_epoch: int = 0) -> Iterator[Block]:
        """Blocks of all epochs in order."""
        number = first_epoch
        while self.epochs is None or number < self.epochs:
            yield from self.epoch(number)
            number += 1

    def temperature_at(self, slow_time: float) -> float | None:
        """Temperature [°C], where the structure has one."""
        swing = self.temperature
        if swing is None:
            return None
        return swing.mean_c + swing.swing_c * math.sin(2 * math.pi * slow_time / swing.period)

    def _changes(self, epoch: int) -> tuple[float, float]:
        slow_time = epoch * self.slow_time_step
        dk = self.stiffness.at(slow_time)
        celsius = self.temperature_at(slow_time)
        if celsius is not None and self.temperature is not None:
            warmer = celsius - self.temperature.mean_c
            dk = (1 + dk) * (1 + self.temperature.stiffness_per_c * warmer) - 1
        return dk, self.mass.at(slow_time)

    def _oscillator(self, epoch: int) -> Oscillator:
        dk, dm = self._changes(epoch)
        built = self.nominal
        return Oscillator(
            built.mass_kg * (1 + dm),
            built.damping_n_s_per_m,
            built.stiffness_n_per_m * (1 + dk),
        )

    def _response(self, epoch: int, rng: np.random.Generator) -> Float[np.ndarray, " time"]:
        """Acceleration before the sensor has seen it [m/s^2]."""
        now, built = self._oscillator(epoch), self.nominal
        omega = built.natural_frequency
        if self.excitation == "ambient":
            # White force of one-sided PSD S makes the variance S / (8 zeta omega^3 m^2) of
            # displacement (maths of a lightly damped oscillator), omega^4 times that of
            # acceleration near the resonance.
            psd = (self.mass_kg * self.acceleration_rms) ** 2 * 8 * self.damping_ratio / omega
            return ambient_acceleration(now, self.samples, self.rate_hz, rng, force_psd=psd)
        velocity = rng.uniform(0.7, 1.3) * self.acceleration_rms / omega
        momentum = velocity * self.mass_kg
        rest = np.zeros(self.samples)
        return simulate(now, rest, self.rate_hz, initial=(0.0, momentum / now.mass_kg))[2]

    def _add_spikes(
        self, signal: Float[np.ndarray, " time"], rng: np.random.Generator
    ) -> Float[np.ndarray, " time"]:
        count = rng.poisson(self.sensor.spikes_per_epoch)
        where = rng.integers(0, self.samples, count)
        size = self.sensor.spike_size * self.acceleration_rms
        spiked = signal.copy()
        spiked[where] += size * rng.choice((-1.0, 1.0), count) * rng.uniform(0.5, 1.5, count)
        return spiked

    def _present(self, rng: np.random.Generator) -> Bool[np.ndarray, " time"]:
        """Which samples arrive; the first always does, so that an epoch is never empty."""
        present = np.ones(self.samples, dtype=bool)
        length = max(1, round(self.sensor.dropout_s * self.rate_hz))
        for start in rng.integers(1, self.samples, rng.poisson(self.sensor.dropouts_per_epoch)):
            present[start : start + length] = False
        return present

    def _cut(
        self,
        epoch: int,
        signal: Float[np.ndarray, " time"],
        present: Bool[np.ndarray, " time"],
    ) -> Iterator[Block]:
        edges = np.flatnonzero(np.diff(present.astype(np.int8), prepend=0, append=0))
        longest = self.samples if self.block_s is None else round(self.block_s * self.rate_hz)
        slow_time = epoch * self.slow_time_step
        celsius = self.temperature_at(slow_time)
        for first, last in edges.reshape(-1, 2).tolist():
            for start in range(first, last, max(longest, 1)):
                begins_s = epoch * self.interval_s + start / self.rate_hz
                yield Block(
                    samples=signal[start : min(start + longest, last), None],
                    rate_hz=self.rate_hz,
                    first_index=epoch * self.samples + start,
                    start_ns=self.start_ns + round(begins_s * 1e9),
                    channels=(self.channel,),
                    units=("m/s^2",),
                    epoch=epoch,
                    slow_time=slow_time,
                    covariates={} if celsius is None else {"temperature_c": celsius},
                    truth=self.truth(epoch),
                )
