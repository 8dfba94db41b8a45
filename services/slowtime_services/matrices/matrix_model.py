"""Finite-element models of files of version 2: their text checked, their matrices read."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy import sparse

from slowtime.finite_elements.assembly import assemble, whole_mass
from slowtime.finite_elements.constraints import constrain, support_equations
from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS, DofMap
from slowtime.finite_elements.frame import Support
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime_schemas.files.finite_elements import (
    FrameModel,
    FrameParameter,
    Matrices,
    MatrixParameter,
    MatrixSource,
    PartSource,
    SpatialSensor,
)
from slowtime_schemas.files.model_v2 import FiniteElementFile
from slowtime_services.models import ModelFileError, read_finite_elements

from .dof_tables import read_dof_map
from .errors import MatrixFileError
from .frame_model import frame_of
from .sparse_files import read_matrix

ROUNDED = 2e-6
"""Difference of two entries over their size [1] that rounding to six digits makes, as of text
files."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MatrixModel:
    """A finite-element model and what its file says besides.

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
    file
        All that the file says.
    base_load
        Mass times a unit motion of all nodes in the direction of the base's motion, over the
        coordinates of `matrices` [kg]; None where the base is not said to move.
    unheld
        Matrices of files before nodes are held, for drawings; None for frames.
    """

    name: str
    matrices: ParametricMatrices
    prior_sd: Float[np.ndarray, " parameter"]
    channels: tuple[str, ...]
    sensors: Float[np.ndarray, "sensor dof"]
    file: FiniteElementFile
    base_load: Float[np.ndarray, " own"] | None = None
    unheld: ParametricMatrices | None = None

    @property
    def base_direction(self) -> str | None:
        """Direction in which the base moves by an input; None where it does not."""
        return base_direction(self.file)

    def translation(self, direction: str) -> Float[np.ndarray, " dof"]:
        """Displacements while all nodes move by one unit in a direction [1]."""
        assert self.matrices.dofs is not None
        return translation(self.matrices.dofs, direction)


def base_direction(file: FiniteElementFile) -> str | None:
    """Direction of the base's motion; None where no input moves it.

    Raises
    ------
    MatrixFileError
        Where several inputs move it.
    """
    found = [one.direction for one in file.inputs if one.kind == "base_acceleration"]
    if len(found) > 1:
        raise MatrixFileError(
            f"The base is moved along {', '.join(found)}. Allowed is one base_acceleration; "
            "make a model for each direction."
        )
    return found[0] if found else None


def translation(dofs: DofMap, direction: str) -> Float[np.ndarray, " dof"]:
    """Displacements while all nodes move by one unit in a direction [1]."""
    return np.asarray(dofs.direction == DIRECTIONS.index(direction), dtype=float)


def read_matrix_model(path: Path) -> MatrixModel:
    """Read a model file with `matrices` or `frame`, and the files that it names.

    Parameters
    ----------
    path
        YAML or JSON; other files are found beside it.

    Raises
    ------
    MatrixFileError
        Where the text or one of the files cannot be used.
    """
    try:
        file = read_finite_elements(path)
    except ModelFileError as error:
        raise MatrixFileError(str(error)) from error
    if file is None:
        raise MatrixFileError(
            f"{path.name} has neither `matrices` nor `frame`. Give a model file of version 2 "
            "that names files of stiffness and mass, or describes a frame."
        )
    return matrix_model_of(file, path.parent, path.stem)


def matrix_model_of(file: FiniteElementFile, folder: Path, name: str = "") -> MatrixModel:
    """Assemble a finite-element model, or read its matrices.

    Parameters
    ----------
    file
        Text of a model file.
    folder
        Where its paths begin.
    name
        Of the model, where its file has none.

    Raises
    ------
    MatrixFileError
        Where a name does not exist or a file cannot be used.
    """
    direction = base_direction(file)
    parameters: tuple[MatrixParameter | FrameParameter, ...]
    mass: sparse.csr_array | None
    unheld = None
    if file.matrices is not None:
        model, unheld = _read_matrices(file.matrices, folder)
        mass = unheld.mass
        parameters = file.matrices.parameters
    else:
        assert file.frame is not None
        model, mass = _assembled(file.frame, whole=direction is not None)
        parameters = file.frame.parameters
    size = model.size if model.expansion is None else int(model.expansion.shape[0])
    rows = [sensor_row(model.dofs, one, folder) for one in file.sensors]
    _check_channels([one.channel for one in file.sensors])
    return MatrixModel(
        name=file.name or name,
        matrices=model,
        prior_sd=np.array([one.prior_sd for one in parameters]),
        channels=tuple(one.channel for one in file.sensors),
        sensors=np.array(rows).reshape(len(rows), size),
        file=file,
        base_load=None if direction is None else _base_load(model, mass, direction),
        unheld=unheld,
    )


def _base_load(
    model: ParametricMatrices, mass: sparse.csr_array | None, direction: str
) -> Float[np.ndarray, " own"]:
    if mass is None or model.dofs is None:
        raise MatrixFileError(
            "A base_acceleration needs `dofs`. Give the file that says what rows are."
        )
    load = np.asarray(mass @ translation(model.dofs, direction))
    return load if model.expansion is None else np.asarray(model.expansion.T @ load)


def _assembled(
    section: FrameModel, *, whole: bool
) -> tuple[ParametricMatrices, sparse.csr_array | None]:
    """Matrices of a frame, and the mass before constraints where the base moves."""
    frame = frame_of(section)
    try:
        return assemble(frame), whole_mass(frame) if whole else None
    except ValueError as error:
        raise MatrixFileError(f"`frame`: {error}") from error


def _read_matrices(
    section: Matrices, folder: Path
) -> tuple[ParametricMatrices, ParametricMatrices]:
    """Read the model, held as the section says, and as it is before that."""
    stiffness = _matrix(section.stiffness, folder, None)
    size = stiffness.shape[0]
    dofs = None
    if section.dofs is not None:
        positions = None if section.positions is None else folder / section.positions
        dofs = read_dof_map(folder / section.dofs, positions)
    mass = _matrix(section.mass, folder, size)
    try:
        model = ParametricMatrices(
            stiffness=stiffness,
            mass=mass,
            damping=None if section.damping is None else _matrix(section.damping, folder, size),
            names=tuple(one.name for one in section.parameters),
            stiffness_parts=tuple(
                _part(one.stiffness, folder, stiffness) for one in section.parameters
            ),
            mass_parts=tuple(_part(one.mass, folder, mass) for one in section.parameters),
            dofs=dofs,
        )
        if not section.held:
            return model, model
        if dofs is None:
            raise MatrixFileError("`held` needs `dofs`. Give the file that says what rows are.")
        supports = [Support(node=one.node, directions=one.directions) for one in section.held]
        return constrain(model, support_equations(dofs, supports)), model
    except MatrixFileError:
        raise
    except ValueError as error:
        raise MatrixFileError(str(error)) from error


def _part(
    source: PartSource | None, folder: Path, whole: sparse.csr_array
) -> sparse.csr_array | None:
    """Read what a unit of a parameter adds: a matrix, or a difference of two over a change."""
    if source is None:
        return None
    found = _matrix(source, folder, int(whole.shape[0]))
    if source.change is None:
        return found
    if found.shape != whole.shape:
        raise MatrixFileError(
            f"{source.file} has {found.shape[0]} rows and the whole matrix {whole.shape[0]}. "
            "With `change`, both have the same rows."
        )
    difference = sparse.coo_array(found - whole)
    rows, columns = difference.coords
    size = np.abs(sparse.csr_array(whole)[rows, columns])
    kept = np.abs(difference.data) > ROUNDED * np.asarray(size).ravel()
    if not kept.any():
        raise MatrixFileError(
            f"{source.file} equals the whole matrix. Export it with the group changed by "
            f"{source.change:g}."
        )
    values = difference.data[kept] / source.change
    return sparse.csr_array((values, (rows[kept], columns[kept])), shape=whole.shape)


def _matrix(source: MatrixSource, folder: Path, size: int | None) -> sparse.csr_array:
    """Matrix of a file, with rows of zeros at its end where the file leaves them out."""
    found = read_matrix(folder / source.file, source.variable)
    if size is not None and found.shape[0] < size:
        missing = np.full(size - found.shape[0], found.indptr[-1])
        starts = np.concatenate([found.indptr, missing])
        found = sparse.csr_array((found.data, found.indices, starts), shape=(size, size))
    return found


def _check_channels(channels: list[str]) -> None:
    twice = next((name for name in channels if channels.count(name) > 1), None)
    if twice is not None:
        raise MatrixFileError(
            f"Two sensors have the channel {twice!r}. Give each channel its own name."
        )


def sensor_row(
    dofs: DofMap | None, sensor: SpatialSensor, folder: Path
) -> Float[np.ndarray, " dof"]:
    """Row of a sensor over the degrees of freedom before constraints.

    Parameters
    ----------
    sensor
        Where it is, and what it measures.
    folder
        Where paths begin.

    Returns
    -------
    One entry for each degree of freedom: 1 for a motion, 1/m for a strain.

    Raises
    ------
    MatrixFileError
        Where there is no such node or direction.
    """
    if dofs is None:
        raise MatrixFileError("`sensors` need `dofs`. Give the file that says what rows are.")
    try:
        if sensor.row is not None:
            return _row_of_file(sensor, folder, dofs.size)
        if sensor.between is not None:
            return _strain_row(dofs, sensor.between)
        assert sensor.node is not None
        if sensor.direction is not None:
            return dofs.row(sensor.node, {sensor.direction: 1.0})
        return dofs.row(sensor.node, sensor.line or ())
    except MatrixFileError:
        raise
    except ValueError as error:
        raise MatrixFileError(f"Sensor {sensor.channel!r}: {error}") from error


def _strain_row(dofs: DofMap, between: tuple[str, str]) -> Float[np.ndarray, " dof"]:
    """Elongation of the line between two nodes over its length."""
    places = []
    for node in between:
        dofs.find(node, "ux")
        places.append(dofs.coordinates[dofs.node_names.index(node)])
    along = places[1] - places[0]
    length = float(np.linalg.norm(along))
    if not length > 0.0:
        raise ValueError(
            f"Nodes {between[0]!r} and {between[1]!r} are at one place. Give two places, or "
            "`positions` of the nodes."
        )
    line = (along / length**2).tolist()
    return np.asarray(dofs.row(between[1], line) - dofs.row(between[0], line))


def _row_of_file(sensor: SpatialSensor, folder: Path, size: int) -> Float[np.ndarray, " dof"]:
    assert sensor.row is not None
    found = read_matrix(folder / sensor.row.file, sensor.row.variable, square=False)
    if found.shape[1] != size or sensor.row.row >= found.shape[0]:
        raise MatrixFileError(
            f"Sensor {sensor.channel!r} takes row {sensor.row.row} of {sensor.row.file}, a "
            f"matrix of shape {found.shape}. Allowed are rows counted from 0 of a matrix of "
            f"{size} columns, one for each degree of freedom."
        )
    return np.asarray(found[[sensor.row.row]].toarray()[0])
