"""Assessment: which members of a structure have lost stiffness between two states."""

from pathlib import Path

from slowtime.evolution.assessment import (
    Assessment,
    AssessmentSettings,
    DetectionLimit,
    plan_limits,
)
from slowtime.evolution.assessment import assess as assess_states
from slowtime.evolution.structures import updatable_model
from slowtime_schemas.files.modes import ModesFile
from slowtime_services.argument_checks import Count, Share, checked
from slowtime_services.assessment import (
    StateErrors,
    members_of,
    planned_state,
    read_states,
)
from slowtime_services.matrices import MatrixModel
from slowtime_services.matrices.measured_files import read_modes_file

from .arguments import existing_file
from .finite_elements.matrix_models import FiniteElementModel
from .modal_estimates import Modes

__all__ = ["Assessment", "DetectionLimit", "assess", "detection_limits"]

GivenModes = Modes | str | Path


@checked
def assess(
    model: FiniteElementModel | str | Path,
    before: GivenModes,
    now: GivenModes,
    *,
    ends: bool = False,
    frequency_error: Share = 0.001,
    shape_error: Share = 0.005,
    settings: AssessmentSettings | None = None,
) -> Assessment:
    """Find the members that have lost stiffness between two states.

    Parameters
    ----------
    model
        Model, or the path of its file, with a parameter for each member, connection, or group
        of them that may change.
    before, now
        Modes of the healthy and of the present state: of ``identify(method="modes")``, or a
        modes file.
    ends
        Whether ends of beams of a frame may have come loose as well.
    frequency_error
        Relative scatter of a frequency between measurements of one state, besides its stated
        standard deviation [1].
    shape_error
        Likewise of a component of a shape of norm 1 [1].
    settings
        What is assumed of model, temperature and damage
        (``slowtime.evolution.assessment.AssessmentSettings``).

    Returns
    -------
    The verdict, its sentence, and the set of suspects for each changed member.

    Raises
    ------
    ValueError
        If the model has no members, or a file no modes.
    """
    read = _model(model)
    members = members_of(read, ends=ends)
    errors = StateErrors(frequency_error, shape_error)
    states = read_states(read, _file(before), _file(now), errors)
    structure = updatable_model(members.matrices, len(states[0].frequency_hz))
    return assess_states(structure, *states, settings)


@checked
def detection_limits(
    model: FiniteElementModel | str | Path,
    *,
    modes: Count,
    frequency_sd: Share = 0.001,
    shape_sd: Share = 0.01,
    ends: bool = False,
    power: Share = 0.9,
    settings: AssessmentSettings | None = None,
) -> tuple[DetectionLimit, ...]:
    """Find, before measuring, the smallest loss of each member that `assess` will find.

    Parameters
    ----------
    model
        Model, or the path of its file, with the planned sensors.
    modes
        Number of lowest modes that will be measured.
    frequency_sd
        Relative standard deviation of a frequency [1].
    shape_sd
        Standard deviation of a component of a shape over the largest one [1].
    ends
        Whether ends of beams of a frame may come loose as well.
    power
        Probability with which a loss is found, below 0.95 [1].
    settings
        What is assumed of model, temperature and damage.

    Returns
    -------
    One limit for each member.

    Raises
    ------
    ValueError
        If the model has no members, or fewer modes.
    """
    read = _model(model)
    members = members_of(read, ends=ends)
    structure = updatable_model(members.matrices, modes)
    expected = planned_state(
        read, structure, modes, frequency_sd=frequency_sd, shape_sd=shape_sd
    )
    return plan_limits(structure, expected, settings, power=power)


def _model(given: FiniteElementModel | str | Path) -> MatrixModel:
    if isinstance(given, FiniteElementModel):
        return given.model
    return FiniteElementModel.from_file(given).model


def _file(given: GivenModes) -> ModesFile:
    return given.file() if isinstance(given, Modes) else read_modes_file(existing_file(given))
