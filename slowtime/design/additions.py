"""A linear structure with design variables added and factors that scatter: matrices by row."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.dynamics.description import Description, assemble, assemble_parts, places, spread
from slowtime.dynamics.elements import BASE, ELONGATION, ROTATION, Spring

Part = Literal["stiffness", "damping", "mass"]
Matrices = Float[np.ndarray, "row dof dof"]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Addition:
    """What a design variable adds to a structure.

    Parameters
    ----------
    part
        ``"stiffness"`` [N/m] or ``"damping"`` [N s/m] between two nodes, or ``"mass"`` [kg]
        at a node.
    between
        First and second node, `slowtime.dynamics.elements.BASE` for the ground; of a mass, the
        node alone.
    name
        Of the element that it becomes.
    """

    part: Part
    between: tuple[str, ...]
    name: str = "added"


class AddedStructure:
    """Mass, damping and stiffness of a description for rows of variables and factors.

    Parameters
    ----------
    description
        The structure as it is.
    additions
        What design variables add.
    factors
        Names such as ``storey1.stiffness`` or ``roof.mass``, one an input: the part of that
        element or node is multiplied by it.
    columns
        Place among the design variables of each addition; by default their order.

    Raises
    ------
    ValueError
        For a node or part that the description does not have.
    """

    def __init__(
        self,
        description: Description,
        additions: Sequence[Addition],
        factors: Sequence[str] = (),
        columns: Sequence[int] | None = None,
    ) -> None:
        self.description = description
        self.structure = assemble(description)
        self.additions, self.factors = tuple(additions), tuple(factors)
        parts = assemble_parts(description)
        known: dict[str, tuple[Part, np.ndarray]] = {}
        of_each: tuple[tuple[Part, Mapping[str, np.ndarray]], ...] = (
            ("mass", parts.mass_parts),
            ("damping", parts.damping_parts),
            ("stiffness", parts.stiffness_parts),
        )
        for part, matrices in of_each:
            known |= {f"{name}.{part}": (part, matrix) for name, matrix in matrices.items()}
        missing = [name for name in self.factors if name not in known]
        if missing:
            raise ValueError(
                f"{', '.join(missing)}: no such part of the model. Allowed: {', '.join(known)}."
            )
        self._scattering = [known[name] for name in self.factors]
        self._added = [(one.part, self._unit(one)) for one in self.additions]
        self._columns = list(range(len(self.additions)) if columns is None else columns)
        self.parts: Mapping[str, Part] = {name: part for name, (part, _) in known.items()}
        """Name of each part that may scatter, and what it is."""

    def _unit(self, addition: Addition) -> np.ndarray:
        """Matrix that one unit of an addition brings."""
        names = {BASE, *(node.id for node in self.description.nodes)}
        wanted = 1 if addition.part == "mass" else 2
        unknown = [node for node in addition.between if node not in names]
        if unknown or len(addition.between) != wanted:
            raise ValueError(
                f"{addition.part} was added at {', '.join(addition.between)}. Give "
                f"{'one node' if wanted == 1 else 'two nodes'} of: {', '.join(sorted(names))}."
            )
        if addition.between == (BASE,):
            raise ValueError("Mass was added at the base, which does not feel it. Give a node.")
        place = places(self.description)
        size = len(self.description.dofs) + 1
        own = np.ones((1, 1)) if wanted == 1 else ELONGATION
        return np.asarray(spread(own, addition.between, place, size)[:-1, :-1])

    def matrices(
        self, d: Float[np.ndarray, "row variable"], factors: Float[np.ndarray, "row factor"]
    ) -> dict[Part, Matrices]:
        """Compute mass, damping and stiffness matrix of each row.

        Parameters
        ----------
        d
            Design variables, in SI units.
        factors
            Factors on the parts that scatter [1].

        Returns
        -------
        Part → matrices [row, dof, dof], in SI units.
        """
        whole: dict[Part, np.ndarray] = {
            "mass": self.structure.mass,
            "damping": self.structure.damping,
            "stiffness": self.structure.stiffness,
        }
        found = {part: np.tile(matrix, (len(d), 1, 1)) for part, matrix in whole.items()}
        for k, (part, matrix) in enumerate(self._scattering):
            found[part] += (factors[:, k] - 1.0)[:, None, None] * matrix
        for k, (part, matrix) in zip(self._columns, self._added, strict=True):
            found[part] += d[:, k, None, None] * matrix
        return found

    def described(self, d: Float[np.ndarray, " variable"]) -> Description:
        """Make the description of the structure with a design built in.

        Parameters
        ----------
        d
            Design variables, in SI units.

        Returns
        -------
        The description.
        """
        nodes, elements = list(self.description.nodes), list(self.description.elements)
        values = d[self._columns].tolist()
        for one, value in zip(self.additions, values, strict=True):
            if one.part == "mass":
                at = next(k for k, node in enumerate(nodes) if node.id == one.between[0])
                heavier = nodes[at].mass_kg + value
                nodes[at] = dataclasses.replace(nodes[at], mass_kg=heavier)
            else:
                stiffness = one.part == "stiffness"
                first, second = one.between
                taken = {element.id for element in elements}
                name = one.name
                while name in taken:
                    name += "_added"
                elements.append(
                    Spring(
                        id=name,
                        between=(first, second),
                        stiffness_n_per_m=value if stiffness else 0.0,
                        damping_n_s_per_m=0.0 if stiffness else value,
                    )
                )
        return dataclasses.replace(
            self.description, nodes=tuple(nodes), elements=tuple(elements)
        )

    def row_of(self, node: str) -> Float[np.ndarray, " dof"]:
        """Displacement of a node relative to the base, as a row over the coordinates."""
        row = np.zeros(self.structure.dofs)
        if node != BASE:
            row[self.structure.dof(node)] = 1.0
        return row

    @property
    def influence(self) -> Float[np.ndarray, " dof"]:
        """1 for each translation, 0 for each rotation."""
        return np.array(
            [0.0 if name.endswith(ROTATION) else 1.0 for name in self.structure.names]
        )
