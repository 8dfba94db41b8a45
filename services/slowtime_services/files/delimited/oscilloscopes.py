"""Exports of oscilloscopes with settings beside the rows, converted to plain tables.

References
----------
.. [1] Tektronix, "TDS1000- and TDS2000-series digital storage oscilloscope: user manual",
   071-1064, "CSV files".
.. [2] Rigol, "MSO/DS1000Z series user's guide", "Storage: CSV".
"""

import re

from .dialect import HEAD_LINES, Dialect

FEWEST_COLUMNS, FEWEST_SETTINGS = 4, 3
"""Of a table that has settings beside its rows: key, value, and a pair of numbers or more."""
_INCREMENT = re.compile(r"(?:t[\s_]?)?inc(?:r|rement)?", re.I)
_KEY = re.compile(r"[A-Za-z][\w ./-]*")


def plain_table(lines: list[str]) -> list[str]:
    """Lines with settings above the rows; as they are where they are of another kind.

    Examples
    --------
    >>> plain_table(["X,CH1,Start,Increment", "Sequence,Volt,0,1e-3", "0,1.5,,", "1,1.6,,"])
    ['Sample interval: 1e-3 s', 'X,CH1', 'Sequence,Volt', '0,1.5', '1,1.6']
    """
    if len(lines) < FEWEST_SETTINGS or "," not in lines[0]:
        return lines
    return _without_increment(lines) or _without_settings(lines) or lines


def _fields(line: str) -> list[str]:
    return [field.strip().strip('"') for field in line.rstrip("\r\n").split(",")]


def _without_increment(lines: list[str]) -> list[str] | None:
    """Remove the columns Start and Increment, which have one value below each."""
    names, values = _fields(lines[0]), _fields(lines[1])
    at = [i for i, name in enumerate(names) if _INCREMENT.fullmatch(name)]
    if len(at) != 1 or at[0] >= len(values) or not _is_number(values[at[0]]):
        return None
    start = next((i for i, name in enumerate(names) if name.casefold() == "start"), at[0])
    width = min(start, at[0])
    if width < 1 or any(field for line in lines[2:4] for field in _fields(line)[width:]):
        return None
    rows = [",".join(_fields(line)[:width]) for line in lines if line.strip()]
    return [f"Sample interval: {values[at[0]]} s", *rows]


def _without_settings(lines: list[str]) -> list[str] | None:
    """Take keys and values of settings, which stand before the first rows, above them."""
    head = [_fields(line) for line in lines[:HEAD_LINES] if line.strip()]
    width = len(head[0])
    if width < FEWEST_COLUMNS or any(len(row) != width for row in head):
        return None
    first = next(
        (at for at in range(2, width) if all(_is_number(row[at]) for row in head)), width
    )
    keys = [row for row in head if row[0]]
    beside = [row for row in head if not row[0]]
    if (
        width - first < 2
        or not FEWEST_SETTINGS <= len(keys) < len(head)
        or any(any(row[:first]) for row in beside)
        or not all(_KEY.fullmatch(row[0]) for row in keys)
    ):
        return None
    rows = [",".join(_fields(line)[first:]).rstrip(",") for line in lines if line.strip()]
    said = {row[0].casefold(): row[1] for row in keys}
    settings = [f"{row[0]}: {row[1]}" for row in keys]
    if said.get("source") and len(rows[0].split(",")) == 2:
        units = said.get("horizontal units") or "s", said.get("vertical units") or "V"
        settings.append(f"time [{units[0]}],{said['source']} [{units[1]}]")
    return [*settings, *rows]


def _is_number(text: str) -> bool:
    return Dialect(",", ".").is_number(text)
