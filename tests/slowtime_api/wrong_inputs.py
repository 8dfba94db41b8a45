"""Wrong inputs of all public functions, made from their annotations."""

import inspect
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

import slowtime as st
from slowtime_services.argument_checks import Bounds, FiniteArray, alternatives

NAMED_LATER = 7
"""A number that is neither text, path, series nor class."""


class WrongInput(NamedTuple):
    """One call with one wrong argument."""

    function: str
    parameter: str
    call: Callable[..., Any]
    arguments: Mapping[str, Any]

    def __repr__(self) -> str:
        value = repr(self.arguments[self.parameter])[:30]
        return f"{self.function}({self.parameter}={value})"


def public_functions() -> Iterator[tuple[str, Callable[..., Any], Any]]:
    """Yield public functions and methods of classes of the interface, and their owners."""
    for name in st.__all__:
        one = getattr(st, name)
        if inspect.isfunction(one):
            yield name, one, None
        if not inspect.isclass(one) or not one.__module__.startswith("slowtime_api"):
            continue
        for member, value in vars(one).items():
            function = getattr(value, "__func__", value)
            if hasattr(function, "__deprecated__"):
                continue
            own = not member.startswith("_") or (
                member == "__init__" and "MADE_BY" in vars(one)
            )
            if own and inspect.isfunction(function):
                owner = one if isinstance(value, classmethod) else object.__new__(one)
                yield f"{name}.{member}", function, owner


def annotated_parameters(function: Callable[..., Any]) -> dict[str, Any]:
    """Return annotations of the parameters, those of options included."""
    inner = inspect.unwrap(function)
    hints = get_type_hints(inner, include_extras=True)
    found = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if name in ("self", "cls") or parameter.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        found[name] = hints.get(name, parameter.annotation)
    return found


def wrong_inputs(wanted: str | None = None) -> Iterator[WrongInput]:
    """Yield a call for each wrong value of each parameter of each public function, or one."""
    for name, function, owner in public_functions():
        if wanted not in (None, name):
            continue
        kinds = annotated_parameters(function)
        parameters = inspect.signature(function).parameters
        needed = {
            key: example(kind)
            for key, kind in kinds.items()
            if parameters[key].default is inspect.Parameter.empty
            and parameters[key].kind is not inspect.Parameter.VAR_POSITIONAL
        }
        for key, kind in kinds.items():
            several = parameters[key].kind is inspect.Parameter.VAR_POSITIONAL
            for value in wrong_values(kind):
                call = _bound(function, owner, key if several else None)
                yield WrongInput(name, key, call, needed | {key: value})
        if kinds and all(
            one.kind is not inspect.Parameter.VAR_KEYWORD for one in parameters.values()
        ):
            call = _bound(function, owner, None)
            yield WrongInput(name, "no_such_option", call, needed | {"no_such_option": 1})


def _bound(function: Callable[..., Any], owner: Any, several: str | None) -> Callable[..., Any]:
    before = () if owner is None else (owner,)

    def call(**arguments: Any) -> Any:
        more = (arguments.pop(several),) if several is not None else ()
        return function(*before, *more, **arguments)

    return call


def example(kind: Any) -> Any:
    """Return a value that an annotation allows."""
    kind = alternatives(kind)[0]
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _annotated_example(inner)
    if origin is Literal:
        return inner[0]
    if inner == (float, float):
        return (1.0, 2.0)
    if origin is Mapping:
        return {}
    if origin is tuple and Ellipsis not in inner:
        return tuple(map(example, inner))
    if origin in (Sequence, list, tuple):
        return [example(inner[0])]
    plain = {float: 1.0, int: 1, bool: True, str: "x", Any: np.zeros((9, 1)), Path: Path("x")}
    return plain[kind] if kind in plain else object.__new__(kind)


def _annotated_example(inner: tuple[Any, ...]) -> Any:
    base, *notes = inner
    for note in notes:
        if isinstance(note, FiniteArray):
            return np.eye(3) if note.dimensions == 2 else np.arange(3.0)
        if isinstance(note, Bounds) and base in (int, float):
            low = max(note.above, note.least)
            high = min(note.most, note.below)
            if math.isfinite(low) and math.isfinite(high):
                return base((low + high) / 2)
            return base(low + 1 if math.isfinite(low) else 1)
    return example(base)


def wrong_values(kind: Any) -> list[Any]:
    """Return values that an annotation does not allow."""
    every = alternatives(kind)
    if Any in every:
        return []
    kinds = [one for one in every if one is not NoneType]
    candidates = [value for one in kinds for value in _wrong_for(one)]
    if NoneType not in every:
        candidates.append(None)
    return [value for value in candidates if not any(_allowed(value, one) for one in kinds)]


def _wrong_for(kind: Any) -> list[Any]:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _wrong_annotated(inner)
    if origin is Literal:
        return ["furlong", NAMED_LATER]
    if kind is float:
        return ["3", True, math.nan, math.inf, [1.0], 1j]
    if kind is int:
        return ["3", True, 1.5, -1, math.nan]
    if kind is bool:
        return ["yes", 1, 0.0]
    if inner == (float, float):
        return [1.0, (1.0,), ("a", "b"), (math.nan, 1.0), (True, 2.0)]
    if origin is Mapping:
        return [NAMED_LATER, "ab", [1.0]]
    if origin in (Sequence, list, tuple) and inner[0] in (float, int):
        return [1.0, "ab", [math.nan], [True], [[1.0]]]
    if origin in (Sequence, list, tuple):
        return [NAMED_LATER, [3.5]]
    return [NAMED_LATER, 1.5, object()]


def _wrong_annotated(inner: tuple[Any, ...]) -> list[Any]:
    base, *notes = inner
    found: list[Any] = []
    for note in notes:
        if isinstance(note, FiniteArray):
            right = _annotated_example(inner)
            return [
                "ab", 1.0, right[None], np.full(right.shape, math.nan), right > 0, right + 1j,
                right.astype(str),
            ]  # fmt: skip
        limits = (note.above, note.below, note.least - 1, note.most + 1)
        finite = [one for one in limits if math.isfinite(one)]
        many = get_origin(base) is Sequence
        found += [[one] for one in finite] if many else finite
    return found + _wrong_for(base)


def _allowed(value: Any, kind: Any) -> bool:
    """Whether another alternative of a union allows a value."""
    origin = get_origin(kind)
    if origin is Annotated:
        return False
    if kind is str or (isinstance(kind, type) and hasattr(kind, "__fspath__")):
        return isinstance(value, str | os.PathLike)
    if origin in (Sequence, list, tuple) and get_args(kind)[0] is str:
        return isinstance(value, str)
    return False
