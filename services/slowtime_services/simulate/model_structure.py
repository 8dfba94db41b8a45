"""A simulated structure of a model file under measured forces.

What it lacks is known to the simulator alone: the edge sees samples, the twin a model file.
Effects and model files are imported where they are needed, since laws of force want a compiler
that a small edge, which may well simulate a tower, does not have.
"""

import dataclasses
import functools
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from slowtime.dynamics.description import Description, DescriptionError, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_schemas.files.model import ModelFile

from .field_types import NotNegative, Positive
from .measurement import EvolvingStructure, Record


class SimulatedModel(EvolvingStructure):
    """A structure of a model file under its measured inputs, each epoch from rest.

    Inputs are Gaussian, white within `band_hz`, and are sent beside the sensors' channels, free
    of noise; a sensor's noise is `sensor.noise` times what it would show on average without
    the effects.

    Parameters
    ----------
    model
        The structure as it is, before the effects.
    effects
        Entries as a model file has them, that nobody is told of.
    enters
        Epoch from which on they are there.
    leaves
        Epoch from which on they are gone; None for never.
    input_rms
        Of each input, in its unit.
    band_hz
        Of the inputs; None for up to a fifth of the sampling rate.
    """

    kind: Literal["model"] = "model"
    model: ModelFile
    effects: tuple[dict[str, Any], ...] = ()
    enters: Annotated[int, Field(ge=0)] = 0
    leaves: Annotated[int, Field(ge=0)] | None = None
    input_rms: Positive = 1.0
    band_hz: tuple[NotNegative, Positive] | None = None

    @model_validator(mode="after")
    def _can_be_run(self) -> "SimulatedModel":
        if not self.model.inputs or not self.model.sensors:
            raise ValueError(
                "The model has no inputs, or no sensors. List what shakes it under `inputs`, "
                "and what listens under `sensors`."
            )
        from slowtime.dynamics.effects import read_effects

        try:
            read_effects(self._described(1.0))
        except DescriptionError as error:
            raise ValueError(f"{error} Correct `effects`.") from error
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Sensors first, then inputs."""
        sensors, inputs = self.model.sensors, self.model.inputs
        return (*(one.channel for one in sensors), *(one.channel for one in inputs))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the channels, by the model file."""
        sensors, inputs = self.model.sensors, self.model.inputs
        return (*(one.unit for one in sensors), *(one.unit for one in inputs))

    def truth(self, epoch: int) -> dict[str, float]:
        """Return that each element's stiffness is as built, and whether effects are present."""
        known = {f"element.{element.id}": 0.0 for element in self.model.elements}
        return known | {"effects": float(self._entered(epoch))}

    def _entered(self, epoch: int) -> bool:
        return self.enters <= epoch and (self.leaves is None or epoch < self.leaves)

    def _described(self, entered: float) -> Description:
        from slowtime_services.models import description_of

        built = description_of(self.model)
        if not entered:
            return built
        return dataclasses.replace(built, effects=(*built.effects, *self.effects))

    def _highest_hz(self) -> float:
        from slowtime_services.models import description_of

        modes = undamped_modes(assemble(description_of(self.model)))
        return float(modes.frequency_hz[-1])

    @functools.cached_property
    def _noise_sd(self) -> Float[np.ndarray, " channel"]:
        """Standard deviation of each channel's noise; inputs have none."""
        quiet = self._run(self._described(0.0), np.random.default_rng(self.seed))
        heard = quiet.std(axis=0) * self.sensor.noise
        heard[len(self.model.sensors) :] = 0.0
        return np.asarray(heard)

    def _response(self, epoch: int, rng: np.random.Generator) -> Record:
        return self._run(self._described(float(self._entered(epoch))), rng)

    def _run(self, description: Description, rng: np.random.Generator) -> Record:
        from slowtime_services.models import run_model

        inputs = {entry.channel: self._shake(rng) for entry in self.model.inputs}
        found = run_model(description, inputs, self.rate_hz, hold="band_limited", rng=rng)
        return np.stack([(found | inputs)[channel] for channel in self.channels], axis=1)

    def _shake(self, rng: np.random.Generator) -> Float[np.ndarray, " time"]:
        low, high = self.band_hz or (0.0, 0.2 * self.rate_hz)
        lines = np.fft.rfft(rng.standard_normal(self.samples))
        frequency = np.fft.rfftfreq(self.samples, 1.0 / self.rate_hz)
        lines[(frequency < low) | (frequency > high) | (frequency == 0.0)] = 0.0
        white = np.fft.irfft(lines, self.samples)
        return np.asarray(self.input_rms * white / white.std())
