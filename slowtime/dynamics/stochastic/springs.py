"""Springs, point masses and effects of a description, prepared for time stepping."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from slowtime.dynamics.description import Description, places
from slowtime.dynamics.effects import Effect, Kind, Law, catalogue, read_effects
from slowtime.dynamics.effects.compilation import law_address
from slowtime.dynamics.elements import Spring
from slowtime.dynamics.plant.parameter_names import Name, names_of

from . import kernel


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Springs:
    """Point masses joined by springs, dampers and laws of force; make one with `Springs.of`.

    Parameters
    ----------
    names
        Of all numbers, as those of a plant: ("stiffness", "k1"), ("effect", 0, "k3_n_per_m3").
    values
        As the description has them.
    nodes
        Names of the degrees of freedom.
    ends, laws
        As the compiled steps want them, see `kernel`.
    """

    names: tuple[Name, ...]
    values: Float[np.ndarray, " parameter"]
    nodes: tuple[str, ...]
    ends: Int[np.ndarray, "element 2"]
    laws: Int[np.ndarray, "law 4"]

    @classmethod
    def of(
        cls, description: Description, *, kinds: Mapping[str, Kind] | None = None
    ) -> "Springs":
        """Take a description of springs and points, whose effects are laws without memory."""
        known = catalogue() if kinds is None else kinds
        effects = read_effects(description, known)
        if not all(isinstance(part, Spring) for part in description.elements):
            raise ValueError(
                f"{description.name!r} has beams or matrices. Random motion is for springs "
                "and points; put springs in their place."
            )
        place = places(description)
        base = len(description.dofs)
        rows = {name: -1 if row is None or row == base else row for name, row in place.items()}
        ends = [[rows[name] for name in part.between] for part in description.elements]
        entries = names_of(description, effects, known)
        names = tuple(entries)
        elements = [part.id for part in description.elements]
        laws = [
            _law(i, effect, known[effect.kind], elements, rows, names)
            for i, effect in enumerate(effects)
        ]
        return cls(
            names=names,
            values=np.array([entry.value for entry in entries.values()]),
            nodes=description.dofs,
            ends=np.array(ends, dtype=np.int64).reshape(-1, 2),
            laws=np.array(laws, dtype=np.int64).reshape(-1, 4),
        )

    def where(self, names: Sequence[Name]) -> Int[np.ndarray, " named"]:
        """Places of some numbers among `values`."""
        for name in names:
            if name not in self.names:
                raise ValueError(f"No parameter is called {name}. There are: {self.names}.")
        return np.array([self.names.index(name) for name in names], dtype=np.int64)

    def move(
        self,
        states: Float[np.ndarray, "row state"],
        first: Float[np.ndarray, "group node"],
        last: Float[np.ndarray, "group node"],
        step_s: float,
        values: Float[np.ndarray, "row parameter"] | None = None,
        *,
        time_s: float = 0.0,
        substeps: int = 1,
    ) -> Float[np.ndarray, "row state"]:
        """States one step later without noise, by Runge and Kutta's fourth-order rule.

        Parameters
        ----------
        states
            Displacements, then velocities.
        first, last
            Forces [N] at both ends of the step, straight between; each row of them serves
            equally many rows of states in turn.
        step_s
            Length of the step [s].
        values
            Of the parameters, a row for each state; as the description has them if not given.
        time_s
            Campaign time at the beginning of the step [s].
        substeps
            Number of Runge-Kutta steps in it.

        Returns
        -------
        Displacements [m], then velocities [m/s].
        """
        moved = np.ascontiguousarray(states, dtype=float).copy()
        kernel.runge_kutta(
            self.ends,
            self.laws,
            self.rows(values, len(states)),
            moved,
            np.ascontiguousarray(first, dtype=float),
            np.ascontiguousarray(last, dtype=float),
            time_s,
            step_s,
            substeps,
            kernel.room_for(len(self.nodes)),
        )
        return moved

    def rows(
        self, values: Float[np.ndarray, "_ parameter"] | None, count: int
    ) -> Float[np.ndarray, "row parameter"]:
        """Make one row of parameters for each of `count` motions.

        Parameters
        ----------
        values
            Values in SI units, one row for all motions or one for each; None for those of the
            structure.
        count
            Number of motions.

        Returns
        -------
        Values, one row for each motion.
        """
        if values is None:
            values = self.values[None]
        wanted = (count, len(self.names))
        return np.ascontiguousarray(np.broadcast_to(values, wanted), dtype=float)


def _law(
    number: int,
    effect: Effect,
    kind: Kind,
    elements: Sequence[str],
    rows: Mapping[str, int],
    names: Sequence[Name],
) -> list[int]:
    action = kind.action
    if not isinstance(action, Law) or action.rates:
        raise ValueError(
            f"{effect.kind} on {effect.place} has memory or sticks, which random motion does "
            "not step. Allowed are laws of elongation, its rate and time, such as "
            "cubic_hardening, van_der_pol or quadratic_damping."
        )
    on_node = effect.place.kind == "node"
    place = rows[effect.place.id] if on_node else elements.index(effect.place.id)
    first = names.index(("effect", number, kind.names[0])) if kind.names else 0
    return [law_address(action.force), int(on_node), place, first]
