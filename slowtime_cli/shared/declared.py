"""Options of a verb, read off the class in which the arithmetic declares them.

The class is a frozen dataclass whose docstring describes each field. Name, type, default and
help of an option are those of the field, so that the command line says what Python says.
"""

import dataclasses
import types
import typing
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeVar

import click

from slowtime_services.argument_checks import alternatives, parameter_entries

from .help_pages import Rare
from .options import EXISTING, POSITIVE, Names, Real
from .settings import Setting, settings_option

F = TypeVar("F", bound=Callable[..., Any])
O = TypeVar("O")


def options_of(
    declared: type[Any],
    only: Collection[str] = (),
    *,
    settings: str = "",
    all_rare: bool = False,
) -> Callable[[F], F]:
    """Add an option for each field of a class of options.

    Parameters
    ----------
    declared
        Frozen dataclass with defaults; its docstring has an entry for each field. The metadata
        of a field may name its `flag` and `metavar`; such an option may be repeated. It says
        `rare` of a field that few need, which only the full help shows.
    only
        Fields that are options here; none for all.
    settings
        Option behind which rare fields are given as KEY=VALUE; empty where each is an option.
    all_rare
        Whether all fields are rare in this verb.

    Returns
    -------
    Decorator of a verb.
    """
    help_of = parameter_entries(declared)
    types_of = typing.get_type_hints(declared)
    rare: list[Setting] = []
    made: list[Callable[[Any], Any]] = []
    for field in dataclasses.fields(declared):
        if only and field.name not in only:
            continue
        names, told = _option(field, types_of[field.name], help_of[field.name])
        is_rare = all_rare or field.metadata.get("rare", False)
        if is_rare and settings:
            rare.append(Setting(names, **told))
        else:
            kind = Rare if is_rare else click.Option
            made.append(click.option(*names, cls=kind, **told))
    if rare:
        made.append(settings_option(*rare, flag=settings))

    def decorate(function: F) -> F:
        for option in reversed(made):
            function = option(function)
        return function

    return decorate


def _option(
    field: "dataclasses.Field[Any]", declared: Any, text: str
) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Names and declaration of an option, as `click.option` takes them."""
    flag = "--" + field.name.replace("_", "-")
    if "flag" in field.metadata:
        metavar = field.metadata["metavar"]
        return (field.metadata["flag"], field.name), {
            "multiple": True, "metavar": metavar, "help": text,
        }  # fmt: skip
    kind = _kind(declared, field.name)
    if kind["type"] is bool:
        flag = f"{flag}/--not-{flag[2:]}"
    return (flag,), {"default": field.default, "help": text, **kind}


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
    if any(hasattr(one, "__fspath__") for one in given):
        return {"type": EXISTING}
    (kind,) = given
    if typing.get_origin(kind) is typing.Literal:
        return {"type": click.Choice(typing.get_args(kind)), "show_default": True}
    if kind == Sequence[str]:
        return {"type": Names()}
    if kind == tuple[float, float]:
        return {"type": Real(), "nargs": 2, "metavar": "LO HI"}
    plain = {float: POSITIVE, int: click.IntRange(min=0), str: str, bool: bool}
    if kind in plain:
        return {"type": plain[kind]}
    raise TypeError(f"{name}: there is no option of type {kind}. Declare another in _kind.")
