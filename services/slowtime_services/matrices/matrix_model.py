"""Model files of version 2 with matrices: their text checked, their files read."""

import dataclasses
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import ValidationError
from scipy import sparse

from slowtime.finite_elements.constraints import constrain, support_equations
from slowtime.finite_elements.frame import Support
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime_schemas.files.matrix_model import (
    Matrices,
    MatrixSensor,
    MatrixSource,
    ModelFile2,
    migrated,
)

from .dof_tables import read_dof_map
from .errors import MatrixFileError
from .sparse_files import read_matrix

SHOWN = 6
"""Faults of the text that are told of at once."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MatrixModel:
    """A model of matrices and what its file says besides.

    Parameters
    ----------
    name
        Of the model.
    matrices
        Sparse matrices with parameters and constraints.
    prior_sd
        Of the logarithm of the factor on each parameter [1].
    channels
        Names of the sensors.
    sensors
        What each sensor sees of the degrees of freedom before constraints.
    """

    name: str
    matrices: ParametricMatrices
    prior_sd: Float[np.ndarray, " parameter"]
    channels: tuple[str, ...]
    sensors: Float[np.ndarray, "sensor dof"]


def read_matrix_model(path: Path) -> MatrixModel:
    """Read a model file with `matrices`, and the files that it names.

    Parameters
    ----------
    path
        YAML or JSON; other files are found beside it.

    Returns
    -------
    The model.

    Raises
    ------
    MatrixFileError
        Where the text or one of the files cannot be used.
    """
    file = _checked(path)
    if file.matrices is None:
        raise MatrixFileError(
            f"{path.name} has no `matrices`. Give a model file of version 2 that names files "
            "of stiffness and mass."
        )
    model = read_model_of_matrices(file.matrices, path.parent)
    sensors = [one for one in file.sensors if isinstance(one, MatrixSensor)]
    if len(sensors) < len(file.sensors):
        raise MatrixFileError(
            f"{path.name} has sensors without a direction. Give each a `direction` or a `line`."
        )
    size = model.size if model.expansion is None else int(model.expansion.shape[0])
    return MatrixModel(
        name=file.name or path.stem,
        matrices=model,
        prior_sd=np.array([one.prior_sd for one in file.matrices.parameters]),
        channels=tuple(one.channel for one in sensors),
        sensors=np.array([_row(model, one) for one in sensors]).reshape(len(sensors), size),
    )


def read_model_of_matrices(section: Matrices, folder: Path) -> ParametricMatrices:
    """Read the files that a section `matrices` names.

    Parameters
    ----------
    section
        The section.
    folder
        Where its paths begin.

    Returns
    -------
    The model, held as the section says.
    """
    stiffness = _matrix(section.stiffness, folder, None)
    size = stiffness.shape[0]
    dofs = None
    if section.dofs is not None:
        positions = None if section.positions is None else folder / section.positions
        dofs = read_dof_map(folder / section.dofs, positions)
    try:
        model = ParametricMatrices(
            stiffness=stiffness,
            mass=_matrix(section.mass, folder, size),
            damping=None if section.damping is None else _matrix(section.damping, folder, size),
            names=tuple(one.name for one in section.parameters),
            stiffness_parts=tuple(
                None if one.stiffness is None else _matrix(one.stiffness, folder, size)
                for one in section.parameters
            ),
            mass_parts=tuple(
                None if one.mass is None else _matrix(one.mass, folder, size)
                for one in section.parameters
            ),
            dofs=dofs,
        )
        if not section.held:
            return model
        if dofs is None:
            raise MatrixFileError("`held` needs `dofs`. Give the file that says what rows are.")
        supports = [Support(node=one.node, directions=one.directions) for one in section.held]
        return constrain(model, support_equations(dofs, supports))
    except MatrixFileError:
        raise
    except ValueError as error:
        raise MatrixFileError(str(error)) from error


def _checked(path: Path) -> ModelFile2:
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MatrixFileError(
            f"{path.name} is not YAML ({str(error)[:200]}). Give a model file."
        ) from error
    if not isinstance(values, dict):
        raise MatrixFileError(
            f"{path.name} is no model file. Begin it with `slowtime_model: 2`."
        )
    try:
        return ModelFile2.model_validate(migrated(values))
    except ValidationError as error:
        faults = [
            f"{'.'.join(map(str, item['loc'])) or 'file'}: {item['msg']}"
            for item in error.errors(include_url=False)
        ]
        raise MatrixFileError(f"{path.name}: " + "\n".join(faults[:SHOWN])) from None


def _matrix(source: MatrixSource, folder: Path, size: int | None) -> sparse.csr_array:
    """Matrix of a file, with rows of zeros at its end where the file leaves them out."""
    found = read_matrix(folder / source.file, source.variable)
    if size is not None and found.shape[0] < size:
        missing = np.full(size - found.shape[0], found.indptr[-1])
        starts = np.concatenate([found.indptr, missing])
        found = sparse.csr_array((found.data, found.indices, starts), shape=(size, size))
    return found


def _row(model: ParametricMatrices, sensor: MatrixSensor) -> Float[np.ndarray, " dof"]:
    if model.dofs is None:
        raise MatrixFileError("`sensors` need `dofs`. Give the file that says what rows are.")
    try:
        if sensor.direction is not None:
            return model.dofs.row(sensor.node, {sensor.direction: 1.0})
        return model.dofs.row(sensor.node, sensor.line or ())
    except ValueError as error:
        raise MatrixFileError(f"Sensor {sensor.channel!r}: {error}") from error
