"""The class that PythonFMU runs: variables and steps of a model inside a unit.

It is imported by the Python of the program that runs the unit, which needs slowtime for it.
"""

from pathlib import Path
from typing import Any

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from slowtime_services.models import read_description

from .co_simulated_model import CoSimulatedModel, UnitVariable

MODEL, STEP = "model.json", "step_s.txt"
"""Files among the resources of a unit: the model, and the proposed step [s]."""


class ModelSlave(Fmi2Slave):  # type: ignore[misc]  # PythonFMU has no types
    """A model file as a slave of co-simulation; its subclass in a unit has the model's name.

    Parameters
    ----------
    given
        `instance_name`, and `resources`: the folder of the unit's resources.
    """

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        folder = Path(self.resources)
        description = read_description(folder / MODEL)
        self._model = CoSimulatedModel(description)
        self.description = f"slowtime model {description.name}"
        self.default_experiment = DefaultExperiment(
            step_size=float((folder / STEP).read_text(encoding="ascii"))
        )
        for k, one in enumerate(self._model.inputs):
            self._register(one, Fmi2Causality.input, *_input_access(self._model, k))
        for one in self._model.parameters:
            self._register(
                one, Fmi2Causality.parameter, *_parameter_access(self._model, one.name)
            )
        for k, one in enumerate(self._model.outputs):
            self._register(one, Fmi2Causality.output, *_output_access(self._model, k))

    def _register(self, one: UnitVariable, causality: Any, getter: Any, setter: Any) -> None:
        tunable = causality == Fmi2Causality.parameter
        self.register_variable(
            Real(
                one.name,
                causality=causality,
                variability=Fmi2Variability.tunable if tunable else Fmi2Variability.continuous,
                description=f"{one.meaning} [{one.unit}]",
                getter=getter,
                setter=setter,
            ),
            nested=False,
        )

    def setup_experiment(
        self, start_time: float, stop_time: float | None, tolerance: float | None
    ) -> None:
        """Start the model at the first instant [s] of the experiment."""
        self._model.start(start_time)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by a step [s]."""
        self._model.step(step_size)
        return True


def _input_access(model: CoSimulatedModel, index: int) -> tuple[Any, Any]:
    return lambda: model.input(index), lambda value: model.set_input(index, value)


def _parameter_access(model: CoSimulatedModel, name: str) -> tuple[Any, Any]:
    return lambda: model.parameter(name), lambda value: model.set_parameter(name, value)


def _output_access(model: CoSimulatedModel, index: int) -> tuple[Any, Any]:
    return lambda: model.output(index), None
