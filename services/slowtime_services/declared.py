"""Functions that take the fields of a class of options as their keywords, and their checks."""

import functools
import inspect
import math
import re
from collections.abc import Callable, Sequence
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
    kind = kinds[0] if len(kinds) == 1 else None
    if kind is None and not any(isinstance(value, one) for one in kinds):
        allowed = " or ".join(one.__name__ for one in kinds)
        raise TypeError(f"{name}={value!r} was given. Give {allowed}: {meaning}")
    if get_origin(kind) is Literal and value not in get_args(kind):
        given = ", ".join(map(str, get_args(kind)))
        raise ValueError(f"{name}={value!r} was given. Allowed: {given}.")
    if kind == tuple[float, float]:
        return pair(value, name, meaning)
    if kind == Sequence[str]:
        return texts(value, name)
    if kind is int:
        return whole(value, name, 0)
    return number(value, name, meaning) if kind is float else value


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
    """Entries of the parameters; of a class, behind those of the classes that it extends."""
    owners = reversed(inspect.getmro(declared)) if inspect.isclass(declared) else (declared,)
    found = (_PARAMETERS.search(inspect.cleandoc(one.__doc__ or "")) for one in owners)
    return "\n".join(match[1] for match in found if match)


def number(value: Any, name: str, allowed: str) -> float:
    """Return one real number.

    Parameters
    ----------
    value
        What was given.
    name
        Name of the argument.
    allowed
        What is allowed, for the message.

    Returns
    -------
    The number; infinite and NaN ones too.

    Raises
    ------
    TypeError
        If it is no single real number.

    Examples
    --------
    >>> from fractions import Fraction
    >>> number(Fraction(5, 2), "rate_hz", "Hz > 0")
    2.5
    """
    if not isinstance(value, str | bytes | complex) and not getattr(value, "shape", ()):
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            pass
    raise TypeError(f"{name}={value!r} was given. Give one number: {allowed}.")


def pair(value: Any, name: str, meaning: str) -> tuple[float, float]:
    """Return two real numbers.

    Raises
    ------
    TypeError
        If they are not two numbers.

    Examples
    --------
    >>> pair([1, 5], "band_hz", "lowest and highest frequency")
    (1.0, 5.0)
    """
    if not isinstance(value, str | bytes) and hasattr(value, "__len__") and len(value) == 2:
        first, second = (number(one, name, meaning) for one in value)
        return first, second
    raise TypeError(f"{name}={value!r} was given. Give two numbers: {meaning}.")


def whole(value: Any, name: str, least: int) -> int:
    """Return a whole number.

    Raises
    ------
    TypeError
        If it is no number.
    ValueError
        If it is not whole, or less than `least`.

    Examples
    --------
    >>> whole(2.0, "elements", 2)
    2
    """
    found = number(value, name, f"a whole number from {least}")
    if not (math.isfinite(found) and found == int(found) >= least):
        raise ValueError(f"{name}={value!r} was given. Give a whole number from {least}.")
    return int(found)


def texts(value: Any, name: str) -> tuple[str, ...]:
    """Return one text or several as a tuple; numbers of columns become text.

    Parameters
    ----------
    value
        A text, or a sequence of texts and whole numbers.
    name
        Name of the argument.

    Raises
    ------
    TypeError
        If it is anything else.

    Examples
    --------
    >>> texts("acc", "channels"), texts(["x", 1], "channels")
    (('acc',), ('x', '1'))
    """
    many = [value] if isinstance(value, str) else value
    if isinstance(many, Sequence) or hasattr(many, "tolist"):
        found = list(many)
        if all(isinstance(one, str) or _is_whole(one) for one in found):
            return tuple(str(one) for one in found)
    raise TypeError(f"{name}={value!r} was given. Give a text, or a list of texts.")


def _is_whole(value: Any) -> bool:
    return hasattr(value, "__index__") and not isinstance(value, bool)
