"""Thresholds of the search: found in its modules, and given other values."""

import ast
import importlib
import inspect
import itertools
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from .steps import PACKAGE


@dataclass(frozen=True, order=True)
class Change:
    """A threshold that is halved or doubled.

    Parameters
    ----------
    module, name
        Where it is defined: a constant of a module, or with a point a field of one.
    factor
        0.5 or 2. Of a probability above one half, the distance from one is multiplied; of a
        tuple, each number.
    """

    module: str
    name: str
    factor: float

    @property
    def threshold(self) -> str:
        """Name in the table."""
        within = self.module.removeprefix(f"{PACKAGE}.").removeprefix("slowtime.")
        return f"{within}: {self.name}"

    @property
    def label(self) -> str:
        """Name of the change."""
        return f"{self.threshold} x {self.factor:g}"


def changes(of: str = PACKAGE) -> list[Change]:
    """List every threshold of a package, halved and doubled."""
    every = [(module.__name__, name) for module in _modules(of) for name in _names(module)]
    return [Change(module, name, factor) for module, name in every for factor in (0.5, 2.0)]


def _modules(of: str) -> Iterator[Any]:
    package = importlib.import_module(of)
    for info in pkgutil.walk_packages(package.__path__, of + "."):
        yield importlib.import_module(info.name)


def _names(module: Any) -> Iterator[str]:
    """Names of thresholds in a module: numbers, tuples of them, and fields of such.

    Each is followed by a docstring with a source. None that compiled functions use: those keep
    what they were compiled with.
    """
    body = ast.parse(inspect.getsource(module)).body
    frozen = {
        part.id
        for one in body
        if isinstance(one, ast.FunctionDef) and one.decorator_list
        for part in ast.walk(one)
        if isinstance(part, ast.Name)
    }
    for here, after in itertools.pairwise([*body, ast.Pass()]):
        if not (isinstance(here, ast.Assign) and isinstance(here.targets[0], ast.Name)):
            continue
        name, told = here.targets[0].id, after.value if isinstance(after, ast.Expr) else None
        value = getattr(module, name)
        if is_dataclass(value) and type(value).__module__ == module.__name__:
            held = [(field.name, getattr(value, field.name)) for field in fields(value)]
            yield from (f"{name}.{own}" for own, each in held if _is_threshold(each))
        sourced = isinstance(told, ast.Constant) and "Source" in str(told.value)
        if sourced and _is_threshold(value) and name not in frozen:
            yield name


def _is_threshold(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(map(_is_threshold, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def changed(value: Any, factor: float) -> Any:
    """Give a threshold multiplied by a factor; whole numbers stay whole and at least 1."""
    if isinstance(value, tuple):
        return tuple(changed(each, factor) for each in value)
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
            name, _, own = change.name.partition(".")
            value = vars(sys.modules[change.module])[name]
            holders = [value] if own else _holders(name, value)
            if own:
                name, value = own, getattr(value, own)
            for holder in holders:
                undo.append((holder, name, value))
                _put(holder, name, changed(value, change.factor))
        yield
    finally:
        for holder, name, value in reversed(undo):
            _put(holder, name, value)


def _holders(name: str, value: object) -> list[Any]:
    """Modules of slowtime in which a name has a value."""
    own = [m for key, m in sys.modules.items() if key.startswith("slowtime.")]
    return [module for module in own if vars(module).get(name) is value]


def _put(holder: object, name: str, value: Any) -> None:
    """Give a module, or the fields of a frozen object, another value."""
    if is_dataclass(holder):
        object.__setattr__(holder, name, value)
    else:
        setattr(holder, name, value)
