"""Types and shapes of every call of the house, looked at once on the way in and once out."""

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable
from types import FunctionType
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

_OF_JAXTYPING = jaxtyping.jaxtyped
_LOOKED_AT = beartype(conf=BeartypeConf(violation_type=jaxtyping.TypeCheckError))


def speaks_of_arrays(hint: Any) -> bool:
    """Whether arrays are anywhere in an annotation; one that is not read yet may have some."""
    if isinstance(hint, str):
        return True
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return any(map(speaks_of_arrays, typing.get_args(hint)))


def _function(plain: FunctionType) -> Callable[..., Any]:
    looked_at = _LOOKED_AT(plain)
    if not any(map(speaks_of_arrays, inspect.get_annotations(plain).values())):
        return looked_at

    @functools.wraps(plain)
    def alike(*args: Any, **kwargs: Any) -> Any:
        # Axes of one name are as long as each other within one call.
        with _OF_JAXTYPING("context"):
            return looked_at(*args, **kwargs)

    return alike


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
    """As `jaxtyping.jaxtyped`, which looks at an argument twice a call and binds it by name.

    Half of the time of the tests of arithmetic went into that.
    """
    return wrapped
