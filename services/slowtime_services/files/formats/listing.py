"""Numbers of a listing, one after the other, however many stand on a line."""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from slowtime_services.files.record import RecordError

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")


def numbers_of(
    lines: Sequence[str], first_line: int, name: str, width: int | None = None
) -> Float[np.ndarray, " value"]:
    """All numbers of some lines, in the order of reading.

    Parameters
    ----------
    first_line
        Number of the first of `lines` in its file, for messages.
    width
        Characters of each number, where they may touch; None where blanks part them.

    Raises
    ------
    RecordError
        Where a line holds something else.
    """
    found: list[str] = []
    for number, line in enumerate(lines, start=first_line):
        if width is None:
            fields = line.replace(",", " ").split()
        else:
            fields = [line[i : i + width].strip() for i in range(0, len(line.rstrip()), width)]
            fields = [field for field in fields if field]
        for field in fields:
            if not _NUMBER.fullmatch(field):
                raise RecordError(
                    f"Line {number} of {name} has {field[:40]!r} where a number should be. "
                    "Correct or remove that line."
                )
        found.extend(fields)
    return np.array([float(f.replace("d", "e").replace("D", "e")) for f in found], dtype=float)
