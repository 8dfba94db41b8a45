"""Problems of `slowtime.design`, read from design files."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from slowtime.design import (
    AddedStructure,
    Addition,
    Constraint,
    DesignProblem,
    HarmonicLoad,
    NoiseLoad,
    RecordedLoad,
    Response,
    Responses,
    Variable,
)
from slowtime.dynamics.description import Description
from slowtime.dynamics.elements import BASE
from slowtime.dynamics.random_vibration import kanai_tajimi, low_pass
from slowtime.reliability import Marginal, Problem, marginal
from slowtime_schemas.files.design import DesignFile, DesignLoad, DesignResponse, DesignVariable
from slowtime_services.documents.yaml_lines import Path
from slowtime_services.models.model_reader import ModelFileError, read_description

from .checked_file import line_of, parse_checked, read_text
from .expressions import Expression
from .reliability import copula_of, correlations_of, law_of

INTENSITY = "load.intensity"
NO_INPUT = "nothing.scatters"
"""Stands in where a file has no random input."""

DEFAULT_RUNS = 300
"""Runs of a model under a recorded load that surrogates are learnt from."""

Rows = Callable[[np.ndarray, np.ndarray], np.ndarray]
ReadSamples = Callable[[pathlib.Path, str | None, float | None], tuple[np.ndarray, float]]
"""From a record's path, channel and rate to samples in SI and their rate [Hz]."""


class DesignFileError(ValueError):
    """A design file that cannot be used; the text names line and cure."""


@dataclasses.dataclass(frozen=True)
class DesignTask:
    """Problem of a design file.

    Parameters
    ----------
    name
        Of the file's owner.
    responses
        The model's responses, as rows; None without a model.
    runs
        Runs that surrogates may be learnt from; None to use the responses themselves.
    structure
        The model with what is added; None without one.
    """

    name: str
    inputs: Problem
    variables: Mapping[str, Variable]
    formulas: Mapping[str, Expression]
    accepted: Mapping[str, float]
    alpha: float
    unit_costs: tuple[float, ...]
    responses: Rows | None
    response_names: tuple[str, ...]
    runs: int | None
    structure: AddedStructure | None

    def problem(self, responses: Rows | None = None) -> DesignProblem:
        """Return the design problem, with these responses in place of the model's own."""
        rows = self.responses if responses is None else responses
        return DesignProblem(
            self.variables,
            self.inputs,
            self._function("objective", rows),
            {
                name: Constraint(self._function(name, rows), probability)
                for name, probability in self.accepted.items()
            },
            self.alpha,
        )

    def with_alpha(self, alpha: float) -> "DesignTask":
        """Return the same task with another weight of the mean."""
        return dataclasses.replace(self, alpha=alpha)

    def _function(
        self, name: str, rows: Rows | None
    ) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        formula = self.formulas[name]
        random = [place for place, key in enumerate(self.inputs.names) if "." not in key]
        needs_rows = bool(formula.used & {*self.response_names})
        costs = np.array(self.unit_costs)

        def value(d: np.ndarray, x: np.ndarray) -> np.ndarray:
            columns = [d, x[:, random], (d @ costs)[:, None]]
            if self.response_names:
                filler = np.zeros((len(d), len(self.response_names)))
                assert rows is not None
                columns.append(rows(d, x) if needs_rows else filler)
            return formula(np.concatenate(columns, axis=1))

        return value


def read_design(path: str | pathlib.Path, read_samples: ReadSamples) -> DesignTask:
    """Read a design file (YAML or JSON), its model and the record of its load.

    Raises
    ------
    DesignFileError
        (a ValueError) naming line and cure. OSError where a file cannot be opened.
    """
    path = pathlib.Path(path)
    text = read_text(path, DesignFileError)
    file, lines = parse_checked(text, path.name, DesignFile, "design", DesignFileError)
    return _DesignFile(file, lines, path, read_samples).task()


class _DesignFile:
    """One design file, and the line of each key."""

    def __init__(
        self,
        file: DesignFile,
        lines: Mapping[Path, int],
        path: pathlib.Path,
        read_samples: ReadSamples,
    ) -> None:
        self.file, self.lines, self.path = file, lines, path
        self.read_samples = read_samples

    def at(self, where: Path, work: Callable[..., Any], *given: Any) -> Any:
        """Do something, and name the line of the file where it fails."""
        try:
            return work(*given)
        except ValueError as error:
            raise DesignFileError(
                f"{self.path.name}, line {line_of(where, self.lines)}: {error}"
            ) from None

    def task(self) -> DesignTask:
        """All that the file asks for."""
        file = self.file
        variables = {
            name: self.at(("variables", name), _variable, one)
            for name, one in file.variables.items()
        }
        description = self._description()
        scatter = {} if description is None else self._scatter(description)
        structure = self._structure(description, tuple(scatter))
        wanted = [response_of(one) for one in file.responses.values()]
        responses = None
        if structure is not None:
            assert file.load is not None
            load = self.at(("load",), self._load, file.load)
            responses = self.at(("responses",), Responses, structure, load, wanted)
        inputs = self._inputs(scatter, responses)
        names = (*file.variables, *self._named(inputs), "cost", *file.responses)
        formulas = {"objective": file.objective.formula} | {
            name: one.formula for name, one in file.limit_states.items()
        }
        parsed = {
            name: self.at(
                ("objective",) if name == "objective" else ("limit_states", name),
                Expression,
                said,
                names,
            )
            for name, said in formulas.items()
        }
        runs = file.surrogate_runs
        if runs is None and file.load is not None and file.load.kind == "record":
            runs = DEFAULT_RUNS
        return DesignTask(
            name=file.name or self.path.stem,
            inputs=inputs,
            variables=variables,
            formulas=parsed,
            accepted={name: one.probability for name, one in file.limit_states.items()},
            alpha=file.objective.alpha,
            unit_costs=tuple(one.unit_cost for one in file.variables.values()),
            responses=None if responses is None else _rows(responses, inputs, scatter),
            response_names=tuple(file.responses),
            runs=runs if responses is not None else None,
            structure=structure,
        )

    def _named(self, inputs: Problem) -> tuple[str, ...]:
        """Return the inputs that formulas may use: those named in the file."""
        return tuple(name for name in inputs.names if "." not in name)

    def _description(self) -> Description | None:
        if self.file.model is None:
            return None
        where = self.path.parent / self.file.model
        try:
            description = read_description(where)
        except FileNotFoundError:
            raise DesignFileError(
                f"{self.path.name}, line {line_of(('model',), self.lines)}: no file {where}. "
                "Give the model's path from the folder of the design file."
            ) from None
        except ModelFileError as error:
            raise DesignFileError(str(error)) from None
        if description.effects:
            raise DesignFileError(
                f"{where.name} holds nonlinear effects, and responses are those of the linear "
                "model. Leave `effects` out, or give limit states as formulas."
            )
        return description

    def _scatter(self, description: Description) -> dict[str, Marginal]:
        given = self.file.scatter
        if given is not None:
            return {
                name: self.at(("scatter", name), law_of, one) for name, one in given.items()
            }
        tolerance = description.tolerance
        if tolerance is None:
            return {}
        parts = AddedStructure(description, ()).parts
        return {
            name: marginal("lognormal", mean=1.0, sd=sd)
            for name, part in parts.items()
            if (sd := getattr(tolerance, part)) > 0.0
        }

    def _structure(
        self, description: Description | None, factors: Sequence[str]
    ) -> AddedStructure | None:
        if description is None:
            return None
        additions = {}
        for name, one in self.file.variables.items():
            if one.adds is None:
                continue
            between = self.at(("variables", name), _between, one, description)
            additions[name] = Addition(part=one.adds, between=between, name=name)
        places = [list(self.file.variables).index(name) for name in additions]
        added: AddedStructure = self.at(
            ("variables",),
            lambda: AddedStructure(description, list(additions.values()), factors, places),
        )
        return added

    def _load(self, load: DesignLoad) -> NoiseLoad | HarmonicLoad | RecordedLoad:
        if load.kind != "record":
            return load_of(load)
        assert load.file is not None
        where = self.path.parent / load.file
        samples, rate_hz = self.read_samples(where, load.channel, load.rate_hz)
        return RecordedLoad(samples=samples, rate_hz=rate_hz, node=_node(load))

    def _inputs(self, scatter: Mapping[str, Marginal], responses: Responses | None) -> Problem:
        file = self.file
        laws: dict[str, Any] = {
            name: self.at(("inputs", name), law_of, one) for name, one in file.inputs.items()
        }
        dependence = {}
        for number, group in enumerate(file.copulas):
            dependence[group.of] = self.at(("copulas", number), copula_of, group)
        if file.correlations:
            dependence |= self.at(
                ("correlations",), correlations_of, dict(laws), file.correlations
            )
        laws |= scatter
        if file.load is not None and file.load.intensity is not None:
            laws[INTENSITY] = self.at(("load", "intensity"), law_of, file.load.intensity)
        if responses is not None:
            names = list(file.responses)
            for place in responses.random_peaks:
                laws[f"peak.{names[place]}"] = marginal("uniform", lo=0.0, hi=1.0)
        if not laws:
            laws[NO_INPUT] = marginal("normal", mean=0.0, sd=1.0)
        made: Problem = self.at(
            ("copulas",), Problem, laws, lambda x: np.ones(len(x)), dependence
        )
        return made


def _rows(responses: Responses, inputs: Problem, scatter: Mapping[str, Marginal]) -> Rows:
    """Responses as a function of variables and inputs."""
    names = inputs.names
    factors = [names.index(name) for name in scatter]
    peaks = [place for place, name in enumerate(names) if name.startswith("peak.")]
    loud = names.index(INTENSITY) if INTENSITY in names else None

    def rows(d: np.ndarray, x: np.ndarray) -> np.ndarray:
        intensity = np.ones(len(d)) if loud is None else x[:, loud]
        return responses(d, x[:, factors], intensity, x[:, peaks])

    return rows


def _variable(one: DesignVariable) -> Variable:
    return Variable(lower=one.lower, upper=one.upper, start=one.start)


def _between(one: DesignVariable, description: Description) -> tuple[str, ...]:
    if one.node is not None:
        return (one.node,)
    if one.between is not None:
        return one.between
    for element in description.elements:
        if element.id == one.element:
            return element.between
    raise ValueError(
        f"No element is called {one.element!r}. Elements: "
        f"{', '.join(element.id for element in description.elements)}."
    )


def _node(load: DesignLoad) -> str | None:
    """Node on which a force acts; None for base acceleration."""
    return None if load.on == BASE else load.on


def load_of(load: DesignLoad) -> NoiseLoad | HarmonicLoad:
    """Make noise or a harmonic load from a file; a record has samples besides.

    Raises
    ------
    ValueError
        For a recorded load.
    """
    if load.kind == "harmonic":
        assert load.amplitude is not None
        assert load.frequency_hz is not None
        return HarmonicLoad(
            amplitude=load.amplitude, frequency_hz=load.frequency_hz, node=_node(load)
        )
    if load.kind == "record" or load.psd is None:
        raise ValueError("A recorded load was given. Give noise or a harmonic load.")
    shaping = None
    if load.kanai_tajimi is not None:
        ground = load.kanai_tajimi
        shaping = kanai_tajimi(ground.frequency_hz, ground.damping_ratio)
    elif load.low_pass_hz is not None:
        shaping = low_pass(load.low_pass_hz)
    return NoiseLoad(psd=load.psd, node=_node(load), shaping=shaping)


def response_of(one: DesignResponse) -> Response:
    """Make the response that a file asks for."""
    between = one.between or (BASE, one.node or BASE)
    return Response(
        quantity=one.quantity,
        between=between,
        element=one.element,
        statistic=one.statistic,
        duration_s=one.duration_s,
    )
