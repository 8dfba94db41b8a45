"""A model that another program steps: values of variables by name in, outputs out."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, Matrix
from slowtime.dynamics.effects import Kind
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.plant.co_simulation import (
    adjustable,
    advanced,
    check_co_simulation,
    outputs_at,
    starting_instant,
)
from slowtime_services.matrices.reduced_description import REST
from slowtime_services.models.simulation import state_of


@dataclasses.dataclass(frozen=True, slots=True)
class UnitVariable:
    """A variable of a functional mock-up unit.

    Parameters
    ----------
    name
        As other programs see it: a structured name of FMI 2.0.
    unit
        Of its value.
    meaning
        In a few words.
    """

    name: str
    unit: str
    meaning: str


class CoSimulatedModel:
    """A description as a unit of co-simulation: inputs, parameters, outputs, steps.

    Unlike other parts it keeps its state, because FMI asks for an instance that does.

    Parameters
    ----------
    description
        The model; its initial state is the state at the start.
    kinds
        Of effect, by name; the catalogue where not given.

    Raises
    ------
    ValueError
        Where an input or an effect needs a whole record.
    """

    def __init__(
        self, description: Description, kinds: Mapping[str, Kind] | None = None
    ) -> None:
        self._plant = Plant.of(description, kinds=kinds, hold="zero")
        check_co_simulation(self._plant)
        self.inputs = tuple(
            UnitVariable(
                _structured(one.channel), one.unit, f"{one.kind.replace('_', ' ')} {place}"
            )
            for one in description.inputs
            for place in (f"at {one.node}" if one.node else "",)
        )
        self.outputs = tuple(
            UnitVariable(_structured(one.channel), one.unit, f"{one.quantity} of {one.node}")
            for one in description.sensors
        )
        self._nominal = self._plant.values
        self._columns = _parameter_columns(self._plant)
        self.parameters = tuple(self._columns)
        self._now = np.zeros(len(self.inputs))
        self._changes = {
            variable.name: 0.0
            if variable.name.startswith("change.")
            else self._nominal[rows[0]]
            for variable, rows in self._columns.items()
        }
        self._rows = {variable.name: rows for variable, rows in self._columns.items()}
        self._values = self._nominal.copy()
        self.start(0.0)

    def start(self, time_s: float) -> None:
        """Return to the initial state.

        Parameters
        ----------
        time_s
            Campaign time of the start [s].
        """
        still = np.zeros((2, len(self.inputs)))
        state = state_of(self._plant, still, 1.0)
        self._instant = starting_instant(self._plant, state, time_s)
        self._read: Float[np.ndarray, " sensor"] | None = None

    def set_input(self, index: int, value: float) -> None:
        """Set an input from the present instant on, in its unit."""
        self._now[index], self._read = value, None

    def input(self, index: int) -> float:
        """Return the present value of an input, in its unit."""
        return float(self._now[index])

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter from the present instant on.

        Parameters
        ----------
        name
            Name of the variable.
        value
            Relative change [1], or value in the unit of the variable.

        Raises
        ------
        ValueError
            Where it is outside the bounds of the parameter.
        """
        entries = list(self._plant.entries.values())
        relative = name.startswith("change.")
        for row in self._rows[name]:
            wanted = self._nominal[row] * (1.0 + value) if relative else value
            if not entries[row].low <= wanted <= entries[row].high:
                raise ValueError(
                    f"{name} = {value:g} is not allowed: the value behind it has to be from "
                    f"{entries[row].low:g} to {entries[row].high:g} {entries[row].unit}."
                )
            self._values[row] = wanted
        self._changes[name], self._read = value, None

    def parameter(self, name: str) -> float:
        """Return the present value of a parameter, as it was set."""
        return float(self._changes[name])

    def output(self, index: int) -> float:
        """Return what a sensor measures at the present instant, in its unit."""
        if self._read is None:
            self._read = outputs_at(self._plant, self._values, self._instant, self._now)
        return float(self._read[index])

    def step(self, step_s: float) -> None:
        """Advance by one step, over which the inputs keep their values.

        Parameters
        ----------
        step_s
            Length of the step [s].

        Raises
        ------
        ArithmeticError
            Where the motion grows beyond bounds.
        """
        self._instant = advanced(self._plant, self._values, self._instant, self._now, step_s)
        self._read = None


def _parameter_columns(plant: Plant) -> dict[UnitVariable, tuple[int, ...]]:
    """Variable of each parameter → its rows in the values of the plant."""
    groups = {one.id for one in plant.description.elements if isinstance(one, Matrix)}
    row_of = {name: k for k, name in enumerate(plant.parameters)}
    found: dict[UnitVariable, tuple[int, ...]] = {}
    changed: dict[str, list[int]] = {}
    for name in adjustable(plant):
        place, unit = str(name[1]), plant.entries[name].unit
        if len(name) == 3:
            effect = plant.effects[int(name[1])]
            variable = UnitVariable(
                f"effect{name[1]}.{_structured(str(name[-1]))}",
                unit,
                f"{effect.kind} at {effect.place}",
            )
            found[variable] = (row_of[name],)
        elif place not in groups:
            named = f"{name[0]}.{_structured(place)}"
            found[UnitVariable(named, unit, f"{name[0]} of {place}")] = (row_of[name],)
        elif place != REST:
            changed.setdefault(place, []).append(row_of[name])
    groups_first = {
        UnitVariable(f"change.{_structured(place)}", "1", f"relative change of {place}"): tuple(
            rows
        )
        for place, rows in changed.items()
    }
    return groups_first | found


def _structured(name: str) -> str:
    """Write a name as FMI 2.0 wants it: an identifier, or any text in single quotes."""
    if name.isascii() and name.isidentifier():
        return name
    escaped = name.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
