"""A simulated structure of a model file under measured forces.

What it lacks is known to the simulator alone: the edge sees samples, the twin a model file.
Effects and model files are imported where they are needed, since laws of force want a compiler
that a small edge, which may well simulate a tower, does not have.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from slowtime.dynamics.description import Description, DescriptionError, Spring, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_schemas.files.model import ModelFile

from .evolutions import Evolution, Unchanged, renewals
from .field_types import NotNegative, Positive
from .measurement import LASTING, EvolvingStructure, Record


class SimulatedModel(EvolvingStructure):
    """A structure of a model file under its measured inputs, each epoch from rest.

    Inputs are Gaussian, white within `band_hz`, and are sent beside the sensors' channels, free
    of noise; a sensor's noise is `sensor.noise` times what it would show on average without
    the effects. A temperature acts on the stiffness of all elements alike.

    Parameters
    ----------
    model
        The structure as it is, before the effects.
    stiffness
        Element → relative change in slow time; the others stay.
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
    stiffness: dict[str, Evolution] = Field(default_factory=dict)
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
        elements = [element.id for element in self.model.elements]
        if strange := ", ".join(sorted(self.stiffness.keys() - set(elements))):
            raise ValueError(
                f"{strange} in `stiffness` is no element of the model. Name one of: "
                f"{', '.join(elements)}."
            )
        from slowtime.dynamics.effects import read_effects

        try:
            read_effects(self._described(0, entered=True))
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
        """Return the true changes of the elements, and whether effects are present.

        ``element.storey1`` …; with a temperature also ``lasting.element.storey1`` …, without
        what that does.
        """
        lasting = self._lasting(epoch)
        known = {
            f"element.{name}": self._warmed(change, epoch) for name, change in lasting.items()
        }
        if self.temperature is not None:
            known |= {f"{LASTING}element.{name}": change for name, change in lasting.items()}
        return known | {"effects": float(self._entered(epoch))}

    def renewals(self, epoch: int) -> int | None:
        """Return the number of renewals of elements before an epoch."""
        return renewals(self.stiffness.values(), epoch * self.slow_time_step)

    def _lasting(self, epoch: int) -> dict[str, float]:
        """Relative change of every element's stiffness, without what the temperature does."""
        slow_time = epoch * self.slow_time_step
        return {
            element.id: self.stiffness.get(element.id, Unchanged()).at(slow_time)
            for element in self.model.elements
        }

    def _entered(self, epoch: int) -> bool:
        return self.enters <= epoch and (self.leaves is None or epoch < self.leaves)

    def _described(self, epoch: int, *, entered: bool) -> Description:
        from slowtime_services.models import description_of

        built = description_of(self.model)
        if self.stiffness or self.temperature is not None:
            changes = {
                name: self._warmed(lasting, epoch)
                for name, lasting in self._lasting(epoch).items()
            }
            built = _softened(built, changes)
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
        quiet = self._run(self._described(0, entered=False), np.random.default_rng(self.seed))
        heard = quiet.std(axis=0) * self.sensor.noise
        heard[len(self.model.sensors) :] = 0.0
        return np.asarray(heard)

    def _response(self, epoch: int, rng: np.random.Generator) -> Record:
        return self._run(self._described(epoch, entered=self._entered(epoch)), rng)

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


def _softened(built: Description, changes: Mapping[str, float]) -> Description:
    """Return a description whose elements' stiffnesses have changed, each by its own share."""
    elements = []
    for element in built.elements:
        field = "stiffness_n_per_m" if isinstance(element, Spring) else "bending_stiffness_n_m2"
        stiffness = (1.0 + changes[element.id]) * getattr(element, field)
        elements.append(dataclasses.replace(element, **{field: stiffness}))
    return dataclasses.replace(built, elements=tuple(elements))
