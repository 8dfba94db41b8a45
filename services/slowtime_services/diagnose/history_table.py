"""The history of a feature, read from a table."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from slowtime.history_diagnosis import Covariate
from slowtime_services.documents.bounds import DATA, document_text
from slowtime_services.files import RecordError
from slowtime_services.files.binary.numpy_arrays import read_npz
from slowtime_services.reasons import reason_of

Series = Float[np.ndarray, " epoch"]
Quantity = Literal["stiffness_change", "frequency_ratio"]

TIMES = ("slow_time", "slow_time_s", "time", "time_s", "t", "t_s")
VALUES: tuple[tuple[str, Quantity], ...] = (
    ("stiffness_change", "stiffness_change"),
    ("frequency_ratio", "frequency_ratio"),
    ("frequency_hz", "frequency_ratio"),
)
"""Names of columns that are looked for, and what is made of each."""
SCATTER = 0.6745 * np.sqrt(2.0)
"""Median size of a difference of two readings, over their standard deviation."""
UNITS = {"c": "°C", "k": "K", "kg": "kg", "t": "t", "n": "N", "percent": "%"}
"""Of a covariate, by the end of its name."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TabulatedHistory:
    """The history that a diagnosis in slow time uses.

    Parameters
    ----------
    of
        Whose it is.
    value, sd
        Relative change of stiffness or frequency, and its standard deviation.
    """

    of: str
    time: Series
    value: Series
    sd: Series
    covariates: tuple[Covariate, ...]
    quantity: Quantity
    time_unit: str


def covariate(name: str, values: Series) -> Covariate:
    """Name a covariate, with its unit by the end of the name.

    Examples
    --------
    >>> covariate("temperature_c", np.zeros(2)).unit
    '°C'
    """
    return Covariate(name, values, UNITS.get(name.split("_")[-1], ""))


def read_history(path: Path) -> TabulatedHistory:
    """Read a history from text with a header or from .npz, one column for each quantity.

    The time is called slow_time (or time, t), the value stiffness_change, frequency_ratio
    (less 1) or frequency_hz, its standard deviation as the value with _sd behind, or sd; all
    other columns are what was read beside it.

    Raises
    ------
    RecordError
        Where there is no such column; the text says which there are.
    """
    columns = _columns(path)
    time = _first(TIMES, columns, path, "time")
    name = _first([value for value, _ in VALUES], columns, path, "value")
    value = columns[name]
    deviation = next((key for key in (f"{name}_sd", "sd") if key in columns), None)
    fine = np.isfinite(value) & np.isfinite(columns[time])
    sd = _scatter(value[fine]) if deviation is None else columns[deviation][fine]
    value, sd = value[fine], np.broadcast_to(sd, value[fine].shape)
    if name == "frequency_hz":
        centre = float(np.median(value))
        value, sd = value / centre - 1.0, sd / centre
    others = {key for key in columns if key not in (time, name, deviation)}
    return TabulatedHistory(
        of=path.stem,
        time=columns[time][fine],
        value=value,
        sd=np.array(sd),
        covariates=tuple(
            covariate(key, column[fine]) for key, column in columns.items() if key in others
        ),
        quantity=dict(VALUES)[name],
        time_unit="s",
    )


def _columns(path: Path) -> Mapping[str, Series]:
    if path.suffix == ".npz":
        arrays = read_npz(path, DATA.most_bytes)
        found = {key: array for key, array in arrays.items() if array.ndim == 1}
    else:
        try:
            table = np.genfromtxt(
                document_text(path, DATA).splitlines(), delimiter=",", names=True, dtype=float,
                deletechars="",
            )  # fmt: skip
        except (ValueError, TypeError, IndexError) as error:
            raise RecordError(
                f"{path.name} is not a table: {reason_of(error)} Give text with one line of "
                "names, then numbers between commas, or .npz."
            ) from None
        found = {key: np.atleast_1d(table[key]) for key in table.dtype.names or ()}
    numbers = {k: v.astype(float) for k, v in found.items() if v.dtype.kind in "fiu"}
    if len({len(column) for column in numbers.values()}) > 1:
        raise RecordError(f"Columns of {path.name} differ in length. Give one for each epoch.")
    return numbers


def _first(
    names: tuple[str, ...] | list[str], columns: Mapping[str, Series], path: Path, what: str
) -> str:
    for name in names:
        if name in columns:
            return name
    raise RecordError(
        f"{path.name} has no column of the {what}. It is called one of {', '.join(names)}; "
        f"there are: {', '.join(columns) or 'none with numbers'}."
    )


def _scatter(value: Series) -> float:
    """Take the standard deviation of readings from how much neighbours differ."""
    size = float(np.median(np.abs(np.diff(value)))) / SCATTER if len(value) > 1 else 0.0
    return size or float(np.std(value)) or 1e-12
