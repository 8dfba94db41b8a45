"""Tables of numbers that verbs read: columns by name, and errors that name the line."""

import csv
import math
from pathlib import Path

import click
import numpy as np
from jaxtyping import Float

from slowtime_services.documents.bounds import DATA, DocumentError, document_text


def read_columns(path: Path) -> dict[str, Float[np.ndarray, " row"]]:
    """Columns of a text file with a heading, between commas, semicolons or tabs.

    Raises
    ------
    click.UsageError
        For a file without rows, a name given twice, or a field that is no finite number.
    """
    try:
        lines = document_text(path, DATA).splitlines()
    except DocumentError as error:
        raise click.UsageError(str(error)) from None
    lines = [line for line in lines if line.strip()]
    if len(lines) < 2:
        raise click.UsageError(f"{path.name} has no rows below a heading. Give some.")
    delimiter = max(",;\t", key=lines[0].count)
    try:
        rows = list(csv.reader(lines, delimiter=delimiter))
    except csv.Error as error:
        raise click.UsageError(f"{path.name} is not a table: {error}.") from None
    names = [name.strip() for name in rows[0]]
    if len(set(names)) < len(names) or "" in names:
        raise click.UsageError(f"{path.name} has columns {names}. Give each a name, once.")
    values = np.empty((len(rows) - 1, len(names)))
    for number, row in enumerate(rows[1:]):
        if len(row) != len(names):
            raise click.UsageError(
                f"{path.name}, row {number + 1}: {len(row)} fields under {len(names)} names. "
                "Give one field for each."
            )
        for place, field in enumerate(row):
            values[number, place] = _number(field, path, number, names[place])
    return dict(zip(names, values.T.copy(), strict=True))


def _number(field: str, path: Path, row: int, name: str) -> float:
    try:
        value = float(field)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise click.UsageError(
            f"{path.name}, row {row + 1}: {field!r:.40} of {name} is not a finite number."
        )
    return value
