"""Models of structures: from a file or from arrays, their modes, and simulation."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float

from slowtime.dynamics import builders
from slowtime.dynamics.description import BASE, Description, Input, Sensor, assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_services.argument_checks import (
    Bounds,
    Matrix,
    Positive,
    checked,
)
from slowtime_services.matrices import read_any_description
from slowtime_services.models import (
    ambient_model,
    model_text,
    run_model,
    write_model,
)
from slowtime_services.plugins.effect_kinds import known

from .arguments import existing_file, real_samples
from .results import html_table
from .signals import Signals

Hold = Literal["first", "zero", "band_limited"]
"""How inputs go on between samples, as `simulate` takes it."""
Supports = Literal["cantilever", "simply supported", "clamped", "propped", "free"]
"""How the ends of a beam are held."""
SAMPLES_PER_PERIOD = 4.0
"""Samples per period of the fastest mode [1] of an ambient simulation, where no rate is given:
twice as many as the sampling theorem asks for."""
PERIODS = 1000.0
"""Periods of the slowest mode [1] of an ambient simulation, where no duration is given: the
random error of a damping ratio of 1 % is then about 13 % (as the inverse square root of
2 pi zeta periods)."""
MOST_SAMPLES = 2_000_000
"""Samples of an ambient simulation [1] beyond which rate and duration are asked for."""


Masses = Annotated[Sequence[float], Bounds(above=0)]


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

    MADE_BY = (
        "slowtime.Model.from_file(path), .chain(...), .shear_frame(...), .beam(...) or "
        ".from_matrices(...)"
    )
    """What makes one, for messages."""

    @checked
    def __init__(self, description: Description) -> None:
        self.description = description

    @classmethod
    @checked
    def from_file(cls, path: str | Path) -> "Model":
        """Read a model file (YAML or JSON).

        Parameters
        ----------
        path
            The file. One of finite elements is reduced to the modes in the band of its
            sensors; `slowtime.FiniteElementModel.from_file` keeps it whole.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If the file contradicts itself; the message names line and key.
        """
        return cls(read_any_description(existing_file(path), known(())))

    @classmethod
    @checked
    def chain(
        cls,
        masses_kg: Masses,
        stiffnesses_n_per_m: Sequence[float],
        *,
        dampings_n_s_per_m: Sequence[float] | None = None,
        rayleigh: tuple[float, float] = (0.0, 0.0),
        inputs: Sequence[Input | str] = (),
        sensors: Sequence[Sensor | str] | None = None,
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
        inputs
            `slowtime.Input`, or the name of a mass (``"m1"``, ...)
            with a measured force, channel ``f_`` and the name [N]; ``"base"`` for a measured
            acceleration of the base, channel ``a_base`` [m/s^2]. Without inputs the model is
            under ambient forces.
        sensors
            `slowtime.Sensor`, or the name of a mass (``"m1"``, ...)
            with an accelerometer, channel ``a_`` and the name [m/s^2]; on every mass where
            not given.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If a mass is not above 0, numbers of springs and masses differ, or a name is not
            one of the model.

        Examples
        --------
        >>> model = Model.chain([1.0, 1.0], [400.0, 400.0], inputs=["m2"], sensors=["m1"])
        >>> [one.channel for one in model.description.inputs], model.channels
        (['f_m2'], ('a_m1',))
        """
        described = builders.chain(
            masses_kg, stiffnesses_n_per_m, dampings_n_s_per_m=dampings_n_s_per_m,
            rayleigh=rayleigh,
        )  # fmt: skip
        return cls(_with_channels(described, inputs, sensors))

    @classmethod
    @checked
    def shear_frame(
        cls,
        floors_kg: Masses,
        storeys_n_per_m: Masses,
        *,
        rayleigh: tuple[float, float] = (0.0, 0.0),
        inputs: Sequence[Input | str] = (),
        sensors: Sequence[Sensor | str] | None = None,
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
        inputs
            `slowtime.Input`, or the name of a floor (``"floor1"``, ...)
            with a measured force, channel ``f_`` and the name [N]; ``"base"`` for a measured
            acceleration of the base, channel ``a_base`` [m/s^2]. Without inputs the model is
            under ambient forces.
        sensors
            `slowtime.Sensor`, or the name of a floor (``"floor1"``, ...)
            with an accelerometer, channel ``a_`` and the name [m/s^2]; on every floor where
            not given.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If a mass or stiffness is not above 0, numbers of floors and storeys differ, or a
            name is not one of the model.

        Examples
        --------
        >>> frame = Model.shear_frame([900.0, 800.0], [1.2e6, 1e6], inputs=["base"])
        >>> frame.description.inputs[0].kind
        'base_acceleration'
        """
        described = builders.shear_frame(floors_kg, storeys_n_per_m, rayleigh=rayleigh)
        return cls(_with_channels(described, inputs, sensors))

    @classmethod
    @checked
    def from_matrices(
        cls,
        mass_kg: Matrix,
        stiffness_n_per_m: Matrix,
        damping_n_s_per_m: Matrix | None = None,
        *,
        coordinates: Sequence[str] | None = None,
        inputs: Sequence[Input | str] = (),
        sensors: Sequence[Sensor | str] | None = None,
    ) -> "Model":
        """Make a model of symmetric mass, stiffness and damping matrices.

        Parameters
        ----------
        mass_kg, stiffness_n_per_m, damping_n_s_per_m
            Matrices [dof, dof], dense or sparse [kg], [N/m], [N s/m]; undamped where no damping
            is given.
        coordinates
            Name of each degree of freedom, a displacement relative to the base; ``"x1"``,
            ``"x2"``, ... where not given.
        inputs
            `slowtime.Input`, or the name of a coordinate
            with a measured force, channel ``f_`` and the name [N]; ``"base"`` for a measured
            acceleration of the base, channel ``a_base`` [m/s^2]. Without inputs the model is
            under ambient forces.
        sensors
            `slowtime.Sensor`, or the name of a coordinate
            with an accelerometer, channel ``a_`` and the name [m/s^2]; on all where not given.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If shapes differ, a matrix is not symmetric, or the mass is not positive definite.

        Examples
        --------
        >>> model = Model.from_matrices([[2.0, 0.0], [0.0, 2.0]], [[500, -300], [-300, 300]])
        >>> model.natural_frequencies_hz.round(3)
        array([1.03 , 3.012])
        """
        described = builders.of_matrices(
            mass_kg, stiffness_n_per_m, damping_n_s_per_m, coordinates=coordinates
        )
        return cls(_with_channels(described, inputs, sensors))

    @classmethod
    @checked
    def beam(
        cls,
        length_m: Positive,
        bending_stiffness_n_m2: Positive,
        mass_kg_per_m: Positive,
        *,
        elements: Annotated[int, Bounds(least=2)] = 10,
        supports: Supports = "cantilever",
        inputs: Sequence[Input | str] = (),
        sensors: Sequence[Sensor | str] | None = None,
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
        inputs
            `slowtime.Input`, or the name of a node (``"n1"``, ...)
            with a measured force, channel ``f_`` and the name [N]; ``"base"`` for a measured
            acceleration of the base, channel ``a_base`` [m/s^2]. Without inputs the model is
            under ambient forces.
        sensors
            `slowtime.Sensor`, or the name of a node (``"n1"``, ...)
            with an accelerometer, channel ``a_`` and the name [m/s^2]; on every free node where
            not given.

        Returns
        -------
        The model.

        Examples
        --------
        >>> round(float(Model.beam(2.0, 500.0, 3.0).natural_frequencies_hz[0]), 3)
        1.806
        """
        described = builders.beam(
            length_m, bending_stiffness_n_m2, mass_kg_per_m, elements=elements,
            supports=supports,
        )  # fmt: skip
        return cls(_with_channels(described, inputs, sensors))

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

    @checked
    def save(self, path: str | Path) -> None:
        """Write a model file (YAML).

        Parameters
        ----------
        path
            File to write.
        """
        write_model(Path(path), self.description)

    @checked
    def to_fmu(self, path: str | Path, *, step_s: Positive = 0.001) -> tuple[str, ...]:
        """Write the model as a unit of co-simulation (FMI 2.0) for other programs.

        Parameters
        ----------
        path
            File to write (.fmu).
        step_s
            Communication step that the unit proposes [s].

        Returns
        -------
        Names of the inputs, outputs and parameters of the unit.

        Raises
        ------
        ImportError
            If pythonfmu is not installed.
        ValueError
            If the model cannot be simulated step by step; the message says why.
        """
        from slowtime_services.functional_mockup import write_fmu

        found = write_fmu(self.description, Path(path), step_s=step_s)
        every = (*found.inputs, *found.outputs, *found.parameters)
        return tuple(one.name for one in every)

    def __eq__(self, other: object) -> bool:
        """Whether the descriptions are the same, the names included."""
        return (
            self.description == other.description
            if isinstance(other, Model)
            else NotImplemented
        )

    __hash__ = None  # type: ignore[assignment]

    def _repr_html_(self) -> str:
        rows = [
            {"mode": k + 1, "frequency [Hz]": float(hz)}
            for k, hz in enumerate(self.natural_frequencies_hz)
        ]
        return html_table(repr(self), rows)

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


def _with_channels(
    described: Description,
    inputs: Sequence[Input | str],
    sensors: Sequence[Sensor | str] | None,
) -> Description:
    """Put inputs and sensors on a structure; names of nodes stand for the usual ones."""
    given = tuple(_input(one) if isinstance(one, str) else one for one in inputs)
    seen = described.sensors
    if sensors is not None:
        seen = tuple(
            builders.accelerometer(one) if isinstance(one, str) else one for one in sensors
        )
    return dataclasses.replace(described, inputs=given, sensors=seen)


def _input(node: str) -> Input:
    """Return a measured force on a node, or the measured acceleration of the base."""
    if node == BASE:
        return Input(channel="a_base", kind="base_acceleration", unit="m/s^2")
    return Input(channel=f"f_{node}", kind="force", unit="N", node=node)


@checked
def simulate(
    model: Model,
    inputs: Signals | Mapping[str, Any] | None = None,
    *,
    rate_hz: Positive | None = None,
    duration_s: Positive | None = None,
    seed: int = 0,
    hold: Hold = "first",
    noise: bool = False,
    force_psd: Positive = 1.0,
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
        Sampling rate [Hz]; that of `inputs` where they are signals. Without inputs, four
        samples per period of the fastest mode where not given.
    duration_s
        Duration [s], without inputs; a thousand periods of the slowest mode where not given.
    seed
        Of all random numbers, those of ambient forces and noise.
    hold
        Inputs between samples: ``"first"`` (linear), ``"zero"`` (constant) or
        ``"band_limited"``.
    noise
        Whether to add the noise that the model states for its sensors.
    force_psd
        One-sided density of the ambient force on each node [N^2/Hz].

    Returns
    -------
    Outputs of the sensors, in their units.

    Raises
    ------
    ValueError
        If an input or the rate is missing, or a number is not possible.
    TypeError
        If the model is no `Model`, or the inputs are no series by channel.

    Examples
    --------
    >>> model = Model.chain([1.0], [400.0], dampings_n_s_per_m=[0.4])
    >>> simulate(model, rate_hz=50.0, duration_s=10.0)
    Signals: 1 channel (a_m1), 500 samples at 50 Hz (10 s)
    """
    description, kinds = model.description, known(())
    given = _series(inputs, [entry.channel for entry in description.inputs])
    rng = np.random.default_rng([seed, 2])
    if description.inputs:
        if not given:
            names = ", ".join(entry.channel for entry in description.inputs)
            raise ValueError(f"The model has inputs: {names}. Give them as `inputs`.")
        rate_hz = inputs.rate_hz if isinstance(inputs, Signals) and rate_hz is None else rate_hz
        if rate_hz is None:
            raise ValueError("The sampling rate of the inputs is not known. Give rate_hz.")
        found = run_model(description, given, rate_hz, hold=hold, kinds=kinds, rng=rng)
    else:
        rate_hz, samples = _sampling(model, rate_hz, duration_s)
        if description.initial:
            found = run_model(description, {}, rate_hz, kinds=kinds, rng=rng, samples=samples)
        else:
            found = ambient_model(
                description, samples, rate_hz, seed, force_psd=force_psd, kinds=kinds
            )
    columns = np.stack([found[channel] for channel in model.channels], axis=1)
    if noise:
        sd = np.array([sensor.noise_sd or 0.0 for sensor in description.sensors])
        white = np.random.default_rng([seed, 1])
        columns = columns + sd * white.standard_normal(columns.shape)
    units = [sensor.unit for sensor in description.sensors]
    return Signals(columns, rate_hz, channels=model.channels, units=units)


def _sampling(
    model: Model, rate_hz: float | None, duration_s: float | None
) -> tuple[float, int]:
    """Return rate [Hz] and number of samples of a simulation without inputs."""
    hz = model.natural_frequencies_hz
    moving = hz[hz > 0.0]
    if (rate_hz is None or duration_s is None) and not len(moving):
        raise ValueError("The model has no elastic mode. Give rate_hz and duration_s.")
    rate = SAMPLES_PER_PERIOD * float(moving[-1]) if rate_hz is None else rate_hz
    seconds = PERIODS / float(moving[0]) if duration_s is None else duration_s
    samples = round(seconds * rate)
    if samples < 2:
        raise ValueError(
            f"duration_s={seconds:g} at {rate:g} Hz is {samples} sample(s). Give at least "
            f"{2 / rate:g} s."
        )
    if samples > MOST_SAMPLES and (rate_hz is None or duration_s is None):
        raise ValueError(
            f"The modes lie from {moving[0]:.3g} to {moving[-1]:.3g} Hz: {seconds:.3g} s at "
            f"{rate:.3g} Hz are {samples} samples. Give rate_hz and duration_s."
        )
    return rate, samples


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
