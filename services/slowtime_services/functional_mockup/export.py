"""Writer of functional mock-up units: FMI 2.0 for co-simulation, by PythonFMU."""

import re
import sys
import tempfile
from pathlib import Path

from slowtime.dynamics.description import Description
from slowtime_services.models import model_file_of

from .co_simulated_model import CoSimulatedModel

SCRIPT = '''"""Slave of the unit; PythonFMU imports it."""

from slowtime_services.functional_mockup.slave import ModelSlave


class {name}(ModelSlave):
    """The model in model.json."""

    def __init__(self, **given):
        # PythonFMU 0.7 fails on a second instance where a class has no method of its own.
        super().__init__(**given)
'''


class FmuError(ValueError):
    """A model that cannot be written as a functional mock-up unit."""


def write_fmu(
    description: Description, path: Path, *, step_s: float = 1e-3
) -> CoSimulatedModel:
    """Write a model as a functional mock-up unit.

    The unit holds the model and the binaries of PythonFMU for 64-bit Linux and Windows. The
    program that runs it needs a Python that can import slowtime.

    Parameters
    ----------
    description
        The model, with inputs that are forces or accelerations of the base, and sensors.
    path
        File to write, ending in `.fmu`.
    step_s
        Step that the unit proposes [s].

    Returns
    -------
    The model in the unit, which names its variables.

    Raises
    ------
    FmuError
        Where the model lists no sensors, or an input or effect needs a whole record.
    """
    from pythonfmu.builder import FmuBuilder  # an extra of its own

    if not description.sensors:
        raise FmuError(
            f"{description.name} lists no sensors. Say under `sensors` what to hear."
        )
    try:
        model = CoSimulatedModel(description)
    except ValueError as error:
        raise FmuError(str(error)) from error
    name = _identifier(description.name)
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / f"slave_{name}.py"
        script.write_text(SCRIPT.format(name=name), encoding="utf-8")
        # The parent of the script is copied as it is, but PythonFMU looks for the model beside
        # the copy of the script, so that both files are named.
        parts = [Path(folder) / "model.json", Path(folder) / "step_s.txt"]
        parts[0].write_text(model_file_of(description).model_dump_json(), encoding="utf-8")
        parts[1].write_text(repr(step_s), encoding="ascii")
        before = list(sys.path)
        try:
            FmuBuilder.build_FMU(script, dest=path, project_files=parts)
        finally:
            # PythonFMU puts the folder of the script on the path and leaves it there.
            sys.path[:] = before
            sys.modules.pop(script.stem, None)
    return model


def _identifier(name: str) -> str:
    """Return a name that C and Python accept."""
    found = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return found if found and not found[0].isdigit() else f"model_{found}".rstrip("_")
