"""Finite-element models with parameters: from files or from matrices."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS, DofMap
from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime_api.arguments import existing_file, fields_named
from slowtime_api.results import html_table
from slowtime_schemas.files.finite_elements import Matrices, SpatialSensor
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.argument_checks import Count, Matrix, Positive, checked
from slowtime_services.matrices import MatrixModel, read_matrix_model

Direction = Literal["ux", "uy", "uz", "rx", "ry", "rz"]


class FiniteElementModel:
    """Sparse stiffness and mass with parameters that scale parts of them, and sensors.

    `slowtime.update`, `slowtime.place` and `slowtime.reduce` take it.

    Parameters
    ----------
    model
        Matrices, parameters and sensors, as `slowtime_services.matrices` reads them.
        `from_file` and `from_matrices` make one.
    """

    MADE_BY = "slowtime.FiniteElementModel.from_file(path) or .from_matrices(...)"
    """What makes one, for messages."""

    @checked
    def __init__(self, model: MatrixModel) -> None:
        self.model = model

    @classmethod
    @checked
    def from_file(cls, path: str | Path) -> "FiniteElementModel":
        """Read a model file with ``matrices`` or ``frame``.

        Parameters
        ----------
        path
            YAML or JSON with ``slowtime_model: 2``; files that it names are found beside it.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If the text or one of the files cannot be used; the message says what to do.
        FileNotFoundError
            If there is no such file.
        """
        return cls(read_matrix_model(existing_file(path)))

    @classmethod
    @checked
    def from_matrices(
        cls,
        stiffness_n_per_m: Matrix,
        mass_kg: Matrix,
        parameters: Mapping[str, Matrix],
        *,
        prior_sd: Positive = 0.3,
        nodes: Sequence[str] | None = None,
        directions: Sequence[Direction] | None = None,
        sensors: Sequence[str] | None = None,
    ) -> "FiniteElementModel":
        """Make a model of matrices in memory.

        Parameters
        ----------
        stiffness_n_per_m, mass_kg
            Symmetric matrices [dof, dof], dense or sparse [N/m], [kg].
        parameters
            By name, the part of the stiffness that a parameter scales [dof, dof] [N/m].
        prior_sd
            Standard deviation of the logarithm of each factor, believed beforehand [1].
        nodes
            Name of the node of each degree of freedom; ``"x1"``, ``"x2"``, ... where not given.
        directions
            Direction of each degree of freedom; ``"ux"`` for all where not given.
        sensors
            Nodes with accelerometers in every direction of theirs, channels ``a_`` and the name
            of the node, with the direction where it has several; all where not given.

        Returns
        -------
        The model.

        Raises
        ------
        ValueError
            If shapes differ, a matrix is not symmetric, or a name is used twice or unknown.

        Examples
        --------
        >>> springs = [[2.0, -1.0], [-1.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]
        >>> model = FiniteElementModel.from_matrices(springs[0], np.eye(2), {"k1": springs[1]})
        >>> model.parameters, model.channels
        (('k1',), ('a_x1', 'a_x2'))
        """
        count = len(stiffness_n_per_m)
        names = [f"x{i + 1}" for i in range(count)] if nodes is None else list(nodes)
        ways = ["ux"] * count if directions is None else list(directions)
        dofs = _dof_map(names, ways, count)
        matrices = ParametricMatrices(
            stiffness=sparse.csr_array(stiffness_n_per_m), mass=sparse.csr_array(mass_kg),
            names=tuple(parameters),
            stiffness_parts=tuple(sparse.csr_array(part) for part in parameters.values()),
            dofs=dofs,
        )  # fmt: skip
        wanted = list(dict.fromkeys(names)) if sensors is None else list(sensors)
        rows, spatial = _sensors(wanted, names, ways)
        with fields_named({"matrices": "parameters"}):
            file = FiniteElementFile(
                slowtime_model=2, name="matrices", sensors=spatial,
                matrices=Matrices(stiffness="stiffness.mtx", mass="mass.mtx"),
            )  # fmt: skip
        return cls(
            MatrixModel(
                name="matrices", matrices=matrices, prior_sd=np.full(len(parameters), prior_sd),
                channels=tuple(one.channel for one in spatial), sensors=rows, file=file,
            )
        )  # fmt: skip

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.model.matrices.names

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the sensors."""
        return self.model.channels

    def __len__(self) -> int:
        return self.model.matrices.size

    @checked
    def natural_frequencies_hz(self, modes: Count = 10) -> Float[np.ndarray, " mode"]:
        """Compute the lowest undamped natural frequencies, as built.

        Parameters
        ----------
        modes
            Number of modes; all where the model has fewer degrees of freedom.

        Returns
        -------
        Frequencies, ascending [Hz].

        Examples
        --------
        >>> model = FiniteElementModel.from_matrices([[4.0]], [[1.0]], {})
        >>> model.natural_frequencies_hz(1).round(4)
        array([0.3183])
        """
        matrices = self.model.matrices
        found = lowest_modes(matrices.stiffness, matrices.mass, min(modes, matrices.size))
        return np.asarray(found.frequency_hz)

    def _repr_html_(self) -> str:
        rows = [
            {"parameter": name, "prior sd [1]": float(sd)}
            for name, sd in zip(self.parameters, self.model.prior_sd, strict=True)
        ]
        return html_table(repr(self), rows)

    def __repr__(self) -> str:
        return (
            f"FiniteElementModel {self.name!r}: {len(self)} degrees of freedom, "
            f"{len(self.parameters)} parameters, {len(self.channels)} sensors"
        )


def _dof_map(nodes: Sequence[str], directions: Sequence[str], count: int) -> DofMap:
    """Return nodes and directions as a map; positions are not known."""
    for what, given in (("nodes", nodes), ("directions", directions)):
        if len(given) != count:
            raise ValueError(
                f"{len(given)} {what} were given for {count} rows of the stiffness. Give one "
                "for each."
            )
    names = tuple(dict.fromkeys(nodes))
    if len(set(zip(nodes, directions, strict=True))) < count:
        raise ValueError("Two degrees of freedom have one node and direction. Name each once.")
    return DofMap(
        node_names=names,
        coordinates=np.zeros((len(names), 3)),
        node=np.array([names.index(one) for one in nodes]),
        direction=np.array([DIRECTIONS.index(one) for one in directions]),
    )


def _sensors(
    wanted: Sequence[str], nodes: Sequence[str], directions: Sequence[Any]
) -> tuple[Float[np.ndarray, "sensor dof"], tuple[SpatialSensor, ...]]:
    """Return rows and entries of accelerometers on nodes, in every direction of theirs."""
    unknown = [name for name in wanted if name not in nodes]
    if unknown:
        raise ValueError(
            f"sensors name {', '.join(unknown)}. Allowed: {', '.join(dict.fromkeys(nodes))}."
        )
    places = [(name, k) for name in wanted for k, node in enumerate(nodes) if node == name]
    with fields_named({}):
        spatial = tuple(
            SpatialSensor(
                channel=f"a_{name}" + ("" if nodes.count(name) == 1 else f"_{directions[k]}"),
                node=name,
                direction=directions[k],
            )
            for name, k in places
        )
    return np.eye(len(nodes))[[k for _, k in places]], spatial
