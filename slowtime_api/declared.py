"""Functions that take the fields of a class of options as their keywords."""

import functools
import inspect
import re
from collections.abc import Callable
from types import NoneType, UnionType
from typing import (
    Any,
    Concatenate,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

P = ParamSpec("P")
O = TypeVar("O")
S = TypeVar("S")
R = TypeVar("R")

_PARAMETERS = re.compile(r"Parameters\n-+\n(.*?)(?=\n\n\S|\Z)", re.DOTALL)


def takes(
    declared: Callable[P, O],
) -> Callable[[Callable[[S, O], R]], Callable[Concatenate[S, P], R]]:
    """Give a function of a subject and options the options' fields as keywords.

    Names, types, defaults and descriptions are those of the class of options, for people,
    editors and type checkers.

    Parameters
    ----------
    declared
        Frozen dataclass of options, keywords only.

    Returns
    -------
    Decorator.
    """

    def decorate(function: Callable[[S, O], R]) -> Callable[Concatenate[S, P], R]:
        subject = next(iter(inspect.signature(function).parameters))

        @functools.wraps(function)
        def called(*given: Any, **keywords: Any) -> R:
            if subject in keywords:
                given = (keywords.pop(subject), *given)
            if len(given) != 1:
                raise TypeError(
                    f"{function.__name__} takes {subject} and keywords; {len(given)} arguments "
                    "without a keyword were given."
                )
            return function(given[0], cast(Any, declared)(**_checked(declared, keywords)))

        _describe(called, function, declared)
        return cast(Callable[Concatenate[S, P], R], called)

    return decorate


def _checked(declared: Callable[..., Any], keywords: dict[str, Any]) -> dict[str, Any]:
    """Return keywords as their types have them, or say what is allowed."""
    types_of, said = get_type_hints(declared), parameter_entries(declared)
    return {
        name: _as_declared(value, types_of[name], name, said[name])
        if name in types_of and value is not None
        else value
        for name, value in keywords.items()
    }


def _as_declared(value: Any, declared: Any, name: str, meaning: str) -> Any:
    kinds = [one for one in alternatives(declared) if one is not NoneType]
    if len(kinds) != 1:
        if not any(isinstance(value, kind) for kind in kinds):
            names = " or ".join(kind.__name__ for kind in kinds)
            raise TypeError(f"{name}={value!r} was given. Give {names}: {meaning}")
        return value
    if get_origin(kinds[0]) is Literal:
        allowed = get_args(kinds[0])
        if value not in allowed:
            given = ", ".join(map(str, allowed))
            raise ValueError(f"{name}={value!r} was given. Allowed: {given}.")
        return value
    if kinds[0] == tuple[float, float]:
        # Imported here, for it takes arrays, and a command line has none to read.
        from .arguments import pair

        return pair(value, name, meaning)
    return value


def alternatives(declared: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the type itself."""
    union = get_origin(declared) in (Union, UnionType)
    return get_args(declared) if union else (declared,)


def _describe(called: Any, function: Callable[..., Any], declared: Callable[..., Any]) -> None:
    """Put the options into signature and docstring, behind the subject."""
    own, options = inspect.signature(function), inspect.signature(declared)
    subject, *_ = own.parameters.values()
    called.__signature__ = own.replace(parameters=[subject, *options.parameters.values()])
    told = inspect.cleandoc(function.__doc__ or "")
    called.__doc__ = told.replace("\n\nReturns\n", f"\n{_block(declared)}\n\nReturns\n", 1)


def parameter_entries(declared: Callable[..., Any]) -> dict[str, str]:
    """Return what a docstring says of each parameter, as plain text.

    Parameters
    ----------
    declared
        Class or function with a docstring in the style of NumPy.

    Returns
    -------
    Description by name, on one line.

    Examples
    --------
    >>> def sampled(rate_hz=1.0):
    ...     '''Sample.
    ...
    ...     Parameters
    ...     ----------
    ...     rate_hz
    ...         Samples per second
    ...         [Hz]; ``1`` by default.
    ...     '''
    >>> parameter_entries(sampled)
    {'rate_hz': 'Samples per second [Hz]; 1 by default.'}
    """
    found = re.findall(r"^(\w+)\n((?:    .*\n?)+)", _block(declared) + "\n", re.MULTILINE)
    plain = {name: " ".join(said.split()) for name, said in found}
    return {name: re.sub(r"``?(.*?)``?", r"\1", said) for name, said in plain.items()}


def _block(declared: Callable[..., Any]) -> str:
    found = _PARAMETERS.search(inspect.cleandoc(declared.__doc__ or ""))
    return found[1] if found else ""
