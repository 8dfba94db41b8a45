"""Reliability files, or Python files of their owner → a problem for `slowtime.reliability`."""

import importlib.util
import inspect
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from slowtime.reliability import (
    ClaytonCopula,
    Copula,
    FrankCopula,
    GumbelCopula,
    LimitState,
    Marginal,
    Problem,
    StudentCopula,
    System,
    correlated,
    marginal,
)
from slowtime_schemas.reliability_file import (
    CopulaOf,
    Correlation,
    RandomInput,
    ReliabilityFile,
)

from .expressions import Expression
from .models.lines import Path, YamlError, read_with_lines

MAX_BYTES = 1 << 20


class ReliabilityFileError(ValueError):
    """A reliability file that cannot be used; the text names line and cure."""


def read_problem(
    path: str | pathlib.Path, limit_state: str | pathlib.Path | None = None
) -> Problem:
    """Read a problem from YAML or JSON, or from the variable `problem` of a Python file.

    Parameters
    ----------
    limit_state
        Python file whose function ``g`` is the limit state, instead of a formula. Its
        arguments are inputs by name, or one array [sample input].

    Raises
    ------
    ReliabilityFileError
        (a ValueError) naming line and cure. OSError where a file cannot be opened.
    """
    path = pathlib.Path(path)
    if path.suffix == ".py":
        if limit_state is not None:
            raise ReliabilityFileError(
                f"{path.name} holds its own limit state. Leave --limit-state out."
            )
        problem = _executed(path, "problem")
        if not isinstance(problem, Problem):
            raise ReliabilityFileError(
                f"`problem` of {path.name} is no slowtime.reliability.Problem."
            )
        return problem
    if path.stat().st_size > MAX_BYTES:
        raise ReliabilityFileError(f"{path.name} is larger than 1 MiB. Is it a record?")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ReliabilityFileError(f"{path.name} is not UTF-8 text: {error}.") from None
    own = None if limit_state is None else _executed(pathlib.Path(limit_state), "g")
    return parse_problem(text, path.name, own)


def parse_problem(text: str, name: str, own: Callable[..., Any] | None = None) -> Problem:
    """Check the text of a reliability file; `name` is what errors call it."""
    try:
        values, lines = read_with_lines(text, ("marginal", "between", "of", "name"))
    except YamlError as error:
        raise ReliabilityFileError(f"{name}, line {error.line}: {error}") from None
    if not isinstance(values, dict):
        raise ReliabilityFileError(
            f"{name} is no reliability file. Begin it with `slowtime_reliability: 1`."
        )
    try:
        file = ReliabilityFile.model_validate(values)
    except ValidationError as error:
        told = sorted({fault_of(item, lines) for item in error.errors(include_url=False)})
        raise ReliabilityFileError(
            "\n".join(f"{name}, line {line}: {sentence}" for line, sentence in told[:8])
        ) from None
    return _problem(file, lines, name, own)


def _problem(
    file: ReliabilityFile,
    lines: Mapping[Path, int],
    name: str,
    own: Callable[..., Any] | None,
) -> Problem:
    def at(where: Path, work: Callable[..., Any], *given: Any) -> Any:
        try:
            return work(*given)
        except ValueError as error:
            raise ReliabilityFileError(
                f"{name}, line {line_of(where, lines)}: {error}"
            ) from None

    def law(given: RandomInput) -> Marginal:
        return marginal(given.marginal, **(given.__pydantic_extra__ or {}))

    inputs = {key: at(("inputs", key), law, one) for key, one in file.inputs.items()}
    dependence: dict[tuple[str, ...], Copula] = {}
    for number, group in enumerate(file.copulas):
        dependence[group.of] = at(("copulas", number), copula_of, group)
    if file.correlations:
        dependence |= at(("correlations",), correlations_of, inputs, file.correlations)
    limit_state: LimitState
    if own is not None:
        if file.limit_state is not None or file.parts:
            raise ReliabilityFileError(
                f"{name} holds a limit state, and --limit-state gives another. Give one."
            )
        limit_state = _by_name(own, tuple(inputs))
    elif file.system is not None:
        parts = {
            key: at(("parts", key), Expression, said, tuple(inputs))
            for key, said in file.parts.items()
        }
        limit_state = System(file.system, parts)
    elif file.limit_state is not None:
        limit_state = at(("limit_state",), Expression, file.limit_state, tuple(inputs))
    else:
        raise ReliabilityFileError(
            f"{name} has no limit state. Add `limit_state`, `system` with `parts`, or name a "
            "Python file by --limit-state."
        )
    problem: Problem = at(("copulas",), Problem, inputs, limit_state, dependence, file.invalid)
    return problem


def correlations_of(
    inputs: Mapping[str, Any], given: Sequence[Correlation]
) -> dict[tuple[str, ...], Copula]:
    """Copula of the inputs that correlations in a file join."""
    kinds = {kind for one in given for kind in one.given()}
    if len(kinds) > 1:
        raise ValueError(f"{', '.join(sorted(kinds))}: give all correlations in one kind.")
    kind = kinds.pop()
    pairs = {one.between: one.given()[kind] for one in given}
    return correlated(inputs, pairs, kind)  # type: ignore[arg-type]  # one of its literals


def copula_of(group: CopulaOf) -> Copula:
    """Copula that a file names."""
    if group.copula == "student":
        if group.freedom is None or group.correlation is None or group.theta is not None:
            raise ValueError("A student copula takes freedom and correlation, and no theta.")
        matrix = np.full((len(group.of), len(group.of)), group.correlation)
        np.fill_diagonal(matrix, 1.0)
        return StudentCopula(matrix, group.freedom)
    if group.theta is None or group.freedom is not None or group.correlation is not None:
        raise ValueError(f"A {group.copula} copula takes theta alone.")
    if group.copula == "clayton":
        return ClaytonCopula(group.theta)
    if len(group.of) != 2:
        raise ValueError(f"A {group.copula} copula joins two inputs, not {len(group.of)}.")
    return FrankCopula(group.theta) if group.copula == "frank" else GumbelCopula(group.theta)


def _by_name(own: Callable[..., Any], names: tuple[str, ...]) -> LimitState:
    """Limit state of points, from a function of inputs by name or of all at once."""
    wanted = tuple(inspect.signature(own).parameters)
    if set(wanted) <= set(names):
        places = [names.index(name) for name in wanted]
        return lambda x: own(*(x[:, place] for place in places))
    if len(wanted) == 1:
        return own
    raise ReliabilityFileError(
        f"g takes {', '.join(wanted)}. Give it inputs by name ({', '.join(names)}), or one "
        "array [sample input]."
    )


def _executed(path: pathlib.Path, wanted: str) -> Any:
    """Execute a Python file that its owner has named, and return one of its names."""
    spec = importlib.util.spec_from_file_location(f"slowtime_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ReliabilityFileError(f"{path.name} is no Python file. Give one that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ReliabilityFileError(
            f"{path.name} cannot be imported: {type(error).__name__}: {error}."
        ) from error
    if not hasattr(module, wanted):
        raise ReliabilityFileError(f"{path.name} has no `{wanted}`. Define it there.")
    return getattr(module, wanted)


def fault_of(item: Any, lines: Mapping[Path, int]) -> tuple[int, str]:
    """Line of a fault that pydantic has found in a file, and a sentence."""
    where = tuple(item["loc"])
    last = where[-1] if where else "file"
    if item["type"] == "extra_forbidden":
        return line_of(where, lines), f"unknown key `{last}`."
    if item["type"] == "missing":
        return line_of(where, lines), f"`{last}` is missing. Add it."
    said = item["msg"].removeprefix("Value error, ")
    return line_of(where, lines), f"`{last}`: {said}."


def line_of(where: Path, lines: Mapping[Path, int]) -> int:
    """Line of the place, or of the nearest one around it that the file has."""
    while where and where not in lines:
        where = where[:-1]
    return lines.get(where, 1)
