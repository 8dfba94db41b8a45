"""Point masses joined by springs and dampers: the structure as it truly is, and as told."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BASE = -1
"""Index that stands for the base at the end of an element."""


@dataclasses.dataclass(frozen=True)
class Element:
    """A spring and a damper; elongation is that of `second` less that of `first`."""

    id: str
    first: int
    second: int
    stiffness: float
    damping: float


@dataclasses.dataclass(frozen=True)
class Rig:
    """Masses in coordinates relative to the base."""

    masses: tuple[float, ...]
    elements: tuple[Element, ...]
    unit: str = "m"

    @property
    def size(self) -> int:
        return len(self.masses)

    @property
    def nodes(self) -> tuple[str, ...]:
        return tuple(f"m{i + 1}" for i in range(self.size))

    def element(self, name: str) -> Element:
        return next(element for element in self.elements if element.id == name)

    def elongations(self) -> Array:
        """Matrix that turns displacements into elongations, one row an element."""
        rows = np.zeros((len(self.elements), self.size))
        for row, element in zip(rows, self.elements, strict=True):
            row[element.second] += 1.0
            if element.first != BASE:
                row[element.first] -= 1.0
        return rows

    def state_matrix(self) -> Array:
        """Rate of (displacement, velocity) by (displacement, velocity)."""
        to = self.elongations()
        k = to.T @ np.diag([element.stiffness for element in self.elements]) @ to
        c = to.T @ np.diag([element.damping for element in self.elements]) @ to
        inverse = np.diag(1.0 / np.array(self.masses))
        n = self.size
        return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ k, -inverse @ c]])

    def frequencies_hz(self) -> Array:
        """Natural frequencies, ascending, those of the undamped rig."""
        n = self.size
        squared = np.linalg.eigvals(-self.state_matrix()[n:, :n]).real
        return np.asarray(np.sqrt(np.sort(squared)) / (2 * np.pi))

    def scaled(self, stiffness: Sequence[float], damping: Sequence[float]) -> "Rig":
        """Multiply each element's stiffness and damping by a factor of its own."""
        elements = tuple(
            dataclasses.replace(e, stiffness=e.stiffness * k, damping=e.damping * c)
            for e, k, c in zip(self.elements, stiffness, damping, strict=True)
        )
        return dataclasses.replace(self, elements=elements)
