"""The model of a registration as arrays: parameters, and what channels measure."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, Parts, assemble, assemble_parts
from slowtime.dynamics.units import Motion, UnitOfCoordinate, unit_factor
from slowtime.evolution.structures import ParametricStructure

MASS = ".mass"
"""Follows a node's id in the name of its mass."""

ANY_STIFFNESS = 0.2
"""Relative sd of a model's stiffnesses where the model file does not say."""

Worth = tuple[float, int]
"""Worth of a channel's unit in SI, and how often its quantity is differentiated."""

POWERS: dict[Motion, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""How often each quantity of a sensor is differentiated from a displacement."""


class ModelError(ValueError):
    """A model and parameters that do not match; the text says what to do."""


@dataclasses.dataclass(frozen=True, eq=False)
class ElementModel:
    """Structure, parameters and channels of a twin of elements, as arrays.

    Parameters
    ----------
    whole
        Every element's stiffness and every node's mass as parameters, as the model file has
        them; the first epochs move it to where the structure is.
    tolerance
        Prior sd of each of them [1].
    free
        Names of those that may change afterwards.
    prior_sd
        Prior sd of the logarithm of each of them [1].
    sees
        What each channel sees of the degrees of freedom.
    worth
        Of each channel, as its sensor in the model says.
    unit_of_coordinate
        Of what the structure moves by.
    """

    whole: ParametricStructure
    tolerance: Float[np.ndarray, " whole"]
    free: tuple[str, ...]
    prior_sd: Float[np.ndarray, " parameter"]
    sees: Mapping[str, Float[np.ndarray, " dof"]]
    worth: Mapping[str, Worth]
    unit_of_coordinate: UnitOfCoordinate = "m"

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that see something move, in the order of the model's sensors."""
        return tuple(self.sees)

    @functools.cached_property
    def rows(self) -> Float[np.ndarray, "channel dof"]:
        """`sees` as a matrix."""
        return np.array(list(self.sees.values())).reshape(len(self.sees), self.whole.size)

    def at(self, theta: Sequence[float]) -> ParametricStructure:
        """Move `whole` by `theta`, which becomes nominal, and let only the free parts vary.

        Parameters
        ----------
        theta
            Logarithms of the factors on all parameters of `whole` [1].

        Returns
        -------
        The structure about these, with its free parameters.
        """
        moved = np.asarray(theta, dtype=np.float64)
        mass, stiffness = self.whole.matrices(moved)
        factor = dict(zip(self.whole.names, np.exp(moved).tolist(), strict=True))
        springs = [name for name in self.free if name in self.whole.element_names]
        masses = [name for name in self.free if name in self.whole.node_names]
        return ParametricStructure(
            mass=mass,
            stiffness=stiffness,
            stiffness_parts=self._parts(springs, factor),
            element_names=tuple(springs),
            mass_parts=self._parts(masses, factor) if masses else None,
            node_names=tuple(masses),
            dof_names=self.whole.dof_names,
        )

    def _parts(
        self, names: Sequence[str], factor: Mapping[str, float]
    ) -> Float[np.ndarray, "part dof dof"]:
        masses = self.whole.mass_parts
        parts = dict(zip(self.whole.element_names, self.whole.stiffness_parts, strict=True))
        if masses is not None:
            parts |= dict(zip(self.whole.node_names, masses, strict=True))
        size = self.whole.size
        return np.array([factor[name] * parts[name] for name in names]).reshape(
            len(names), size, size
        )


def model_of(
    description: Description,
    parameters: Mapping[str, float] | None = None,
    *,
    prior_sd: float = 0.3,
) -> ElementModel:
    """Prepare a description for estimation.

    Parameters
    ----------
    parameters
        Name of each free parameter, an element's id or a node's id and ``.mass``, and the
        prior sd of the logarithm of its factor; None for all stiffnesses and no mass.
    prior_sd
        For those, where `parameters` is None.

    Raises
    ------
    ModelError
        Where a parameter is none of the model's, or nothing could be seen of it.
    """
    parts = assemble_parts(description)
    structure = assemble(description)
    masses = {name + MASS: part for name, part in parts.mass_parts.items()}
    known = (*parts.stiffness_parts, *masses)
    wanted = (
        dict.fromkeys(parts.stiffness_parts, prior_sd) if parameters is None else parameters
    )
    strange = sorted(set(wanted) - set(known))
    if strange or not wanted:
        given = ", ".join(strange) or "no parameter at all"
        raise ModelError(
            f"{given} may change, it is said. Allowed: {', '.join(known)}. Name elements by "
            f"their id, masses by the node's id and {MASS!r}."
        )
    sees, worth = _channels(description, parts)
    whole = ParametricStructure(
        mass=structure.mass,
        stiffness=structure.stiffness,
        stiffness_parts=np.array(list(parts.stiffness_parts.values())),
        element_names=tuple(parts.stiffness_parts),
        mass_parts=np.array(list(masses.values())),
        node_names=tuple(masses),
        dof_names=parts.names,
    )
    free = tuple(name for name in known if name in wanted)
    return ElementModel(
        whole,
        _tolerance(description, whole),
        free,
        np.array([wanted[name] for name in free]),
        sees,
        worth,
        description.unit_of_coordinate,
    )


def _tolerance(
    description: Description, whole: ParametricStructure
) -> Float[np.ndarray, " whole"]:
    said = description.tolerance
    stiffness, mass = (said.stiffness, said.mass) if said is not None else (ANY_STIFFNESS, 0.0)
    return np.array([stiffness] * len(whole.element_names) + [mass] * len(whole.node_names))


def _channels(
    description: Description, parts: Parts
) -> tuple[dict[str, Float[np.ndarray, " dof"]], dict[str, Worth]]:
    """Return the quantity of each channel, except of those on the base, which is at rest."""
    sees, worth = {}, {}
    for sensor in description.sensors:
        if sensor.node not in parts.names or sensor.quantity == "force":
            continue
        row = np.zeros(len(parts.names))
        row[parts.names.index(sensor.node)] = 1.0
        factor = unit_factor(sensor.unit, sensor.quantity, description.unit_of_coordinate)
        sees[sensor.channel], worth[sensor.channel] = row, (factor, POWERS[sensor.quantity])
    if not sees:
        raise ModelError(
            "No sensor of the model is on something that moves. Give `sensors` with the "
            "channels that the edge agent names."
        )
    return sees, worth
