"""Problems of `slowtime.reliability`, read from YAML, JSON or Python files."""

import dataclasses
import importlib.util
import inspect
import pathlib
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

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
from slowtime_schemas.files.reliability import (
    CopulaOf,
    Correlation,
    RandomInput,
    ReliabilityFile,
)
from slowtime_services.documents.yaml_lines import Path

from .checked_file import line_of, parse_checked, read_text
from .expressions import Expression
from .stated import Stated


class ReliabilityFileError(ValueError):
    """A reliability file that cannot be used; the text names line and cure."""


def read_stated_problem(
    path: str | pathlib.Path, limit_state: str | pathlib.Path | None = None
) -> tuple[Problem, Stated]:
    """Read a problem from YAML, JSON or a Python file, and what its owner states of it.

    A Python file has them as its variables `problem` and `stated`, a `Stated`.

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
        module = _module(path)
        problem, stated = _named(module, path, "problem"), getattr(module, "stated", Stated())
        for name, value, kind in (("problem", problem, Problem), ("stated", stated, Stated)):
            if not isinstance(value, kind):
                raise ReliabilityFileError(
                    f"`{name}` of {path.name} is not a {kind.__module__}.{kind.__name__}."
                )
        return problem, stated
    text = read_text(path, ReliabilityFileError)
    own = None
    if limit_state is not None:
        own_path = pathlib.Path(limit_state)
        own = _named(_module(own_path), own_path, "g")
    file, lines = parse_checked(
        text, path.name, ReliabilityFile, "reliability", ReliabilityFileError
    )
    stated = _stated(file)
    if limit_state is not None:
        name = f"g of {pathlib.Path(limit_state).name} ≤ 0"
        stated = dataclasses.replace(stated, formula=name)
    return _problem(file, lines, path.name, own), stated


def _stated(file: ReliabilityFile) -> Stated:
    units = {name: one.unit for name, one in file.inputs.items() if one.unit}
    return Stated(
        name=file.name,
        failure=file.failure,
        period=file.period,
        accepted=file.accepted,
        units=units,
    )


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

    inputs = {key: at(("inputs", key), law_of, one) for key, one in file.inputs.items()}
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


def law_of(given: RandomInput) -> Marginal:
    """Marginal distribution that a file names.

    Raises
    ------
    ValueError
        For an unknown name, or parameters that do not fit it.
    """
    return marginal(given.marginal, **(given.__pydantic_extra__ or {}))


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


def _module(path: pathlib.Path) -> ModuleType:
    """Execute a Python file that its owner has named."""
    spec = importlib.util.spec_from_file_location(f"slowtime_own_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ReliabilityFileError(
            f"{path.name} is not a Python file. Give one that ends in .py."
        )
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ReliabilityFileError(
            f"{path.name} cannot be imported: {type(error).__name__}: {error}."
        ) from error
    return module


def _named(module: ModuleType, path: pathlib.Path, wanted: str) -> Any:
    if not hasattr(module, wanted):
        raise ReliabilityFileError(f"{path.name} has no `{wanted}`. Define it there.")
    return getattr(module, wanted)
