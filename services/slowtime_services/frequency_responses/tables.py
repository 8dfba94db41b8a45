"""Frequency responses in text tables: complex cells, parts, or magnitude and phase."""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from slowtime_services.files.record import RecordError

from .measured import Channel, FrfCurve

DELIMITERS = (";", "\t", ",", None)
"""Tried in turn; None for blanks."""
LEAST_ROWS = 8
"""[rows] Of a table. Source: as `measured.LEAST_LINES`."""
MOST_HEAD = 200
"""[lines] Above the first row."""
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?(?:nan|inf)"
_COMPLEX = re.compile(
    rf"\(?\s*(?P<real>{_NUMBER})\s*(?P<sign>[+-])\s*(?P<imag>{_NUMBER})?\s*\*?\s*[ijIJ]\s*\)?"
    rf"|\(?\s*(?P<alone>{_NUMBER})?\s*\*?\s*[ijIJ]\s*\)?"
)
_REAL = re.compile(_NUMBER, re.I)
_FREQUENCY = re.compile(r"freq|frekv|fréq|\bf\b|\bhz\b|_hz\b", re.I)
_WORDS: dict[str, re.Pattern[str]] = {
    "coherence": re.compile(r"coh|koh|gamma|γ", re.I),
    "sd": re.compile(r"\bsd\b|\bstd|deviation|sigma", re.I),
    "phase": re.compile(r"phase|\bphi\b|angle|\barg\b|winkel|\bdeg|°|\bph\b", re.I),
    "imag": re.compile(r"\bim(?:ag\w*)?\b|_im(?:ag)?\b|imaginary|imaginär", re.I),
    "real": re.compile(r"\bre(?:al\w*)?\b|_re(?:al)?\b", re.I),
    "magnitude": re.compile(r"mag|ampl|\babs\b|modulus|betrag|gain|\bdb\b|\|", re.I),
}
"""Words by which a column tells what it holds, the surest first."""
_RADIANS = re.compile(r"rad", re.I)
_DECIBELS = re.compile(r"\bdb\b|\[db|\(db|_db\b", re.I)
_UNIT = re.compile(r"[\[(]([^\])]*)[\])]")
_PAIR = re.compile(r"\s*(.+?)\s*(?:/| over | per )\s*(.+?)\s*$")


class NumberTable(NamedTuple):
    """Rows of complex numbers, the words above them, and whether any cell was complex."""

    rows: np.ndarray
    names: list[str]
    complex_cells: bool


def read_table(lines: Sequence[str]) -> NumberTable | None:
    """Read the longest table of numbers; None where there is none.

    Parameters
    ----------
    lines
        Of a text, or of a sheet of a workbook.
    """
    text = [line for line in lines if line.strip()]
    for delimiter in DELIMITERS:
        first = _first_row(text, delimiter)
        if first is None:
            continue
        rows = []
        width = len(_cells(text[first], delimiter) or ())
        for line in text[first:]:
            cells = _cells(line, delimiter)
            if cells is None or len(cells) != width:
                break
            rows.append(cells)
        if len(rows) >= LEAST_ROWS:
            names = _names(text[:first], width, delimiter)
            found = np.array([[value for value, _ in row] for row in rows])
            return NumberTable(found, names, any(whole for row in rows for _, whole in row))
    return None


def _first_row(text: Sequence[str], delimiter: str | None) -> int | None:
    for at, line in enumerate(text[:MOST_HEAD]):
        cells = _cells(line, delimiter)
        if cells is not None and len(cells) > 1:
            return at
    return None


def _cells(line: str, delimiter: str | None) -> list[tuple[complex, bool]] | None:
    """Numbers of a line, and whether each was written as complex; None for other lines."""
    parts = line.split() if delimiter is None else line.rstrip().split(delimiter)
    while parts and not parts[-1].strip():
        parts = parts[:-1]
    found = []
    for part in parts:
        plain = part.strip().strip('"')
        if delimiter != ",":
            plain = plain.replace(",", ".")
        if _REAL.fullmatch(plain):
            found.append((complex(_float(plain)), False))
            continue
        match = _COMPLEX.fullmatch(plain)
        if match is None:
            return None
        real, size = _float(match["real"] or "0"), match["imag"] or match["alone"] or "1"
        sign = -1.0 if match["sign"] == "-" else 1.0
        found.append((complex(real, sign * _float(size)), True))
    return found


def _float(text: str) -> float:
    return float(text.replace("D", "e").replace("d", "e"))


def _names(head: Sequence[str], width: int, delimiter: str | None) -> list[str]:
    """Words of the line above the rows, if it has one for each column."""
    for line in reversed(head[-2:]):
        plain = line.strip().lstrip("#%").strip()
        words = plain.split() if delimiter is None else plain.split(delimiter)
        if len(words) == width:
            return [word.strip().strip('"') for word in words]
    return [""] * width


def looks_like_responses(table: NumberTable) -> bool:
    """Whether a table holds frequency responses: complex cells, or columns that say so."""
    roles = [_role(name) for name in table.names]
    if table.complex_cells:
        return not np.iscomplex(table.rows[:, 0]).any() and _rises(table.rows[:, 0].real)
    parts = {"real", "imag"} <= set(roles) or {"magnitude", "phase"} <= set(roles)
    return bool(_FREQUENCY.search(table.names[0])) and parts and _rises(table.rows[:, 0].real)


def _rises(values: np.ndarray) -> bool:
    return bool((np.diff(values) > 0).all()) and bool(values[0] >= 0)


def _role(name: str) -> str:
    return next((role for role, word in _WORDS.items() if word.search(name)), "")


def curves_of_table(file: str, table: NumberTable) -> tuple[list[FrfCurve], tuple[str, ...]]:
    """Take a curve from each complex column, and from each two columns of parts.

    Parameters
    ----------
    file
        Its name, for messages.
    table
        The table; frequencies [Hz] in its first column.

    Raises
    ------
    RecordError
        Where columns do not tell which parts they are.
    """
    hz = table.rows[:, 0].real
    notes: tuple[str, ...] = ()
    errors: dict[str, np.ndarray] = {}
    coherence: dict[str, np.ndarray] = {}
    found: list[tuple[str, np.ndarray]] = []
    columns = list(enumerate(table.names))[1:]
    rest = []
    for place, name in columns:
        role, values = _role(name), table.rows[:, place]
        if role in ("coherence", "sd"):
            (coherence if role == "coherence" else errors)[_bare(name, role)] = values.real
        elif table.complex_cells:
            found.append((name, values))
        else:
            rest.append((place, name))
    if rest:
        pairs, notes = _pairs(file, table, rest)
        found += pairs
    return [_curve(hz, n, v, k, errors, coherence) for k, (n, v) in enumerate(found)], notes


def _curve(
    hz: np.ndarray,
    name: str,
    values: np.ndarray,
    number: int,
    errors: dict[str, np.ndarray],
    coherence: dict[str, np.ndarray],
) -> FrfCurve:
    bare = _bare(name, "")
    pair = _PAIR.fullmatch(bare)
    output, driven = (pair[1], pair[2]) if pair else (bare or f"response_{number}", "input")
    only = next(iter(coherence.values())) if len(coherence) == 1 else None
    return FrfCurve(
        output=_channel(output),
        input=_channel(driven),
        frequency_hz=hz,
        values=values,
        sd=errors.get(bare),
        coherence=coherence.get(bare, coherence.get(_channel(output)[0], only)),
    )


def _channel(text: str) -> Channel:
    unit = _UNIT.search(text)
    words = unit[1] if unit else ""
    said = "" if _DECIBELS.search(f"({words})") or words.casefold() == "hz" else words
    return _UNIT.sub("", text).strip() or text, said


def _bare(name: str, role: str) -> str:
    """Name of the pair: the column's, without the words for its part."""
    plain = re.sub(r"(?i)[\[(](?:db|deg|rad|°)[^\])]*[\])]", "", name)
    for word in (
        r"real(?: part)?|imag(?:inary)?(?: part)?|re|im|sd|std|coherence|coh|"
        r"magnitude|mag|amplitude|ampl|abs|phase|phi|deg|db|rad",
    ):
        plain = re.sub(rf"(?i)(?<![^\W_])(?:{word})(?![^\W_])", " ", plain)
    return re.sub(r"\s+", " ", plain).strip(" _-:,()[]")


def _pairs(
    file: str, table: NumberTable, columns: Sequence[tuple[int, str]]
) -> tuple[list[tuple[str, np.ndarray]], tuple[str, ...]]:
    """Join columns of real numbers by two: parts, or magnitude and phase."""
    if len(columns) % 2:
        raise RecordError(
            f"{file} has {len(columns)} columns of real numbers beside the frequencies, which "
            "are no pairs of real and imaginary part, or of magnitude and phase. Give both of "
            "each frequency response: magnitudes alone tell no modes."
        )
    roles = [_role(name) for _, name in columns]
    notes: tuple[str, ...] = ()
    found = []
    for (at, first), (other, second) in _by_two(columns, roles):
        one, two = _role(first), _role(second)
        a, b = table.rows[:, at].real, table.rows[:, other].real
        if (one, two) == ("magnitude", "phase"):
            size = 10 ** (a / 20) if _DECIBELS.search(first) else a
            turn = b if _RADIANS.search(second) else np.deg2rad(b)
            found.append((first, size * np.exp(1j * turn)))
        elif (one, two) == ("real", "imag"):
            found.append((first, a + 1j * b))
        elif not one and not two:
            _refuse_phase(file, a, b)
            found.append((first, a + 1j * b))
            notes = (
                "columns without names are taken for real and imaginary parts in turn; name "
                "them magnitude and phase in a heading if they are.",
            )
        else:
            raise RecordError(
                f"Columns {first!r} and {second!r} of {file} are no two parts of a frequency "
                "response. Name them re and im, or magnitude (dB) and phase (deg or rad)."
            )
    return found, notes


def _by_two(
    columns: Sequence[tuple[int, str]], roles: Sequence[str]
) -> Iterator[tuple[tuple[int, str], tuple[int, str]]]:
    """Pairs of columns: those beside each other, or all firsts before all seconds."""
    half = len(columns) // 2
    apart = half > 1 and len(set(roles[:half])) == 1 and len(set(roles[half:])) == 1
    apart = apart and roles[0] != roles[half]
    order = (
        zip(columns[:half], columns[half:], strict=True)
        if apart
        else zip(columns[::2], columns[1::2], strict=True)
    )
    for first, second in order:
        backwards = _role(first[1]) in ("imag", "phase")
        yield (second, first) if backwards else (first, second)


def _refuse_phase(file: str, a: np.ndarray, b: np.ndarray) -> None:
    """Ask about two columns without names that may be magnitude and phase."""
    turns = float(np.abs(b).max()) <= 360.0 and float(np.abs(b).max()) > 90.0
    if (
        turns
        and ((a >= 0).all() or (a <= 0).mean() > 0.5)
        and np.abs(a).max() < np.abs(b).max()
    ):
        raise RecordError(
            f"{file} has columns without names, which may be real and imaginary parts, or "
            "magnitude and phase. Name them in a line above: Hz, re, im or Hz, magnitude dB, "
            "phase deg."
        )
