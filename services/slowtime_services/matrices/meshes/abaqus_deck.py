"""Input of Abaqus or CalculiX as blocks: a keyword with its parameters, and lines of data."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

from slowtime_services.matrices.errors import MatrixFileError

LONGEST_KEYWORD = 4_000
"""Characters of a keyword with its parameters [1]; a line has at most 256."""


@dataclasses.dataclass(frozen=True, slots=True)
class KeywordBlock:
    """A keyword, its parameters in capitals, and its lines of data with their numbers."""

    path: Path
    line: int
    keyword: str
    parameters: Mapping[str, str]
    data: list[tuple[int, list[str]]]
    in_step: bool

    def parameter(self, *names: str) -> str:
        """Value of the first parameter that is there, in capitals.

        Raises
        ------
        MatrixFileError
            Where none is.
        """
        for name in names:
            if name in self.parameters:
                return self.parameters[name].upper()
        raise self.error(f"lacks the parameter {' or '.join(names)}.")

    def numbers(self, row: int, least: int = 0) -> list[float]:
        """Numbers of a line of data; empty where there is no such line.

        Raises
        ------
        MatrixFileError
            Where one is no number, or there are fewer than `least`.
        """
        line, parts = self.data[row] if row < len(self.data) else (self.line, [])
        try:
            found = [float(part.upper().replace("D", "E")) for part in parts if part]
        except ValueError:
            raise self.error(f"line {line} is not a list of numbers.") from None
        if len(found) < least:
            raise self.error(f"needs {least} numbers in its line of data {row + 1}.")
        return found

    def error(self, text: str) -> MatrixFileError:
        """Make an error that names file, line and keyword."""
        return MatrixFileError(f"Line {self.line} of {self.path.name}, *{self.keyword}: {text}")


def read_blocks(path: Path) -> Iterator[KeywordBlock]:
    """Read the blocks of an input file.

    Parameters
    ----------
    path
        The file.

    Yields
    ------
    Blocks in the order of the file, the text of *HEADING left out.

    Raises
    ------
    MatrixFileError
        Where the file does not exist, or a line of data comes before the first keyword.
    """
    if not path.is_file():
        raise MatrixFileError(f"There is no file {path}. Check the path.")
    block: KeywordBlock | None = None
    in_step = False
    head = ""
    for number, raw in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        text = head + raw.strip()
        head = ""
        if not text or text.startswith("**"):
            continue
        if text.startswith("*") and text.endswith(","):  # a keyword goes on in the next line
            if len(text) > LONGEST_KEYWORD:
                raise MatrixFileError(
                    f"Line {number} of {path.name}: a keyword goes on for more than "
                    f"{LONGEST_KEYWORD} characters. Check the comma at the end of its line."
                )
            head = text
            continue
        if text.startswith("*"):
            if block is not None:
                yield block
            block = _opened(path, number, text, in_step=in_step)
            in_step = (in_step or block.keyword == "STEP") and block.keyword != "END STEP"
        elif block is None:
            raise MatrixFileError(
                f"Line {number} of {path.name} is {text[:40]!r}. Input begins with a keyword, "
                "such as *NODE."
            )
        else:
            block.data.append((number, [part.strip() for part in text.split(",")]))
    if block is not None:
        yield block


def _opened(path: Path, number: int, text: str, *, in_step: bool) -> KeywordBlock:
    word, *rest = [part.strip() for part in text.lstrip("*").split(",")]
    parameters = {}
    for part in rest:
        key, _, value = part.partition("=")
        parameters["".join(key.upper().split())] = value.strip().strip('"')
    return KeywordBlock(path, number, " ".join(word.upper().split()), parameters, [], in_step)
