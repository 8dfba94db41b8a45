"""Datasets of a universal file as text: their kinds and lines, and numbers of fixed width."""

import dataclasses
import itertools
import math
import re
from pathlib import Path

from slowtime_services.files import RecordError

_MARK = re.compile(r"\s*-1\s*$")
_MARK_LINE = re.compile(rb"^[ \t]*-1[ \t]*\r?$", re.MULTILINE)
MOST_BYTES = 256 << 20
MOST_DATASETS = 20_000
"""Datasets of a file at most [1]: each mode is one, and each mark between them is a line."""


@dataclasses.dataclass(frozen=True, slots=True)
class Dataset:
    """One dataset: its number, its lines, and where they stand in the file."""

    file: str
    kind: str
    lines: tuple[str, ...]
    first_line: int


def datasets_of(path: Path) -> list[Dataset]:
    """Part a universal file into its datasets; binary ones are left out.

    Raises
    ------
    RecordError
        Where it is no universal file, or ends within a dataset.
    """
    with path.open("rb") as file:  # not `stat`: pipes and devices have no size
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise RecordError(
            f"{path.name} is larger than {MOST_BYTES >> 20} MiB. Give a file of modes and "
            "geometry without records."
        )
    marks = itertools.islice(_MARK_LINE.finditer(content), 2 * MOST_DATASETS + 1)
    if sum(1 for _ in marks) > 2 * MOST_DATASETS:
        raise RecordError(
            f"{path.name} has more than {MOST_DATASETS:,} datasets. Give a file of modes and "
            "geometry without records."
        )
    lines = content.decode("latin-1").splitlines()
    places = [number for number, line in enumerate(lines) if _MARK.fullmatch(line)]
    if not places or any(line.strip() for line in lines[: places[0]]):
        raise RecordError(
            f"{path.name} is not a valid universal file: it does not begin with a "
            "line -1. Give one."
        )
    if len(places) % 2:
        raise RecordError(
            f"{path.name} ends within the dataset that begins in line {places[-1] + 1}: it is "
            "cut short. Export it again."
        )
    return [
        Dataset(path.name, kind, tuple(lines[first + 2 : last]), first + 3)
        for first, last in zip(places[::2], places[1::2], strict=True)
        if (kind := lines[first + 1][:6].strip() or lines[first + 1].strip())
    ]


def integers(dataset: Dataset, at: int, widths: list[int]) -> list[int]:
    """Whole numbers of a line, each of its width; those that are missing are 0."""
    line = _line(dataset, at)
    found, begin = [], 0
    for width in widths:
        text = line[begin : begin + width].strip()
        begin += width
        if not re.fullmatch(r"[+-]?\d{1,10}|", text):
            raise _refused(dataset, at, text, "a whole number")
        found.append(int(text or 0))
    return found


def numbers(dataset: Dataset, at: int, layout: tuple[int, int, int]) -> list[float]:
    """Numbers of a line: from a column on, so many characters each, so many of them."""
    begin, width, count = layout
    line = _line(dataset, at)
    found = []
    for number in range(count):
        text = line[begin + number * width : begin + (number + 1) * width].strip()
        try:
            value = float(text.replace("D", "E").replace("d", "e"))
        except ValueError:
            raise _refused(dataset, at, text, "a number") from None
        if not math.isfinite(value):
            raise _refused(dataset, at, text, "a finite number")
        found.append(value)
    return found


def _line(dataset: Dataset, at: int) -> str:
    if at >= len(dataset.lines):
        raise RecordError(
            f"The dataset {dataset.kind} at line {dataset.first_line} of {dataset.file} is cut "
            "short. Export it again."
        )
    return dataset.lines[at]


def _refused(dataset: Dataset, at: int, text: str, what: str) -> RecordError:
    return RecordError(
        f"Line {dataset.first_line + at} of {dataset.file} has {text[:40]!r} where {what} of "
        f"dataset {dataset.kind} should be. Export it again."
    )
