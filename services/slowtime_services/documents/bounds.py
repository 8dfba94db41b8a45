"""Bounds of a document, and what is checked before it is parsed."""

import dataclasses
import pathlib

MEBIBYTE = 1 << 20


class DocumentError(ValueError):
    """A document that cannot be read, or is more than is allowed; `line` counts from 1."""

    def __init__(self, sentence: str, line: int | None = None) -> None:
        super().__init__(sentence)
        self.line = line


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """How large a document may be.

    Parameters
    ----------
    most_bytes
        Size of the file [bytes]. Model files are the largest that people keep: some ten
        matrices over 200 coordinates.
    most_values
        Values, counted by the marks between them [1]; each takes some 300 bytes and 10 µs
        when it is read with its line. Ten matrices over 200 coordinates have 400,000.
    most_levels
        Lists and tables within each other [1]. The deepest documents of slowtime have nine.
    """

    most_bytes: int = 4 * MEBIBYTE
    most_values: int = 500_000
    most_levels: int = 64


BOUNDS = Bounds()
"""Of documents that people write."""

DATA = Bounds(most_bytes=256 * MEBIBYTE, most_values=20_000_000)
"""Of results that a command has written and that another one reads: windows of weeks."""

RESULT = Bounds(most_bytes=64 * MEBIBYTE, most_values=1_000_000)
"""Of modes of a whole record: 1,000 channels, 300 modes, and three numbers for each."""

_MARKS = ",[{\n"
"""What parts values in YAML and JSON; each value but the first has one of these before it."""


def refuse_many_values(text: str, bounds: Bounds) -> None:
    """Refuse a text that has more marks than values are allowed.

    Raises
    ------
    DocumentError
        Saying how many there are.
    """
    marks = sum(text.count(mark) for mark in _MARKS)
    if marks > bounds.most_values:
        raise DocumentError(
            f"It has {marks:,} values or lines. Allowed: {bounds.most_values:,}. Is it a "
            "record?"
        )


def document_text(path: pathlib.Path, bounds: Bounds = BOUNDS) -> str:
    """Return the text of a file.

    Raises
    ------
    DocumentError
        Where it is larger than allowed, or not UTF-8. OSError where it cannot be opened.
    """
    with path.open("rb") as file:  # not `stat`: pipes and devices have no size
        content = file.read(bounds.most_bytes + 1)
    if len(content) > bounds.most_bytes:
        raise DocumentError(
            f"{path.name} is larger than {bounds.most_bytes / MEBIBYTE:.0f} MiB, which is the "
            "most that is read of such a file. Is it a record?"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(
            f"{path.name} is not text (byte {error.start}). Give a file in UTF-8."
        ) from None
