"""Functions that take the fields of a class of options as their keywords."""

import functools
import inspect
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar, cast, get_type_hints

from .argument_checks import bind, checked_value, parameter_block, parameter_entries

P = ParamSpec("P")
O = TypeVar("O")
S = TypeVar("S")
R = TypeVar("R")


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
            signature = inspect.signature(called)
            bound = bind(signature, function.__name__, given, keywords).arguments
            about = bound.pop(subject)
            kinds, said = _kinds(function), parameter_entries(called)
            about = checked_value(about, kinds[subject], subject, said.get(subject, ""))
            return function(about, cast(Any, declared)(**_checked(declared, bound)))

        _describe(called, function, declared)
        return cast(Callable[Concatenate[S, P], R], called)

    return decorate


@functools.cache
def _kinds(declared: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(declared, include_extras=True)


def _checked(declared: Callable[..., Any], keywords: dict[str, Any]) -> dict[str, Any]:
    """Return keywords as their types have them, or say what is allowed."""
    kinds, said = _kinds(declared), parameter_entries(declared)
    return {
        name: checked_value(value, kinds[name], name, said[name])
        for name, value in keywords.items()
    }


def _describe(called: Any, function: Callable[..., Any], declared: Callable[..., Any]) -> None:
    """Put the options into signature and docstring, behind the subject."""
    own, options = inspect.signature(function), inspect.signature(declared)
    subject, *_ = own.parameters.values()
    called.__signature__ = own.replace(parameters=[subject, *options.parameters.values()])
    told = inspect.cleandoc(function.__doc__ or "")
    called.__doc__ = told.replace(
        "\n\nReturns\n", f"\n{parameter_block(declared)}\n\nReturns\n", 1
    )
