"""The plant: a description that is simulated at any values of its parameters."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, Law, Motion, Place, catalogue, read_effects

from .matrices import MatrixParts
from .parameter_names import Name, ParameterEntry, names_of
from .simulation_run import PlantRun, motions, run
from .spectral_slopes import has_spectral_slopes, spectral_slopes
from .system import Layout, layout_of

Values = Float[np.ndarray, " parameter"]
Inputs = Float[np.ndarray, "time input"]
Outputs = Float[np.ndarray, "time sensor"]
State = Float[np.ndarray, " state"]


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Plant:
    """A description with its effects, ready to run.

    Make one with `Plant.of`. Inputs and outputs are in the units of the description's channels,
    in its order.
    """

    description: Description
    effects: tuple[Effect, ...]
    kinds: Mapping[str, Kind]
    entries: Mapping[Name, ParameterEntry]
    matrices: MatrixParts
    layout: Layout
    hold: str = "band_limited"

    @classmethod
    def of(
        cls,
        description: Description,
        *,
        kinds: Mapping[str, Kind] | None = None,
        hold: str = "band_limited",
    ) -> "Plant":
        """Make a plant of a description.

        Parameters
        ----------
        description
            Structure with its effects, inputs and sensors.
        kinds
            Those known, by name; the catalogue where not given.
        hold
            What inputs do between samples of which the description does not say it, see
            `signals.interpolation.polynomials`.

        Returns
        -------
        The plant.
        """
        known = catalogue() if kinds is None else kinds
        effects = read_effects(description, known)
        matrices = MatrixParts.of(description, effects, known)
        own = [known[effect.kind] for effect in effects]
        return cls(
            description=description,
            effects=effects,
            kinds=known,
            entries=names_of(description, effects, known),
            matrices=matrices,
            layout=layout_of(description, effects, own, matrices.names),
            hold=hold,
        )

    @property
    def parameters(self) -> tuple[Name, ...]:
        """Names of all numbers, in the order of `values`."""
        return tuple(self.entries)

    @property
    def values(self) -> Values:
        """As the description has them."""
        return np.array([entry.value for entry in self.entries.values()])

    @property
    def units(self) -> tuple[str, ...]:
        """Of the values."""
        return tuple(entry.unit for entry in self.entries.values())

    @property
    def prior_sd(self) -> Values:
        """Standard deviation of what is claimed: 0 where exact, infinite where nothing is."""
        return np.array([entry.sd for entry in self.entries.values()])

    @property
    def state_names(self) -> tuple[tuple[str, str], ...]:
        """Names of the numbers of a state: displacements, velocities, what laws remember."""
        names = self.matrices.names
        inner = tuple(
            ("internal", f"{effect.kind} {i}.{k + 1}")
            for i, effect in enumerate(self.effects)
            if isinstance(action := self.kinds[effect.kind].action, Law)
            for k in range(len(action.rates))
        )
        moved = tuple(("displacement", name) for name in names)
        return (*moved, *(("velocity", name) for name in names), *inner)

    def simulate(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        *,
        state0: State | None = None,
        start_s: float = 0.0,
        base: Float[np.ndarray, " time"] | None = None,
    ) -> Outputs:
        """Simulate the outputs of the sensors.

        Parameters
        ----------
        values
            Of all parameters, in their order.
        inputs
            One column for each input of the description, in its unit.
        rate_hz
            Samples per second.
        state0
            State at the first sample, in the order of `state_names`; where not given, rest
            against the base, carried along by supports.
        start_s
            Campaign time of the first sample [s].
        base
            Acceleration of the base beyond what was measured [m/s^2].

        Returns
        -------
        One column for each sensor, in its unit; NaN from where the motion grew beyond bounds.
        """
        return self.run(
            values, inputs, rate_hz, state0=state0, start_s=start_s, base=base
        ).outputs

    def sensitivities(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        free: Sequence[Name],
        *,
        state0: State | None = None,
        start_s: float = 0.0,
        base: Float[np.ndarray, " time"] | None = None,
    ) -> tuple[Outputs, Float[np.ndarray, "time sensor slope"]]:
        """Simulate the outputs and their derivatives to free parameters and to the first state.

        The derivatives are those of the motion computed, exact but for the differences by which
        laws are differentiated: about 1e-7 of them. Those of a linear plant of many coordinates
        are computed by spectra (`spectral_slopes`).

        Parameters
        ----------
        values
            Values of all parameters, in their order.
        inputs
            One column for each input of the description, in its unit.
        rate_hz
            Sampling rate [Hz].
        free
            Names of the parameters to differentiate to.
        state0
            State at the first sample, in the order of `state_names`; where not given, rest
            against the base, carried along by supports.
        start_s
            Campaign time of the first sample [s].
        base
            Acceleration of the base beyond what was measured [m/s^2].

        Returns
        -------
        Outputs in the sensors' units, and their derivatives: first to `free`, then to `state0`.
        """
        if has_spectral_slopes(self.description, self.effects, self.kinds, self.matrices, free):
            self._check(values, inputs, rate_hz, free)
            plain = self.run(values, inputs, rate_hz, state0=state0, start_s=start_s, base=base)
            slopes = self._spectral_slopes(values, plain, rate_hz, free)
            if slopes is not None:
                return plain.outputs, slopes
        found = self.run(
            values, inputs, rate_hz, free, state0=state0, start_s=start_s, base=base
        )
        assert found.slopes is not None
        return found.outputs, found.slopes

    def _spectral_slopes(
        self, values: Values, plain: PlantRun, rate_hz: float, free: Sequence[Name]
    ) -> Float[np.ndarray, "time sensor slope"] | None:
        named = dict(zip(self.entries, values.tolist(), strict=True))
        kinds = [self.kinds[effect.kind] for effect in self.effects]
        return spectral_slopes(
            self.description, kinds, self.matrices, named, plain, rate_hz, free
        )

    def states(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        *,
        state0: State | None = None,
        start_s: float = 0.0,
        base: Float[np.ndarray, " time"] | None = None,
    ) -> dict[Place, Motion]:
        """Simulate the motion of every spring element and of every node that moves.

        Parameters
        ----------
        values
            Values of all parameters, in their order.
        inputs
            One column for each input of the description, in its unit.
        rate_hz
            Sampling rate [Hz].
        state0
            State at the first sample, in the order of `state_names`; where not given, rest
            against the base, carried along by supports.
        start_s
            Campaign time of the first sample [s].
        base
            Acceleration of the base beyond what was measured [m/s^2].

        Returns
        -------
        Place → its motion: elongations of elements; of nodes, displacement and velocity against
        the base and acceleration in space.
        """
        found = self.run(values, inputs, rate_hz, state0=state0, start_s=start_s, base=base)
        return motions(self.description, self.matrices.names, found)

    def run(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        free: Sequence[Name] | None = None,
        *,
        state0: State | None = None,
        start_s: float = 0.0,
        base: Float[np.ndarray, " time"] | None = None,
    ) -> PlantRun:
        """Simulate, and return all results of the run.

        Parameters
        ----------
        values
            Values of all parameters, in their order.
        inputs
            One column for each input of the description, in its unit.
        rate_hz
            Sampling rate [Hz].
        free
            Names of the parameters to differentiate to; None for no derivatives at all, while
            an empty sequence still gives those to the first state.
        state0
            State at the first sample, in the order of `state_names`; where not given, rest
            against the base, carried along by supports.
        start_s
            Campaign time of the first sample [s].
        base
            Acceleration of the base beyond what was measured [m/s^2].

        Returns
        -------
        Outputs, states, forces and derivatives.
        """
        self._check(values, inputs, rate_hz, free)
        named = dict(zip(self.entries, values.tolist(), strict=True))
        return run(
            self.description,
            self.effects,
            [self.kinds[effect.kind] for effect in self.effects],
            self.matrices,
            self.layout,
            named,
            inputs,
            rate_hz,
            free,
            state0=state0,
            start_s=start_s,
            base=base,
            hold=self.hold,
        )

    def _check(
        self, values: Values, inputs: Inputs, rate_hz: float, free: Sequence[Name] | None
    ) -> None:
        if len(values) != len(self.entries):
            raise ValueError(
                f"{len(values)} values were given for {len(self.entries)} parameters. Give "
                "one for each of `parameters`."
            )
        if not 0 < rate_hz < math.inf:
            raise ValueError(
                f"{rate_hz=} is not a valid sampling rate. Give samples per second, above 0."
            )
        if inputs.shape[1] != len(self.description.inputs):
            raise ValueError(
                f"{inputs.shape[1]} columns were given for {len(self.description.inputs)} "
                "inputs. Give one for each input of the description."
            )
        if not np.isfinite(inputs).all():
            raise ValueError("The inputs hold NaN or infinity. Cut the record at its gaps.")
        for name in free or ():
            if name not in self.entries:
                raise ValueError(f"No parameter is called {name}. See `parameters`.")
            if not self.entries[name].fitted:
                raise ValueError(f"{name} is chosen, not estimated: it has no slope.")
