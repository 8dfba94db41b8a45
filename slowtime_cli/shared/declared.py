"""Options of a verb, read off the class in which the arithmetic declares them.

The class is a frozen dataclass whose docstring describes each field. Name, type, default and
help of an option are those of the field, so that the command line says what Python says.
"""

import dataclasses
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import click

from slowtime.identification.options import FileName
from slowtime_api.declared import alternatives, parameter_entries

from .flags import EXISTING
from .options import POSITIVE, Real

F = TypeVar("F", bound=Callable[..., Any])
O = TypeVar("O")


def options_of(declared: type[Any]) -> Callable[[F], F]:
    """Add an option for each field of a class of options.

    Parameters
    ----------
    declared
        Frozen dataclass with defaults; its docstring has an entry for each field.

    Returns
    -------
    Decorator of a verb.
    """
    help_of = parameter_entries(declared)
    types_of = typing.get_type_hints(declared)
    made = [
        click.option(
            "--" + field.name.replace("_", "-"),
            default=field.default,
            help=help_of[field.name],
            **_kind(types_of[field.name], field.name),
        )
        for field in dataclasses.fields(declared)
    ]

    def decorate(function: F) -> F:
        for option in reversed(made):
            function = option(function)
        return function

    return decorate


def gathered(declared: type[O], flags: dict[str, Any]) -> O:
    """Take the fields of a class of options out of the flags of a verb.

    Parameters
    ----------
    declared
        Frozen dataclass.
    flags
        Flags by name; those taken are removed.

    Returns
    -------
    The options.
    """
    names = [field.name for field in dataclasses.fields(declared)]  # type: ignore[arg-type]
    return declared(**{name: flags.pop(name) for name in names})


def _kind(declared: Any, name: str) -> dict[str, Any]:
    """Type, number and metavar of an option."""
    given = [one for one in alternatives(declared) if one is not types.NoneType]
    if FileName in given:
        return {"type": EXISTING}
    (kind,) = given
    if typing.get_origin(kind) is typing.Literal:
        return {"type": click.Choice(typing.get_args(kind)), "show_default": True}
    if kind == tuple[float, float]:
        return {"type": Real(), "nargs": 2, "metavar": "LO HI"}
    if kind is float:
        return {"type": POSITIVE}
    raise TypeError(f"{name}: there is no option of type {kind}. Declare another in _kind.")
