"""Modes files → measured modes at the sensors of a finite-element model."""

import math
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from slowtime.dynamics.units import unit_factor
from slowtime.evolution.structures import MeasuredModes
from slowtime.identification.mode_shapes.criteria import real_shape
from slowtime_schemas.files.modes import FoundMode, ModesFile
from slowtime_services.documents.bounds import RESULT, DocumentError
from slowtime_services.documents.document_files import read_checked_json

from .errors import MatrixFileError
from .matrix_model import MatrixModel
from .reduced_description import UNITS


def read_modes_file(path: Path) -> ModesFile:
    """Read what `slowtime identify --method modes --out` wrote.

    Parameters
    ----------
    path
        Modes file.

    Returns
    -------
    The file.

    Raises
    ------
    MatrixFileError
        Where it is another file.
    """
    try:
        return read_checked_json(path, ModesFile, RESULT)
    except DocumentError as error:
        raise MatrixFileError(
            f"{path.name} is not a valid modes file ({error!s:.400}). Give what "
            "`slowtime identify "
            "RECORD --method modes --out modes.json` wrote."
        ) from None


def read_measured_modes(
    path: Path, model: MatrixModel, *, frequency_error: float = 0.0, shape_error: float = 0.0
) -> MeasuredModes:
    """Read what `slowtime identify --method modes --out` wrote, as data for a model.

    Parameters
    ----------
    path
        Modes file of a whole record.
    model
        The model, whose sensors name the channels.
    frequency_error
        Relative standard deviation of a frequency that no parameters of the model explain,
        added in quadrature [1].
    shape_error
        Likewise of a component of a shape of norm 1 [1].

    Returns
    -------
    Structural modes; without shapes where fewer than two channels are sensors of the model.

    Raises
    ------
    MatrixFileError
        Where it is another file, or none of its modes is structural.
    """
    return measured_modes(
        read_modes_file(path),
        model,
        frequency_error=frequency_error,
        shape_error=shape_error,
        name=path.name,
    )


def measured_modes(
    found: ModesFile,
    model: MatrixModel,
    *,
    frequency_error: float = 0.0,
    shape_error: float = 0.0,
    only: Collection[str] | None = None,
    name: str = "The list of modes",
) -> MeasuredModes:
    """Turn a modes file into data for a model; see `read_measured_modes`.

    Parameters
    ----------
    found
        Modes file of a whole record.
    model
        The model, whose sensors name the channels.
    frequency_error, shape_error
        As for `read_measured_modes` [1].
    only
        Channels to use, in the order of the model; by default all that are its sensors.
    name
        Of the file, for errors.

    Returns
    -------
    Structural modes.

    Raises
    ------
    MatrixFileError
        Where none of its modes is structural.
    """
    modes = [mode for mode in found.modes or () if mode.kind == "structural"]
    if not modes:
        raise MatrixFileError(
            f"{name} has no structural mode of a whole record. Identify a longer record, "
            "without --window-s."
        )
    frequency = np.array([mode.frequency_hz.value for mode in modes])
    sd = np.array([mode.frequency_hz.sd for mode in modes])
    columns = [k for k, channel in enumerate(found.channels) if channel in model.channels]
    if only is not None:
        order = {channel: k for k, channel in enumerate(found.channels)}
        columns = [order[channel] for channel in model.channels if channel in only]
    shapes = shape_sd = channels = None
    if len(columns) > 1:
        names = [found.channels[k] for k in columns]
        channels = _rows(model, names)
        shapes, shape_sd = _shapes(modes, columns, shape_error)
    return MeasuredModes(
        frequency_hz=frequency,
        frequency_sd_hz=np.hypot(sd, frequency_error * frequency),
        shapes=shapes,
        shape_sd=shape_sd,
        channels=channels,
    )


def _rows(model: MatrixModel, names: Sequence[str]) -> np.ndarray:
    """Rows of sensors, each in the unit of its channel."""
    sensors = {one.channel: one for one in model.file.sensors}
    quantities = sorted({sensors[name].quantity for name in names})
    if len(quantities) > 1:
        raise MatrixFileError(
            f"The channels measure {' and '.join(quantities)}. Shapes are compared among "
            "sensors of one quantity; leave the others out of the model's `sensors`."
        )
    rows = []
    for name in names:
        factor = 1.0
        if (unit := sensors[name].unit) is not None and sensors[name].quantity in UNITS:
            factor = unit_factor(unit, sensors[name].quantity, "m")  # type: ignore[arg-type]
        rows.append(model.sensors[model.channels.index(name)] / factor)
    return np.array(rows)


def _shapes(
    modes: Sequence[FoundMode], columns: Sequence[int], shape_error: float
) -> tuple[np.ndarray, np.ndarray]:
    """Real shapes of norm 1 and their standard deviations; NaN where there is none."""
    shapes = np.full((len(modes), len(columns)), math.nan)
    sds = shapes.copy()
    for row, mode in enumerate(modes):
        if mode.shape is None:
            continue
        whole = np.array(mode.shape.re)[columns] + 1j * np.array(mode.shape.im)[columns]
        norm = float(np.linalg.norm(whole))
        shapes[row] = real_shape(whole / norm)
        # A complex component errs along the real line as it does across.
        own = np.array(mode.shape.sd)[columns] / norm / math.sqrt(2.0)
        sds[row] = np.hypot(own, shape_error)
    return shapes, np.where(sds > 0.0, sds, math.nan)
