"""Checks of arguments against their annotations: what was given, what is allowed, what to do.

The module imports no arrays, so that light verbs may use it; checks of arrays import them when
an argument is one.
"""

import dataclasses
import functools
import inspect
import math
import os
import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

P = ParamSpec("P")
R = TypeVar("R")

_PARAMETERS = re.compile(r"Parameters\n-+\n(.*?)(?=\n\n\S|\Z)", re.DOTALL)
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 80
_CALLABLE = get_origin(Callable[[], None])


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Range of a number, as metadata of its annotation.

    Parameters
    ----------
    above, below
        Limits that are not allowed themselves.
    least, most
        Limits that are allowed.

    Examples
    --------
    >>> Bounds(above=0, most=1).words
    'above 0 and at most 1'
    >>> Bounds(least=2).holds(1)
    False
    """

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    below: float = math.inf

    def holds(self, value: float) -> bool:
        """Whether a number lies within."""
        return self.above < value < self.below and self.least <= value <= self.most

    def __repr__(self) -> str:
        return self.words

    @property
    def words(self) -> str:
        """The range in words; empty where there is none."""
        said = [
            f"{word} {limit:g}"
            for word, limit in (
                ("above", self.above), ("from", self.least), ("at most", self.most),
                ("below", self.below),
            )
            if math.isfinite(limit)
        ]  # fmt: skip
        return " and ".join(said)


@dataclasses.dataclass(frozen=True, slots=True)
class FiniteArray:
    """Dimensions of an array of finite real numbers, as metadata of its annotation."""

    dimensions: int


Positive = Annotated[float, Bounds(above=0)]
"""A number above 0."""
NotNegative = Annotated[float, Bounds(least=0)]
"""A number from 0."""
Share = Annotated[float, Bounds(least=0, most=1)]
"""A number from 0 to 1."""
Count = Annotated[int, Bounds(least=1)]
"""A whole number from 1."""
Vector = Annotated[Any, FiniteArray(1)]
"""A series of finite numbers, or whatever NumPy makes one of."""
Matrix = Annotated[Any, FiniteArray(2)]
"""A matrix of finite numbers, or whatever NumPy makes one of."""


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Check each argument of a function against its annotation before it runs.

    Numbers are finite, real and no booleans; arrays, sequences and mappings hold such numbers
    or texts; choices are among those of a `Literal`; other classes by `isinstance`. `Bounds`
    and `FiniteArray` of an annotation are kept. Parameters without annotation are taken as
    they are. Meanings in messages are those of the docstring.

    Parameters
    ----------
    function
        Function or method with annotations and a docstring in the style of NumPy.

    Returns
    -------
    The function with its checks.

    Examples
    --------
    >>> @checked
    ... def sampled(rate_hz: Positive) -> float:
    ...     '''Sample.
    ...
    ...     Parameters
    ...     ----------
    ...     rate_hz
    ...         Samples per second [Hz].
    ...     '''
    ...     return 1.0 / rate_hz
    >>> sampled(4)
    0.25
    >>> sampled(-1)
    Traceback (most recent call last):
    ValueError: rate_hz=-1 was given. Give a number above 0: Samples per second [Hz].
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def called(*given: P.args, **named: P.kwargs) -> R:
        bound = bind(signature, function.__qualname__, given, named)
        kinds, said = _declared_by(function)
        for name, value in bound.arguments.items():
            if name not in kinds:
                continue
            kind, meaning = kinds[name], said.get(name, "")
            if signature.parameters[name].kind is inspect.Parameter.VAR_POSITIONAL:
                bound.arguments[name] = tuple(
                    checked_value(one, kind, name, meaning) for one in value
                )
            else:
                bound.arguments[name] = checked_value(value, kind, name, meaning)
        return function(*bound.args, **bound.kwargs)

    return called


@functools.cache
def _declared_by(function: Callable[..., Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return annotations and meanings of parameters; read when they are first needed."""
    kinds = get_type_hints(function, include_extras=True)
    kinds.pop("return", None)
    said = parameter_entries(function)
    if function.__name__ == "__init__":
        owner = function.__globals__.get(function.__qualname__.partition(".")[0])
        said = parameter_entries(owner) if owner is not None else said
    return kinds, said


def bind(
    signature: inspect.Signature, name: str, given: Sequence[Any], named: Mapping[str, Any]
) -> inspect.BoundArguments:
    """Bind arguments to a signature.

    Raises
    ------
    TypeError
        If one is missing, unknown or too many; the message lists the arguments.
    """
    try:
        return signature.bind(*given, **named)
    except TypeError as error:
        known = [one for one in signature.parameters if one not in ("self", "cls")]
        raise TypeError(
            f"{name.removesuffix('.__init__')}: {error}. Its arguments: {', '.join(known)}."
        ) from None


def checked_value(value: Any, declared: Any, name: str, meaning: str) -> Any:
    """Return a value as its annotation has it.

    Parameters
    ----------
    value
        What was given.
    declared
        Annotation.
    name
        Name of the argument.
    meaning
        What it is, for messages.

    Returns
    -------
    The value; numbers as `float` or `int`, sequences as lists or tuples.

    Raises
    ------
    TypeError
        If it is of another type.
    ValueError
        If it is of the type, and out of range.

    Examples
    --------
    >>> checked_value(2, float | None, "length_m", "m")
    2.0
    """
    kinds = [one for one in alternatives(declared) if one is not NoneType]
    if value is None and len(kinds) < len(alternatives(declared)):
        return None
    refused: list[TypeError | ValueError] = []
    for kind in kinds:
        try:
            return _of_kind(value, kind, name, meaning)
        except (TypeError, ValueError) as error:
            refused.append(error)
    ranges = [error for error in refused if isinstance(error, ValueError)]
    if len(refused) == 1 or ranges:
        raise (ranges or refused)[0]
    allowed = " or ".join(dict.fromkeys(_words(kind) for kind in kinds))
    made_by = next((kind.MADE_BY for kind in kinds if hasattr(kind, "MADE_BY")), "")
    advice = f" {made_by} makes one." if made_by else ""
    raise TypeError(_message(value, name, allowed, meaning) + advice)


def _of_kind(value: Any, kind: Any, name: str, meaning: str) -> Any:
    """Return a value as one alternative of its annotation has it."""
    if get_origin(kind) is Annotated:
        return _annotated(value, kind, name, meaning)
    if kind is Any:
        return value
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        if any(isinstance(value, type(one)) and value == one for one in inner):
            return value
        raise ValueError(
            f"{name}={_SHORT.repr(value)} was given. Allowed: {', '.join(map(str, inner))}."
        )
    if kind is bool:
        return _truth(value, name, meaning)
    if kind is int:
        return whole(value, name, 0)
    if kind is float:
        return finite_number(value, name, meaning)
    if origin in (list, tuple, Sequence, Mapping):
        return _many(value, kind, name, meaning)
    if isinstance(value, _class_of(kind)):
        return value
    made_by = getattr(kind, "MADE_BY", "")
    advice = f" {made_by} makes one." if made_by else ""
    raise TypeError(_message(value, name, _words(kind), meaning) + advice)


def _class_of(kind: Any) -> Any:
    if get_origin(kind) is _CALLABLE:
        return _CALLABLE
    found = get_origin(kind) or kind
    return os.PathLike if hasattr(found, "__fspath__") else found


def _annotated(value: Any, kind: Any, name: str, meaning: str) -> Any:
    base, *notes = get_args(kind)
    for note in notes:
        if isinstance(note, FiniteArray):
            return _array(value, note, name, meaning)
    if base is int:
        least = next((one.least for one in notes if isinstance(one, Bounds)), 0)
        return whole(value, name, int(least))
    found = checked_value(value, base, name, meaning)
    for note in notes:
        if isinstance(note, Bounds) and not all(
            note.holds(one) for one in (found if isinstance(found, list | tuple) else [found])
        ):
            raise ValueError(_message(value, name, f"a number {note.words}", meaning))
    return found


def _many(value: Any, kind: Any, name: str, meaning: str) -> Any:
    """Return the members of a sequence, a pair or a mapping, each of its own kind."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise TypeError(
                _message(value, name, "values by name, as in {'name': ...}", meaning)
            )
        return {
            checked_value(key, inner[0], f"a key of {name}", meaning): checked_value(
                one, inner[1], f"{name}[{key!r}]", meaning
            )
            for key, one in value.items()
        }
    if origin is tuple and inner == (float, float):
        return tuple(finite_number(one, name, meaning) for one in pair(value, name, meaning))
    if origin is tuple and Ellipsis not in inner:
        return _fixed(value, inner, name, meaning)
    if inner[0] is str:
        return texts(value, name)
    plain = isinstance(value, str | bytes | Mapping) or not hasattr(value, "__len__")
    if plain or not hasattr(value, "__getitem__"):
        raise TypeError(_message(value, name, f"a list of {_words(inner[0])}", meaning))
    found = [
        checked_value(value[i], inner[0], f"{name}[{i}]", meaning) for i in range(len(value))
    ]
    return tuple(found) if origin is tuple else found


def _fixed(value: Any, kinds: Sequence[Any], name: str, meaning: str) -> tuple[Any, ...]:
    """Return a sequence of as many values as there are kinds, each of its own kind."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sequence):
        raise TypeError(_message(value, name, f"{len(kinds)} values", meaning))
    if len(value) != len(kinds):
        raise ValueError(_message(value, name, f"{len(kinds)} values", meaning))
    return tuple(
        checked_value(one, kind, f"{name}[{i}]", meaning)
        for i, (one, kind) in enumerate(zip(value, kinds, strict=True))
    )


def _array(value: Any, wanted: FiniteArray, name: str, meaning: str) -> Any:
    """Return an array of finite real numbers."""
    import numpy as np

    shape = {1: "a series", 2: "a matrix"}[wanted.dimensions]
    dense = value.toarray() if hasattr(value, "toarray") else value
    try:
        found = np.asarray(dense)
        real = found.dtype.kind in "iuf" or (found.dtype.kind == "O" and found.size > 0)
        found = found.astype(float) if real else found
    except (TypeError, ValueError):
        real = False
    if not real or isinstance(value, str | bytes):
        raise TypeError(_message(value, name, f"{shape} of real numbers", meaning))
    if found.ndim != wanted.dimensions or not found.size:
        raise ValueError(
            f"{name} of shape {found.shape} was given. Give {shape} of real numbers"
            f"{_colon(meaning)}"
        )
    wrong = int((~np.isfinite(found)).sum())
    if wrong:
        raise ValueError(
            f"{name} with {wrong} values that are not finite was given. Give {shape} of finite "
            f"numbers{_colon(meaning)}"
        )
    return found


def _truth(value: Any, name: str, meaning: str) -> bool:
    if isinstance(value, bool) or _is_truth(value):
        return bool(value)
    raise TypeError(_message(value, name, "True or False", meaning))


def _is_truth(value: Any) -> bool:
    """Whether a value is a boolean, of Python or NumPy."""
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    return isinstance(value, bool) or kind == "b"


def _words(kind: Any) -> str:
    """Say in words what a kind allows."""
    if len(alternatives(kind)) > 1:
        return " or ".join(_words(one) for one in alternatives(kind) if one is not NoneType)
    if get_origin(kind) is Annotated:
        return _words(get_args(kind)[0])
    origin = get_origin(kind) or kind
    plain = {
        str: "a text", float: "a number", int: "a whole number", Any: "numbers",
        Mapping: "a mapping",
    }  # fmt: skip
    if hasattr(origin, "__fspath__"):
        return "a path"
    if origin in (Sequence, list, tuple):
        return f"a list of {_words(get_args(kind)[0])}"
    return plain.get(origin, getattr(origin, "__name__", str(origin)))


def _message(value: Any, name: str, allowed: str, meaning: str) -> str:
    """Say what was given, what is allowed and what it means."""
    plain = isinstance(value, str | bytes | int | float | complex | list | tuple | dict | None)
    given = f"{name}={_SHORT.repr(value)}"
    if not plain:
        given = f"{name} of type {type(value).__name__}"
    return f"{given} was given. Give {allowed}{_colon(meaning)}"


def _colon(meaning: str) -> str:
    return f": {meaning.rstrip('.')}." if meaning else "."


def alternatives(declared: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the type itself."""
    union = get_origin(declared) in (Union, UnionType)
    return get_args(declared) if union else (declared,)


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
    found = re.findall(
        r"^([\w*][\w, *]*)\n((?:    .*\n?)+)", parameter_block(declared) + "\n", re.M
    )
    plain = {
        name.strip(" *"): re.sub(r"``?(.*?)``?", r"\1", " ".join(said.split()))
        for names, said in found
        for name in names.split(",")
    }
    return plain


def parameter_block(declared: Callable[..., Any]) -> str:
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
        If it is no single real number, or a boolean.

    Examples
    --------
    >>> from fractions import Fraction
    >>> number(Fraction(5, 2), "rate_hz", "Hz > 0")
    2.5
    """
    shaped = bool(getattr(value, "shape", ()))
    if not isinstance(value, str | bytes | complex) and not shaped and not _is_truth(value):
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            pass
    raise TypeError(_message(value, name, "one number", allowed))


def finite_number(value: Any, name: str, meaning: str) -> float:
    """Return one finite real number.

    Raises
    ------
    TypeError
        If it is no single real number, or a boolean.
    ValueError
        If it is infinite or NaN.

    Examples
    --------
    >>> finite_number(2, "length_m", "m")
    2.0
    """
    found = number(value, name, meaning)
    if not math.isfinite(found):
        raise ValueError(_message(value, name, "a finite number", meaning))
    return found


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
    raise TypeError(_message(value, name, "two numbers", meaning))


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
        raise ValueError(_message(value, name, f"a whole number from {least}", ""))
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
    raise TypeError(_message(value, name, "a text, or a list of texts", ""))


def _is_whole(value: Any) -> bool:
    return hasattr(value, "__index__") and not isinstance(value, bool)
