"""Bulk data of Nastran as a deck: case control, and cards with typed fields."""

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

from slowtime_services.matrices.bounds import written_out
from slowtime_services.matrices.errors import MatrixFileError
from slowtime_services.matrices.nastran_bulk import Card, read_cards, real_field

_SELECTION = re.compile(r"\s*(SPC|MPC)\s*=\s*(\d+)", re.IGNORECASE)


@dataclasses.dataclass(frozen=True, slots=True)
class Fields:
    """Fields of a card by their number, 0 being its name; absent ones are empty."""

    path: Path
    card: Card

    @property
    def line(self) -> int:
        """Line on which the card begins."""
        return self.card.line

    @property
    def kind(self) -> str:
        """Name of the card."""
        return self.card.fields[0]

    def __len__(self) -> int:
        """Count the fields up to the last one that is not empty, with the name."""
        return max(k for k, text in enumerate(self.card.fields) if text) + 1

    def text(self, k: int, default: str = "") -> str:
        """Text of a field, or what stands for an empty one."""
        return (self.card.fields[k] if k < len(self.card.fields) else "") or default

    def whole(self, k: int, default: str = "") -> str:
        """Return a positive integer as text, such as the number of a point.

        Raises
        ------
        MatrixFileError
            Where it is none.
        """
        given = self.text(k, default)
        if not given.isdecimal():
            raise self.error(f"field {k + 1} is {given!r}. Allowed is a positive integer.")
        return str(int(given))

    def real(self, k: int, default: float = 0.0) -> float:
        """Return the number of a field, or what stands for an empty one."""
        return real_field(self.path, self.card, self.text(k)) if self.text(k) else default

    def reals(self, first: int, count: int) -> list[float]:
        """Numbers of neighbouring fields, 0 where empty."""
        return [self.real(k) for k in range(first, first + count)]

    def directions(self, k: int) -> tuple[int, ...]:
        """Directions, 0 to 5, of a field of components.

        Raises
        ------
        MatrixFileError
            Where it has other characters than 1 to 6.
        """
        given = self.text(k)
        if set(given) - set("123456"):
            raise self.error(f"field {k + 1} is {given!r}. Allowed are components 1 to 6.")
        return tuple(int(c) - 1 for c in given)

    def numbers(self, first: int) -> list[str]:
        """Whole numbers from a field on, `a THRU b` written out."""
        given = [text for text in self.card.fields[first:] if text]
        if len(given) == 3 and given[1].upper() == "THRU":
            low, high = int(self.whole(first)), int(given[2])
            return list(written_out(range(low, high + 1)))
        for text in given:
            if not text.isdecimal():
                raise self.error(f"{text!r} is not a positive integer.")
        return [str(int(text)) for text in given]

    def error(self, text: str) -> MatrixFileError:
        """Make an error that names file, line and card."""
        return MatrixFileError(f"Line {self.line} of {self.path.name}, {self.kind}: {text}")


@dataclasses.dataclass(frozen=True, slots=True)
class Deck:
    """Cards by their name, and the sets of supports and relations that the cases select.

    Parameters
    ----------
    cards
        Cards in the order of the file, by name.
    selected
        Numbers of sets that the case control names, by SPC or MPC.
    """

    cards: dict[str, list[Fields]]
    selected: dict[str, set[str]]

    def of(self, *kinds: str) -> Iterator[Fields]:
        """Yield the cards of some kinds."""
        for kind in kinds:
            yield from self.cards.get(kind, [])


def read_deck(path: Path) -> Deck:
    """Read a file of bulk data, with or without its executive and case control.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    The cards between BEGIN BULK and ENDDATA.

    Raises
    ------
    MatrixFileError
        Where the file cannot be read.
    """
    if not path.is_file():
        raise MatrixFileError(f"There is no file {path}. Check the path.")
    lines = path.read_text(encoding="latin-1").splitlines()
    begin = next(
        (k for k, line in enumerate(lines, 1) if line.upper().split()[:2] == ["BEGIN", "BULK"]),
        0,
    )
    selected: dict[str, set[str]] = {"SPC": set(), "MPC": set()}
    for line in lines[:begin]:
        match = _SELECTION.match(line)
        if match:
            selected[match[1].upper()].add(str(int(match[2])))
    cards: dict[str, list[Fields]] = {}
    for card in read_cards(path):
        if card.fields[0] == "ENDDATA":
            break
        if card.line > begin:
            cards.setdefault(card.fields[0], []).append(Fields(path, card))
    return Deck(cards, selected)
