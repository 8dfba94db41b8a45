"""Nastran bulk data: GRID points and DMIG matrices, in small, large and free field format.

Positions in local coordinate systems are refused. DMIG forms 1 (square) and 6 (symmetric) are
read, of real numbers.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from scipy import sparse

from .bounds import written_out
from .errors import MatrixFileError

BULK = (".bdf", ".dat", ".pch", ".nas", ".dmig")
Place = tuple[str, int]
"""Node, and direction 0 to 5."""

_LONGEST = 80
"""Characters of a line that hold fields, those of a card [1]; a tab takes up to eight."""

SCALAR_POINT = 0
"""Component of a scalar point; it moves along one direction only."""


@dataclasses.dataclass(frozen=True, slots=True)
class Card:
    """A card with its continuations: number of its first line, and its name and fields."""

    line: int
    fields: tuple[str, ...]


def read_grids(path: Path) -> dict[str, tuple[float, float, float]]:
    """Position of each GRID point.

    Parameters
    ----------
    path
        Bulk data file.

    Returns
    -------
    Position by the number of the point [m or the unit of the file].
    """
    found = {}
    for card in read_cards(path, ("GRID",)):
        fields = [*card.fields, *[""] * 6]
        if fields[2] not in ("", "0"):
            raise MatrixFileError(
                f"Line {card.line} of {path.name} gives a GRID in coordinate system "
                f"{fields[2]}. Export the positions in the basic system."
            )
        found[fields[1]] = tuple(real_field(path, card, fields[k]) for k in (3, 4, 5))
    return found  # type: ignore[return-value]  # three fields each


def has_dmig(path: Path) -> bool:
    """Whether bulk data hold DMIG cards."""
    return next(read_cards(path, ("DMIG",)), None) is not None


def read_points(path: Path) -> list[Place]:
    """List the rows of matrices over all points (g-set), such as KGG and MGG.

    Nastran orders them by the number of the point; a GRID has six rows, an SPOINT one.

    Parameters
    ----------
    path
        Bulk data file.

    Returns
    -------
    Node and direction of each row.
    """
    rows = {number: 6 for number in read_grids(path)}
    for card in read_cards(path, ("SPOINT",)):
        given = [field for field in card.fields[1:] if field]
        if len(given) == 3 and given[1].upper() == "THRU":
            given = list(written_out(range(int(given[0]), int(given[2]) + 1)))
        rows |= dict.fromkeys(given, 1)
    if not rows:
        raise MatrixFileError(
            f"{path.name} has neither DMIG nor GRID cards. Give the bulk data with the points."
        )
    return [(number, k) for number in sorted(rows, key=int) for k in range(rows[number])]


def read_dmig(path: Path, name: str | None = None) -> tuple[sparse.csr_array, list[Place]]:
    """Matrix of DMIG cards, and what its rows are.

    Parameters
    ----------
    path
        Bulk data or punch file.
    name
        Of the matrix; needed where the file has several.

    Returns
    -------
    The matrix, rows in the order of nodes and directions, and node and direction of each.

    Raises
    ------
    MatrixFileError
        Where the file has no such matrix, or one that is complex or rectangular.
    """
    heads, entries = _dmig_cards(path)
    if name is None and len(heads) == 1:
        name = next(iter(heads))
    if name not in heads:
        raise MatrixFileError(
            f"{path.name} holds the DMIG matrices {', '.join(heads) or 'none'}, and "
            f"{name!r} was asked for. Name one of them."
        )
    head = [*heads[name].fields, *[""] * 4]
    if head[3] not in ("1", "6") or head[4] not in ("1", "2"):
        raise MatrixFileError(
            f"DMIG {name} of {path.name} has form {head[3]} and type {head[4]}. Allowed are "
            "form 1 or 6 (square, symmetric) and type 1 or 2 (real)."
        )
    triples = list(_entries(path, entries.get(name, [])))
    places = sorted(
        {place for row, column, _ in triples for place in (row, column)}, key=_order
    )
    number = {place: k for k, place in enumerate(places)}
    rows = [number[row] for row, _, _ in triples]
    columns = [number[column] for _, column, _ in triples]
    values = [value for _, _, value in triples]
    size = len(places)
    return sparse.csr_array((values, (rows, columns)), shape=(size, size)), places


def _order(place: Place) -> tuple[int, int]:
    return int(place[0]), place[1]


def _dmig_cards(path: Path) -> tuple[dict[str, Card], dict[str, list[Card]]]:
    heads: dict[str, Card] = {}
    entries: dict[str, list[Card]] = {}
    for card in read_cards(path, ("DMIG",)):
        if card.fields[2] == "0":
            heads[card.fields[1]] = card
        else:
            entries.setdefault(card.fields[1], []).append(card)
    return heads, entries


def _entries(path: Path, cards: list[Card]) -> Iterator[tuple[Place, Place, float]]:
    for card in cards:
        column = _place(path, card, card.fields[2], card.fields[3])
        rest = [text for text in card.fields[5:]]
        for k in range(0, len(rest) - 2, 4):
            if rest[k]:
                row = _place(path, card, rest[k], rest[k + 1])
                yield row, column, real_field(path, card, rest[k + 2])


def _place(path: Path, card: Card, node: str, component: str) -> Place:
    if not node.isdecimal() or component not in "0123456":
        raise MatrixFileError(
            f"Line {card.line} of {path.name} names node {node!r}, component {component!r}. "
            "Allowed are numbers of nodes and components 0 to 6."
        )
    return node, max(int(component or SCALAR_POINT) - 1, 0)


def real_field(path: Path, card: Card, text: str) -> float:
    """Parse a number as Nastran writes it: `1.5-3` is 1.5e-3, and empty is 0."""
    plain = text.upper().replace("D", "E")
    for k in range(1, len(plain)):
        if plain[k] in "+-" and plain[k - 1] not in "E+-":
            plain = f"{plain[:k]}E{plain[k:]}"
            break
    try:
        return float(plain or 0.0)
    except ValueError:
        raise MatrixFileError(
            f"Line {card.line} of {path.name} has {text!r} where a number should be."
        ) from None


def read_cards(path: Path, kinds: tuple[str, ...] | None = None) -> Iterator[Card]:
    """Read cards with their continuations, fields stripped, continuation marks out.

    Parameters
    ----------
    path
        Bulk data file.
    kinds
        Names of the cards; all where not given.

    Yields
    ------
    Cards in the order of the file.
    """
    first, fields = 0, list[str]()
    wanted = False
    for number, raw in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        line = raw.split("$", 1)[0].rstrip()
        if not line.strip():
            continue
        parts = _fields(line)
        kind = parts[0].rstrip("*").upper()
        if kind == "" or kind.startswith("+"):
            if wanted:
                fields += parts[1:]
            continue
        if wanted:
            yield Card(first, tuple(fields))
        wanted = kinds is None or kind in kinds
        first, fields = number, [kind, *parts[1:]]
    if wanted:
        yield Card(first, tuple(fields))


def _fields(line: str) -> list[str]:
    """Name and fields of one line; eight small or four large fields, padded.

    A large-field line has four fields, so that two of them make up a small-field one.
    """
    if "," in line:
        parts = [part.strip() for part in line.split(",")]
        wide = "*" in parts[0]
    else:
        wide = line[:8].rstrip().endswith("*")
        width = 16 if wide else 8
        text = line[:_LONGEST].expandtabs(8)
        parts = [text[:8].strip()]
        parts += [text[k : k + width].strip() for k in range(8, 72, width)]
    count = 4 if wide else 8
    return [parts[0], *(parts[1 : count + 1] + [""] * count)[:count]]
