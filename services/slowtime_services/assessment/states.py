"""Modes files of one structure before and now → measured modes at common channels."""

import dataclasses

import numpy as np

from slowtime.evolution.assessment import expected_modes
from slowtime.evolution.structures import MeasuredModes, UpdatableModel
from slowtime_schemas.files.modes import ModesFile
from slowtime_services.matrices import MatrixFileError, MatrixModel
from slowtime_services.matrices.measured_files import measured_modes


@dataclasses.dataclass(frozen=True, slots=True)
class StateErrors:
    """Scatter between measurements of one state that files of modes do not state.

    Parameters
    ----------
    frequency
        Relative standard deviation of a frequency [1].
    shape
        Standard deviation of a component of a shape of norm 1 [1].
    """

    frequency: float = 0.001
    shape: float = 0.005


def read_states(
    model: MatrixModel, before: ModesFile, now: ModesFile, errors: StateErrors
) -> tuple[MeasuredModes, MeasuredModes]:
    """Turn two modes files into modes at the sensors that both have.

    Parameters
    ----------
    model
        The model, whose sensors name the channels.
    before, now
        Modes files of whole records.
    errors
        Scatter that the files do not state.

    Returns
    -------
    The modes before and now; without shapes where fewer than two sensors are in both.

    Raises
    ------
    MatrixFileError
        Where one has no structural mode.
    """
    both = set(before.channels) & set(now.channels) & set(model.channels)
    first, second = (
        measured_modes(
            file,
            model,
            frequency_error=errors.frequency,
            shape_error=errors.shape,
            only=both,
            name=f"The file of the modes {word}",
        )
        for file, word in ((before, "before"), (now, "now"))
    )
    return first, second


def read_state(model: MatrixModel, file: ModesFile, errors: StateErrors) -> MeasuredModes:
    """Turn one modes file into modes at sensors; see `read_states`."""
    return read_states(model, file, file, errors)[0]


def planned_state(
    model: MatrixModel,
    structure: UpdatableModel,
    modes: int,
    *,
    frequency_sd: float,
    shape_sd: float,
) -> MeasuredModes:
    """Modes that the sensors of a model file will measure.

    Parameters
    ----------
    model, structure
        The model file, and its members.
    modes
        Number of lowest modes.
    frequency_sd, shape_sd
        Errors of a frequency, relative, and of a component of a shape over the largest [1].

    Returns
    -------
    Modes with their standard deviations.

    Raises
    ------
    MatrixFileError
        Where the model has fewer modes.
    """
    most = int(model.matrices.size)
    if not 0 < modes <= most:
        raise MatrixFileError(f"{modes} modes of a model that has {most}. Give fewer.")
    rows = np.asarray(model.sensors)
    return expected_modes(structure, rows, modes, frequency_sd=frequency_sd, shape_sd=shape_sd)
