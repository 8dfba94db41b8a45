"""Fields of a line of a heading, parted by the delimiter of the rows."""

import csv
import re

FIELD = "\t"
"""What stands between fields: a blank to every form of a key, and to no form of a figure."""
_GROUP_OF_ZEROS = re.compile(r"0\d\d(?!\d)")
_BEGINS_GROUP = re.compile(r"(?<![\d.,])[+-]?[1-9]\d{0,2}(?:,\d{3})*$")
_SENTENCE_WITH_FIGURE = re.compile(r"[^\W\d_].*\d$")


def fields_apart(line: str, delimiter: str | None) -> str:
    r"""Return a line with `FIELD` where the rows' delimiter parts its fields.

    A comma within a sentence, as in ``Sampling rate: 25,600 Hz``, and one before a group of
    digits that begins with zero, as in ``Samples,8,000``, belong to a figure.

    Examples
    --------
    >>> fields_apart("Sample rate,200,200", ","), fields_apart("Samples,8,000", ",")
    ('Sample rate\t200\t200', 'Samples\t8,000')
    >>> fields_apart("Sampling rate: 25,600 Hz", ","), fields_apart('"rate, Hz",5', ",")
    ('Sampling rate: 25,600 Hz', 'rate, Hz\t5')
    """
    if delimiter is None or delimiter not in line:
        return line
    apart = _split(line, delimiter)
    joined = apart[0]
    for field in apart[1:]:
        last = joined.rpartition(FIELD)[2]
        joined += ("," if delimiter == "," and _goes_on(last, field) else FIELD) + field
    return joined


def _split(line: str, delimiter: str) -> list[str]:
    if '"' in line:
        try:
            return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
        except (csv.Error, StopIteration):
            pass
    return line.split(delimiter)


def _goes_on(last: str, field: str) -> bool:
    """Whether the comma between two fields is within a figure."""
    if not last[-1:].isdigit() or not field[:1].isdigit():
        return False
    if _SENTENCE_WITH_FIGURE.search(last):
        return True
    return bool(_GROUP_OF_ZEROS.match(field) and _BEGINS_GROUP.search(last))
