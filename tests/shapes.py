"""Types and shapes of the calls of the house, looked at once on the way in and once out.

Of each function the first calls of every test are looked at, and of what a test repeats by the
thousand some of the rest: looking at all of them took a third of the time of the tests.
"""

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

FIRST, EVERY = 4, 32
"""How many calls of a function are looked at in each test, and which of those that follow."""

_OF_JAXTYPING = jaxtyping.jaxtyped
_LOOKED_AT = beartype(conf=BeartypeConf(violation_type=jaxtyping.TypeCheckError))
_OF_MANY_STEPS = inspect.CO_GENERATOR | inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR


@dataclasses.dataclass
class Test:
    """Which test is run."""

    number: int = 0

    def begins(self) -> None:
        """Look at the first calls again."""
        self.number += 1


@dataclasses.dataclass(slots=True)
class Calls:
    """How often a function was called in a test."""

    test: int = 0
    count: int = 0

    def one_more(self) -> bool:
        """Count a call; whether it is to be looked at."""
        if self.test != TEST.number:
            self.test, self.count = TEST.number, 0
        self.count += 1
        return self.count <= FIRST or not self.count % EVERY


TEST = Test()
_CALLS: dict[CodeType, Calls] = {}
_MADE: dict[CodeType, Calls] = {}


def speaks_of_arrays(hint: Any) -> bool:
    """Whether arrays are anywhere in an annotation; one that is not read yet may have some."""
    if isinstance(hint, str):
        return True
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return any(map(speaks_of_arrays, typing.get_args(hint)))


def _looked_at(plain: FunctionType) -> Callable[..., Any]:
    looked_at = _LOOKED_AT(plain)
    if not any(map(speaks_of_arrays, inspect.get_annotations(plain).values())):
        return looked_at

    @functools.wraps(plain)
    def alike(*args: Any, **kwargs: Any) -> Any:
        # Axes of one name are as long as each other within one call.
        with _OF_JAXTYPING("context"):
            return looked_at(*args, **kwargs)

    return alike


def _function(plain: FunctionType) -> Callable[..., Any]:
    if plain.__code__.co_flags & _OF_MANY_STEPS:
        return _looked_at(plain)
    # One within another is made anew, of the same code, in each call of that.
    within = "<locals>" in plain.__qualname__
    if within and not _MADE.setdefault(plain.__code__, Calls()).one_more():
        return plain
    looked_at: Callable[..., Any] | None = None
    calls = _CALLS.setdefault(plain.__code__, Calls())

    @functools.wraps(plain)
    def sampled(*args: Any, **kwargs: Any) -> Any:
        nonlocal looked_at
        if not calls.one_more():
            return plain(*args, **kwargs)
        # What is never called need not be read.
        looked_at = looked_at or _looked_at(plain)
        return looked_at(*args, **kwargs)

    return sampled


def wrapped(found: Any) -> Any:
    """A function, a method or a class, whose calls are looked at."""
    if isinstance(found, FunctionType):
        return _function(found)
    if isinstance(found, classmethod | staticmethod):
        return type(found)(wrapped(found.__func__))
    if isinstance(found, property):
        return property(
            *(part and wrapped(part) for part in (found.fget, found.fset, found.fdel))
        )
    if dataclasses.is_dataclass(found) and "__init__" in vars(found):
        type.__setattr__(found, "__init__", wrapped(vars(found)["__init__"]))
    return found


def jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    """As `jaxtyping.jaxtyped`, which looks at an argument twice a call and binds it by name."""
    return wrapped
