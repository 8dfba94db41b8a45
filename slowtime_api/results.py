"""What results have in common: a table as text, HTML and pandas, and equality by values."""

import dataclasses
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from .optional import optional

MOST_ROWS = 40
"""Rows of a table that are printed [1]; `to_pandas` has all."""


class Result:
    """Base of results: frozen dataclasses with a table.

    Subclasses return their table from `rows` and say in `heading` what it is.
    """

    @property
    def heading(self) -> str:
        """What the table is, in a line."""
        raise NotImplementedError

    def rows(self) -> list[dict[str, Any]]:
        """Return the table as plain values.

        Returns
        -------
        One dictionary per row; names of columns end with their units.
        """
        raise NotImplementedError

    def to_pandas(self) -> Any:
        """Convert the table to a pandas DataFrame.

        Returns
        -------
        The rows of `rows`.

        Raises
        ------
        ImportError
            If pandas is not installed; the message says what to install.
        """
        return optional("pandas").DataFrame(self.rows())

    def _repr_html_(self) -> str:
        return html_table(self.heading, self.rows())

    def __repr__(self) -> str:
        return f"{self.heading}\n{text_table(self.rows())}".rstrip()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return same(self, other)

    __hash__ = None  # type: ignore[assignment]


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal; NaN equals NaN, arrays are compared as a whole.

    Parameters
    ----------
    one, other
        Numbers, texts, arrays, and dataclasses, mappings and sequences of such values.

    Examples
    --------
    >>> same({"x": np.array([1.0, np.nan])}, {"x": np.array([1.0, np.nan])})
    True
    """
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        numbers = np.asarray(one).dtype.kind in "fc" and np.asarray(other).dtype.kind in "fc"
        return np.array_equal(one, other, equal_nan=numbers)
    if type(one) is not type(other):
        return bool(one == other)
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other or (one != one and other != other))


def html_table(heading: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table as HTML, for notebooks.

    Parameters
    ----------
    heading
        Text above the table.
    rows
        One mapping per row, all with the same keys.

    Examples
    --------
    >>> html_table("One", [{"x": 1.5}])
    '<p>One</p><table><tr><th>x</th></tr><tr><td>1.5</td></tr></table>'
    """
    told = f"<p>{escape(heading)}</p>"
    if not rows:
        return told
    heads = "".join(f"<th>{escape(str(name))}</th>" for name in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell(value))}</td>" for value in row.values()) + "</tr>"
        for row in rows[:MOST_ROWS]
    )
    left = len(rows) - MOST_ROWS
    more = f"<p>… and {left} more rows</p>" if left > 0 else ""
    return f"{told}<table><tr>{heads}</tr>{body}</table>{more}"


def text_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table as text, columns aligned.

    Parameters
    ----------
    rows
        One mapping per row, all with the same keys.

    Examples
    --------
    >>> print(text_table([{"mode": 1, "Hz": 2.5}]))
      mode  Hz
      1     2.5
    """
    if not rows:
        return ""
    lines = [[str(name) for name in rows[0]]]
    lines += [[cell(value) for value in row.values()] for row in rows[:MOST_ROWS]]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    told = [("  " + "  ".join(map(str.ljust, line, widths))).rstrip() for line in lines]
    if len(rows) > MOST_ROWS:
        told.append(f"  … and {len(rows) - MOST_ROWS} more rows")
    return "\n".join(told)


def cell(value: Any) -> str:
    """Return a value as a table shows it."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(cell, value))
    return str(value)
