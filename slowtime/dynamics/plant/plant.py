"""The plant: a description that can be run at any values of its parameters."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description
from slowtime.dynamics.effects import Effect, Kind, catalogue, read_effects

from .names import Entry, Name, names_of

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
    entries: Mapping[Name, Entry]
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
        kinds
            Those known, by name; the catalogue where not given.
        hold
            What inputs do between samples, see `signals.interpolation.polynomials`.
        """
        known = catalogue() if kinds is None else kinds
        effects = read_effects(description, known)
        return cls(
            description=description,
            effects=effects,
            kinds=known,
            entries=names_of(description, effects, known),
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

    def simulate(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        *,
        state0: State | None = None,
        start_s: float = 0.0,
    ) -> Outputs:
        """Run under inputs; from rest where no `state0` is given."""
        raise NotImplementedError

    def sensitivities(
        self,
        values: Values,
        inputs: Inputs,
        rate_hz: float,
        free: Sequence[Name],
        *,
        state0: State | None = None,
        start_s: float = 0.0,
    ) -> tuple[Outputs, Float[np.ndarray, "time sensor slope"]]:
        """Run; give outputs, and their slopes to the `free` parameters and then to `state0`."""
        raise NotImplementedError
