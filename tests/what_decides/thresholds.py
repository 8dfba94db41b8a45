"""Thresholds of the search: found in its modules, and given other values."""

import ast
import importlib
import inspect
import itertools
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

from slowtime.discrepancy.thresholds import LIMITS, Limits

from .steps import PACKAGE


@dataclass(frozen=True, order=True)
class Change:
    """A threshold that is halved or doubled.

    Parameters
    ----------
    module, name
        Where it is defined: a constant of a module, or a field of `LIMITS`.
    factor
        0.5 or 2. Of a probability above one half, the distance from one is multiplied.
    """

    module: str
    name: str
    factor: float

    @property
    def threshold(self) -> str:
        """Name in the table."""
        return f"{self.module.removeprefix(PACKAGE + '.')}: {self.name}"

    @property
    def label(self) -> str:
        """Name of the change."""
        return f"{self.threshold} x {self.factor:g}"


def changes() -> list[Change]:
    """List every threshold of the search, halved and doubled."""
    every = [(LIMITS.__module__, field.name) for field in fields(Limits)]
    for module in _modules():
        every += [(module.__name__, name) for name in _constants(module)]
    return [Change(module, name, factor) for module, name in every for factor in (0.5, 2.0)]


def _modules() -> Iterator[Any]:
    package = importlib.import_module(PACKAGE)
    for info in pkgutil.walk_packages(package.__path__, PACKAGE + "."):
        yield importlib.import_module(info.name)


def _constants(module: Any) -> Iterator[str]:
    """Names of numbers in a module that a docstring with a source follows.

    None that compiled functions use: those keep what they were compiled with.
    """
    body = ast.parse(inspect.getsource(module)).body
    frozen = {
        part.id
        for one in body
        if isinstance(one, ast.FunctionDef) and one.decorator_list
        for part in ast.walk(one)
        if isinstance(part, ast.Name)
    }
    for here, after in itertools.pairwise(body):
        if not (isinstance(here, ast.Assign) and isinstance(here.targets[0], ast.Name)):
            continue
        told = after.value if isinstance(after, ast.Expr) else None
        value = getattr(module, here.targets[0].id)
        sourced = isinstance(told, ast.Constant) and "Source" in str(told.value)
        if sourced and _is_number(value) and here.targets[0].id not in frozen:
            yield here.targets[0].id


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def changed(value: float, factor: float) -> float:
    """Give a threshold multiplied by a factor; whole numbers stay whole and at least 1."""
    if isinstance(value, int):
        return max(1, round(value * factor))
    if 0.5 < value < 1.0:
        return 1.0 - (1.0 - value) * factor
    return value * factor


@contextmanager
def with_changes(given: Iterable[Change]) -> Iterator[None]:
    """Let thresholds have other values, wherever they were imported to."""
    undo: list[tuple[Any, str, Any]] = []
    try:
        for change in given:
            if change.module == LIMITS.__module__:
                value = getattr(LIMITS, change.name)
                undo.append((LIMITS, change.name, value))
                _put(LIMITS, change.name, changed(value, change.factor))
                continue
            value = vars(sys.modules[change.module])[change.name]
            for module in _holders(change.name, value):
                undo.append((module, change.name, value))
                _put(module, change.name, changed(value, change.factor))
        yield
    finally:
        for holder, name, value in reversed(undo):
            _put(holder, name, value)


def _holders(name: str, value: object) -> list[Any]:
    """Modules of the package in which a name has a value."""
    own = [m for key, m in sys.modules.items() if key.startswith(PACKAGE)]
    return [module for module in own if vars(module).get(name) is value]


def _put(holder: object, name: str, value: float) -> None:
    """Give a module or the frozen limits another value."""
    if isinstance(holder, Limits):
        object.__setattr__(holder, name, value)
    else:
        setattr(holder, name, value)
