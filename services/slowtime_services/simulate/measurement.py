"""Measurement of a simulated structure: epochs, sensors and their errors.

Every epoch is made from its own stream of random numbers, so that epoch 1000 is the same
whether or not the 999 before it were ever asked for.
"""

import abc
import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, model_validator

from slowtime.signals.block import Block
from slowtime_schemas.quantities import RENEWALS, Immutable

from .field_types import NotNegative, Positive

ORIGIN_NS = 1_767_225_600_000_000_000
"""2026-01-01 UTC: where a simulator's own time begins unless told otherwise."""

LASTING = "lasting."
"""Before the name of a change in the truth: without what the temperature does."""

Record = Float[np.ndarray, "time channel"]


class SensorErrors(Immutable):
    """Errors that each accelerometer adds."""

    noise: NotNegative = 0.05
    """Standard deviation of white noise, in `acceleration_rms`."""
    spikes_per_epoch: NotNegative = 0.0
    spike_size: Positive = 20.0
    """In `acceleration_rms`."""
    dropouts_per_epoch: NotNegative = 0.0
    """Of all channels at once, as when a line to the logger is lost."""
    dropout_s: NotNegative = 0.05
    dtype: Literal["<f8", "<f4"] = "<f4"


class Temperature(Immutable):
    """A varying temperature, and its effect on the stiffness."""

    mean_c: float = 12.0
    swing_c: NotNegative = 0.0
    period: Positive = 365.0
    """In slow time."""
    daily_c: NotNegative = 0.0
    """Standard deviation of what each epoch has of its own."""
    stiffness_per_c: float = 0.0
    """Relative change of stiffness per kelvin above `mean_c`."""
    stiffness_per_c_below: float | None = None
    """Likewise below `freezing_c`, where ice makes it another; None for the same."""
    freezing_c: float = 0.0

    def softening(self, celsius: float) -> float:
        """Relative change of stiffness at a temperature.

        Examples
        --------
        >>> cold = Temperature(mean_c=10, stiffness_per_c=-0.001, stiffness_per_c_below=-0.005)
        >>> round(cold.softening(20.0), 6), round(cold.softening(-2.0), 6)
        (-0.01, 0.02)
        """
        below = self.stiffness_per_c_below
        steeper = 0.0 if below is None else below - self.stiffness_per_c
        cold = min(celsius - self.freezing_c, 0.0) - min(self.mean_c - self.freezing_c, 0.0)
        return self.stiffness_per_c * (celsius - self.mean_c) + steeper * cold


class EvolvingStructure(Immutable, abc.ABC):
    """A structure that evolves in slow time and is listened to now and then.

    Parameters
    ----------
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
        Of the resonant part of the nominal structure's ambient response [m/s^2]: what noise
        and spikes of the sensors are measured in.
    seed
        Decides every random number.
    """

    seconds: Positive = 60.0
    rate_hz: Positive = 100.0
    epochs: Annotated[int, Field(ge=1)] | None = None
    slow_time_step: Positive = 1.0
    slow_time_unit: str = "T0"
    interval_s: Positive = 3600.0
    block_s: Positive | None = None
    acceleration_rms: Positive = 0.1
    sensor: SensorErrors = SensorErrors()
    temperature: Temperature | None = None
    start_ns: Annotated[int, Field(ge=0)] = ORIGIN_NS
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    @abc.abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Names of the accelerations that are measured."""

    @property
    def units(self) -> tuple[str, ...]:
        """Of each channel."""
        return ("m/s^2",) * len(self.channels)

    @abc.abstractmethod
    def truth(self, epoch: int) -> dict[str, float]:
        """Return the true values of an epoch."""

    def renewals(self, epoch: int) -> int | None:
        """Return the number of renewals before an epoch; None if there are none."""
        return None

    @abc.abstractmethod
    def _highest_hz(self) -> float:
        """Highest natural frequency as built."""

    @abc.abstractmethod
    def _response(self, epoch: int, rng: np.random.Generator) -> Record:
        """Accelerations before the sensors have seen them [m/s^2]."""

    @model_validator(mode="after")
    def _is_heard(self) -> "EvolvingStructure":
        highest = self._highest_hz()
        if highest >= 0.4 * self.rate_hz:
            raise ValueError(
                f"A frequency of {highest:g} Hz is not below 0.4 of rate_hz={self.rate_hz}. "
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
    def _noise_sd(self) -> float | Float[np.ndarray, " channel"]:
        """Standard deviation of the noise of all channels, or of each."""
        return self.sensor.noise * self.acceleration_rms

    @property
    def samples(self) -> int:
        """Samples of one epoch."""
        return round(self.seconds * self.rate_hz)

    def epoch(self, number: int) -> tuple[Block, ...]:
        """Make the blocks of one epoch; several where samples are missing or `block_s` cuts."""
        seeds = self._seeds(number)[:4]
        shake, noise, spikes, dropouts = (np.random.default_rng(seed) for seed in seeds)
        signal = self._response(number, shake)
        signal = signal + self._noise_sd * noise.standard_normal(signal.shape)
        signal = self._add_spikes(signal, spikes).astype(self.sensor.dtype)
        return tuple(self._blocks_of(number, signal, self._present(dropouts)))

    def blocks(self, first_epoch: int = 0) -> Iterator[Block]:
        """Blocks of all epochs in order."""
        number = first_epoch
        while self.epochs is None or number < self.epochs:
            yield from self.epoch(number)
            number += 1

    def temperature_at(self, epoch: int) -> float | None:
        """Temperature of an epoch [°C], where the structure has one."""
        swing = self.temperature
        if swing is None:
            return None
        phase = 2 * math.pi * epoch * self.slow_time_step / swing.period
        celsius = swing.mean_c + swing.swing_c * math.sin(phase)
        if swing.daily_c:
            weather = np.random.default_rng(self._seeds(epoch)[4])
            celsius += swing.daily_c * weather.standard_normal()
        return celsius

    def _warmed(self, change: float, epoch: int) -> float:
        """Change of stiffness including the effect of temperature."""
        celsius = self.temperature_at(epoch)
        if celsius is None or self.temperature is None:
            return change
        return (1 + change) * (1 + self.temperature.softening(celsius)) - 1

    def _seeds(self, epoch: int) -> list[np.random.SeedSequence]:
        return np.random.SeedSequence(self.seed, spawn_key=(epoch,)).spawn(5)

    def _add_spikes(self, signal: Record, rng: np.random.Generator) -> Record:
        size = self.sensor.spike_size * self.acceleration_rms
        spiked = signal.copy()
        for channel in spiked.T:
            count = rng.poisson(self.sensor.spikes_per_epoch)
            where = rng.integers(0, self.samples, count)
            channel[where] += (
                size * rng.choice((-1.0, 1.0), count) * rng.uniform(0.5, 1.5, count)
            )
        return spiked

    def _present(self, rng: np.random.Generator) -> Bool[np.ndarray, " time"]:
        """Which samples arrive; the first always does, so that an epoch is never empty."""
        present = np.ones(self.samples, dtype=bool)
        length = max(1, round(self.sensor.dropout_s * self.rate_hz))
        for start in rng.integers(1, self.samples, rng.poisson(self.sensor.dropouts_per_epoch)):
            present[start : start + length] = False
        return present

    def _blocks_of(
        self, epoch: int, signal: Record, present: Bool[np.ndarray, " time"]
    ) -> Iterator[Block]:
        edges = np.flatnonzero(np.diff(present.astype(np.int8), prepend=0, append=0))
        longest = self.samples if self.block_s is None else round(self.block_s * self.rate_hz)
        slow_time = epoch * self.slow_time_step
        celsius = self.temperature_at(epoch)
        covariates = {} if celsius is None else {"temperature_c": celsius}
        renewals = self.renewals(epoch)
        covariates |= {} if renewals is None else {RENEWALS: float(renewals)}
        truth = self.truth(epoch)
        for first, last in edges.reshape(-1, 2).tolist():
            for start in range(first, last, max(longest, 1)):
                begins_s = epoch * self.interval_s + start / self.rate_hz
                yield Block(
                    samples=signal[start : min(start + longest, last)],
                    rate_hz=self.rate_hz,
                    first_index=epoch * self.samples + start,
                    start_ns=self.start_ns + round(begins_s * 1e9),
                    channels=self.channels,
                    units=self.units,
                    epoch=epoch,
                    slow_time=slow_time,
                    covariates=covariates,
                    truth=truth,
                )
