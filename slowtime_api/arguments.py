"""Checks of arguments: what was given, what is allowed, what to do."""

import contextlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pydantic import ValidationError

from slowtime_services.argument_checks import texts as texts

_FLAG = re.compile(r"(?<!slowtime diagnose )--[a-z][a-z-]*")
_CHANNEL = re.compile(r"--channel ([^\s=]+)=NAME")
_KEY = re.compile(r"--reading (\w+)(?:=(\w+))?")
_VALUES = {"yes": "True", "no": "False"}
_ARGUMENTS = {"--unit": "units", "sensitivity": "sensitivities", "--channel": "channels"}
"""Option of the command line → argument of `slowtime.read`, where the names differ."""


@contextlib.contextmanager
def fields_named(names: Mapping[str, str]) -> Iterator[None]:
    """Say in a sentence which argument a message model refuses.

    Parameters
    ----------
    names
        Field of the model → argument of the function, where they differ.

    Raises
    ------
    ValueError
        In place of a validation error.
    """
    try:
        yield
    except ValidationError as error:
        said = []
        for one in error.errors(include_url=False):
            place = ".".join(str(part) for part in one["loc"])
            given = f"{names.get(place, place)}={one['input']!r} was given. " if place else ""
            said.append(f"{given}{one['msg'].removeprefix('Value error, ').rstrip('.')}.")
        raise ValueError(" ".join(said)) from error


def real_samples(samples: Any) -> Float[np.ndarray, "..."]:
    """Convert what is like an array to real numbers.

    Parameters
    ----------
    samples
        Array, nested sequences, or columns of pandas or xarray. Masked values become NaN.

    Returns
    -------
    The same numbers in double precision, in the shape given.

    Raises
    ------
    ValueError
        If they are no real numbers, or rows differ in length.
    """
    advice = "Give real numbers: one row per instant and one column per channel"
    if isinstance(samples, np.ma.MaskedArray):
        samples = np.ma.filled(samples.astype(float), np.nan)
    try:
        values = np.asarray(samples)
        if values.dtype.kind == "O":
            values = values.astype(float)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"The samples, of type {type(samples).__name__}, are no array of numbers: "
            f"{str(error).rstrip('.')}. {advice}."
        ) from error
    if values.dtype.kind not in "biuf":
        raise ValueError(
            f"The samples are of type {values.dtype}. {advice}, and the measured signal "
            "itself, not its transform."
        )
    return values.astype(float, copy=False)


def names_of(samples: Any) -> tuple[str, ...] | None:
    """Return the names that a DataFrame or Series of pandas gives its columns; None if none."""
    if hasattr(samples, "columns"):
        return tuple(str(name) for name in samples.columns)
    if hasattr(samples, "index") and getattr(samples, "name", None) is not None:
        return (str(samples.name),)
    return None


def with_arguments(message: str) -> str:
    """Write the arguments of Python where a message names options of the command line.

    Examples
    --------
    >>> with_arguments("Map it with --channel x=NAME.")
    "Map it with channels={'x': 'NAME'}."
    >>> with_arguments("Give --rate-hz, or name the clock with --reading time_column.")
    'Give rate_hz, or name the clock with time_column.'
    >>> with_arguments("Give --reading wrapped=yes, or --reading repeated=keep.")
    "Give wrapped=True, or repeated='keep'."
    """
    message = _CHANNEL.sub(r"channels={'\1': 'NAME'}", message)
    unchecked = "--setting unchecked=yes"
    message = message.replace(unchecked, f"`slowtime diagnose {unchecked}`")
    message = _KEY.sub(_keyword, message)
    return _FLAG.sub(
        lambda flag: _ARGUMENTS.get(flag[0], flag[0][2:].replace("-", "_")), message
    )


def _keyword(key: "re.Match[str]") -> str:
    """Return the keyword of `slowtime.read` for a key of `--reading`."""
    name, value = _ARGUMENTS.get(key[1], key[1]), key[2]
    return name if value is None else f"{name}={_VALUES.get(value, repr(value))}"


def existing_file(path: Any) -> Path:
    """Return the path of a file that exists.

    Raises
    ------
    FileNotFoundError
        If there is none.
    IsADirectoryError
        If it is a folder.
    """
    found = Path(path)
    if found.is_dir():
        raise IsADirectoryError(f"{found} is a folder. Give a file.")
    if not found.exists():
        raise FileNotFoundError(
            f"There is no file {found.absolute()}. Give the path of a file that exists."
        )
    return found
