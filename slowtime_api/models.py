"""Models of structures: from a file or from arrays, their modes, and simulation."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from slowtime.dynamics import builders
from slowtime.dynamics.description import Description, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_services.models import (
    ambient_model,
    model_text,
    read_description,
    run_model,
    write_model,
)
from slowtime_services.plugins.effect_kinds import known

from .arguments import existing_file, finite, pair, positive, real_samples, whole
from .signals import Signals

HOLDS = ("first", "zero", "band_limited")
"""How inputs go on between samples, as `simulate` takes it."""


class Model:
    """A structure with its sensors, inputs and effects.

    Parameters
    ----------
    description
        Description, as `slowtime.dynamics` takes it. `from_file`, `chain`, `shear_frame` and
        `beam` make one.

    Examples
    --------
    >>> model = Model.chain([1.0, 1.0], [400.0, 400.0])
    >>> model.natural_frequencies_hz.round(3)
    array([1.967, 5.15 ])
    """

    def __init__(self, description: Description) -> None:
        self.description = description

    @classmethod
    def from_file(cls, path: str | Path) -> "Model":
        """Read a model file (YAML).

        Parameters
        ----------
        path
            The file.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If the file contradicts itself; the message names line and key.
        """
        return cls(read_description(existing_file(path), known(())))

    @classmethod
    def chain(
        cls,
        masses_kg: Sequence[float],
        stiffnesses_n_per_m: Sequence[float],
        *,
        dampings_n_s_per_m: Sequence[float] | None = None,
        rayleigh: tuple[float, float] = (0.0, 0.0),
    ) -> "Model":
        """Make masses in a row, the first tied to the base.

        Parameters
        ----------
        masses_kg
            Masses from the base outwards [kg].
        stiffnesses_n_per_m
            One spring for each mass, towards the base; one more ties the last mass to the
            base [N/m].
        dampings_n_s_per_m
            Damper beside each spring [N s/m].
        rayleigh
            Coefficients of mass [1/s] and stiffness [s] of a proportional damping.

        Returns
        -------
        Model with an accelerometer on each mass.
        """
        masses = finite(masses_kg, "masses_kg", "masses [kg]")
        springs = finite(stiffnesses_n_per_m, "stiffnesses_n_per_m", "stiffnesses [N/m]")
        dampers = dampings_n_s_per_m
        if dampers is not None:
            dampers = finite(dampers, "dampings_n_s_per_m", "dampings [N s/m]")
        return cls(
            builders.chain(
                masses, springs, dampings_n_s_per_m=dampers, rayleigh=_rayleigh(rayleigh)
            )
        )

    @classmethod
    def shear_frame(
        cls,
        floors_kg: Sequence[float],
        storeys_n_per_m: Sequence[float],
        *,
        rayleigh: tuple[float, float] = (0.0, 0.0),
    ) -> "Model":
        """Stack rigid floors on storeys.

        Parameters
        ----------
        floors_kg
            Mass of each floor, from below [kg].
        storeys_n_per_m
            Stiffness of each storey against sway [N/m].
        rayleigh
            Coefficients of mass [1/s] and stiffness [s] of a proportional damping.

        Returns
        -------
        Model with an accelerometer on each floor.
        """
        floors = finite(floors_kg, "floors_kg", "masses [kg]")
        storeys = finite(storeys_n_per_m, "storeys_n_per_m", "stiffnesses [N/m]")
        return cls(builders.shear_frame(floors, storeys, rayleigh=_rayleigh(rayleigh)))

    @classmethod
    def beam(
        cls,
        length_m: float,
        bending_stiffness_n_m2: float,
        mass_kg_per_m: float,
        *,
        elements: int = 10,
        supports: str = "cantilever",
    ) -> "Model":
        """Cut a uniform Euler-Bernoulli beam into equal elements.

        Parameters
        ----------
        length_m
            Length [m].
        bending_stiffness_n_m2
            Bending stiffness EI [N m^2].
        mass_kg_per_m
            Mass per length [kg/m].
        elements
            Number of elements.
        supports
            ``"cantilever"``, ``"simply supported"``, ``"clamped"``, ``"propped"`` or
            ``"free"``.

        Returns
        -------
        The model.
        """
        length = positive(length_m, "length_m", "m")
        bending = positive(bending_stiffness_n_m2, "bending_stiffness_n_m2", "EI [N m^2]")
        mass = positive(mass_kg_per_m, "mass_kg_per_m", "kg/m")
        count = whole(elements, "elements", 2)
        return cls(builders.beam(length, bending, mass, elements=count, supports=supports))

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.description.name

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of its sensors."""
        return tuple(sensor.channel for sensor in self.description.sensors)

    @property
    def natural_frequencies_hz(self) -> Float[np.ndarray, " mode"]:
        """Undamped natural frequencies of the linear structure, ascending [Hz]."""
        return undamped_modes(assemble(self.description)).frequency_hz

    def matrices(self) -> tuple[Float[np.ndarray, "dof dof"], ...]:
        """Return the matrices of the linear structure.

        Returns
        -------
        Mass [kg], damping [N s/m] and stiffness [N/m], each [dof, dof].
        """
        structure = assemble(self.description)
        return structure.mass, structure.damping, structure.stiffness

    def save(self, path: str | Path) -> None:
        """Write a model file (YAML).

        Parameters
        ----------
        path
            File to write.
        """
        write_model(Path(path), self.description)

    def __repr__(self) -> str:
        described = self.description
        return (
            f"Model {described.name!r}: {len(described.nodes)} nodes, "
            f"{len(described.elements)} elements, {len(described.sensors)} sensors, "
            f"{len(described.inputs)} inputs, {len(described.effects)} effects"
        )

    def text(self) -> str:
        """Return the model file as text.

        Returns
        -------
        YAML, as `save` writes it.
        """
        return model_text(self.description)


def _rayleigh(rayleigh: Sequence[float]) -> tuple[float, float]:
    name, meaning = "rayleigh", "coefficients of mass [1/s] and stiffness [s]"
    of_mass, of_stiffness = finite(pair(rayleigh, name, meaning), name, meaning)
    return of_mass, of_stiffness


def simulate(
    model: Model,
    inputs: Signals | Mapping[str, Any] | None = None,
    *,
    rate_hz: float | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    hold: str = "first",
    noise: bool = False,
) -> Signals:
    """Simulate what the sensors of a model measure.

    Parameters
    ----------
    model
        Model, its effects included.
    inputs
        Measured inputs by channel, in the units of the model. None for a model without inputs:
        it decays from its initial state or, if it has none, vibrates under white ambient
        forces.
    rate_hz
        Sampling rate [Hz]; that of `inputs` where they are signals.
    duration_s
        Duration [s], without inputs.
    seed
        Of all random numbers; needed for ambient forces and noise.
    hold
        Inputs between samples: ``"first"`` (linear), ``"zero"`` (constant) or
        ``"band_limited"``.
    noise
        Whether to add the noise that the model states for its sensors.

    Returns
    -------
    Outputs of the sensors, in their units.

    Raises
    ------
    ValueError
        If an input, the rate, the duration or the seed is missing or not possible.
    TypeError
        If the model is no `Model`, or the inputs are no series by channel.

    Examples
    --------
    >>> model = Model.chain([1.0], [400.0], dampings_n_s_per_m=[0.4])
    >>> simulate(model, rate_hz=50.0, duration_s=10.0, seed=1)
    Signals: 1 channel (a_m1), 500 samples at 50 Hz (10 s)
    """
    description, kinds = checked_model(model, "simulate").description, known(())
    if hold not in HOLDS:
        raise ValueError(f"hold={hold!r} was given. Allowed: {', '.join(HOLDS)}.")
    seed = None if seed is None else whole(seed, "seed", 0)
    if noise and seed is None:
        raise ValueError("Noise is random. Give a seed, so that it can be made again.")
    if isinstance(inputs, Signals) and rate_hz is None:
        rate_hz = inputs.rate_hz
    if rate_hz is None:
        raise ValueError("The sampling rate is not known. Give rate_hz.")
    rate_hz = positive(rate_hz, "rate_hz", "samples per second")
    given = _series(inputs, [entry.channel for entry in description.inputs])
    rng = None if seed is None else np.random.default_rng([seed, 2])
    if description.inputs:
        if not given:
            names = ", ".join(entry.channel for entry in description.inputs)
            raise ValueError(f"The model has inputs: {names}. Give them as `inputs`.")
        found = run_model(description, given, rate_hz, hold=hold, kinds=kinds, rng=rng)
    else:
        if duration_s is None:
            raise ValueError("The model has no inputs. Give duration_s, in seconds.")
        samples = round(positive(duration_s, "duration_s", "seconds") * rate_hz)
        if samples < 2:
            raise ValueError(
                f"duration_s={duration_s:g} at {rate_hz:g} Hz is {samples} sample(s). Give at "
                f"least {2 / rate_hz:g} s."
            )
        if description.initial:
            found = run_model(description, {}, rate_hz, kinds=kinds, rng=rng, samples=samples)
        elif seed is None:
            raise ValueError("Ambient forces are random. Give a seed.")
        else:
            found = ambient_model(description, samples, rate_hz, seed, kinds=kinds)
    columns = np.stack([found[channel] for channel in model.channels], axis=1)
    if noise:
        sd = np.array([sensor.noise_sd or 0.0 for sensor in description.sensors])
        white = np.random.default_rng([0 if seed is None else seed, 1])
        columns = columns + sd * white.standard_normal(columns.shape)
    units = [sensor.unit for sensor in description.sensors]
    return Signals(columns, rate_hz, channels=model.channels, units=units)


def checked_model(model: Any, function: str) -> Model:
    """Return a model as it is, or say how to make one.

    Raises
    ------
    TypeError
        If it is something else.
    """
    if not isinstance(model, Model):
        raise TypeError(
            f"slowtime.{function} takes a Model; {type(model).__name__} was given. Make one "
            "with Model.from_file(path), Model.chain(...), .shear_frame(...) or .beam(...)."
        )
    return model


def _series(inputs: Any, channels: Sequence[str]) -> dict[str, np.ndarray[Any, Any]]:
    """Return the inputs of a model by channel, all of one length."""
    if inputs is None:
        return {}
    if isinstance(inputs, Signals):
        given = {name: inputs.samples[:, i] for i, name in enumerate(inputs.channels)}
    elif hasattr(inputs, "items") and np.ndim(inputs) != 1:
        given = {str(name): real_samples(values) for name, values in inputs.items()}
    else:
        raise TypeError(
            f"inputs of type {type(inputs).__name__} were given. Give Signals, or series by "
            f"channel, such as inputs={{{(channels or ['force'])[0]!r}: values}}."
        )
    if given and not channels:
        raise ValueError(
            f"The model has no inputs; {', '.join(given)} was given. List the inputs in the "
            "model, or leave them out here."
        )
    used = {name: given[name] for name in channels if name in given}
    for name, values in used.items():
        if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
            raise ValueError(
                f"Input {name!r} has shape {values.shape} and "
                f"{int((~np.isfinite(values)).sum())} values that are not finite. Give a "
                "series of at least two finite numbers."
            )
    if len({len(values) for values in used.values()}) > 1:
        lengths = ", ".join(f"{name}: {len(values)}" for name, values in used.items())
        raise ValueError(f"The inputs differ in length ({lengths}). Give series of one length.")
    return given
