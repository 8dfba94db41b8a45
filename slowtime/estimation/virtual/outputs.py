"""Quantities of a model that nobody measures: displacement, drift, force, moment, stress.

Each is a row over the coordinates of the model, relative to its base. The row of a force holds
the stiffness of its element, and changes with it.
"""

import dataclasses
from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, places
from slowtime.dynamics.elements import BASE, Beam, Element, Matrix

Row = Float[np.ndarray, " dof"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One quantity.

    Parameters
    ----------
    name
        Of the quantity, such as ``storey1.stress``.
    unit
        Of its values, after `factor`.
    row
        Description → row over its coordinates, in SI.
    factor
        Unit of the values for one unit of SI, such as stress for force: 1 / section modulus.
    factor_sd
        Relative standard deviation of `factor` [1].
    """

    name: str
    unit: str
    row: Callable[[Description], Row]
    factor: float = 1.0
    factor_sd: float = 0.0

    def scaled(self, factor: float, unit: str, *, sd: float = 0.0, name: str = "") -> "Output":
        """Scale the output, such as from force to stress.

        Parameters
        ----------
        factor
            Units of the new quantity for one of this.
        unit
            Of the new quantity.
        sd
            Relative standard deviation of `factor` [1].
        name
            Name of the new output; that of this one where empty.

        Returns
        -------
        The scaled output.
        """
        return dataclasses.replace(
            self,
            name=name or self.name,
            unit=unit,
            factor=self.factor * factor,
            factor_sd=float(np.hypot(self.factor_sd, sd)),
        )


def displacement(node: str, *, name: str = "") -> Output:
    """Displacement of a node relative to the base [m]."""

    def row(description: Description) -> Row:
        return _row(description, {node: 1.0})

    return Output(name=name or f"{node}.displacement", unit="m", row=row)


def drift(lower: str, upper: str, *, name: str = "") -> Output:
    """Displacement of `upper` minus that of `lower` [m]; either may be ``"base"``."""

    def row(description: Description) -> Row:
        return np.asarray(_row(description, {upper: 1.0}) - _row(description, {lower: 1.0}))

    return Output(name=name or f"{lower}-{upper}.drift", unit="m", row=row)


def element_force(element: str, *, name: str = "") -> Output:
    """Elastic force in a spring, in tension positive, or shear force in a beam [N]."""

    def row(description: Description) -> Row:
        part = _element(description, element)
        if isinstance(part, Matrix):
            raise ValueError(
                f"Element {element!r} is a matrix, which has no single force. Ask for the "
                "force of a spring or a beam."
            )
        own = np.asarray(part.stiffness()[2 if isinstance(part, Beam) else 1])
        return _sum(description, part.dofs, own)

    return Output(name=name or f"{element}.force", unit="N", row=row)


def moment(
    element: str, end: Literal["first", "second"] = "first", *, name: str = ""
) -> Output:
    """Bending moment at one end of a beam [N m]."""

    def row(description: Description) -> Row:
        part = _element(description, element)
        if not isinstance(part, Beam):
            raise ValueError(
                f"Element {element!r} is not a beam. Ask for the moment of a "
                "beam, or for a force."
            )
        return _sum(description, part.dofs, part.stiffness()[1 if end == "first" else 3])

    return Output(name=name or f"{element}.moment", unit="N m", row=row)


def _element(description: Description, name: str) -> Element:
    for element in description.elements:
        if element.id == name:
            return element
    known = ", ".join(element.id for element in description.elements)
    raise ValueError(f"The model has no element {name!r}. Allowed: {known}.")


def _row(description: Description, weights: dict[str, float]) -> Row:
    known = {BASE, *(node.id for node in description.nodes)}
    for node in weights:
        if node not in known:
            raise ValueError(
                f"The model has no node {node!r}. Allowed: {', '.join(sorted(known))}."
            )
    return _sum(description, tuple(weights), np.array(list(weights.values())))


def _sum(description: Description, names: tuple[str, ...], own: np.ndarray) -> Row:
    place, row = places(description), np.zeros(len(description.dofs))
    for name, weight in zip(names, own, strict=True):
        where = place[name]
        if where is not None and where < len(row):
            row[where] += weight
    return row
