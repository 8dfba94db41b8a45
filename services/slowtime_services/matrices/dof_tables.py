"""Maps of degrees of freedom: CSV tables, CalculiX .dof files, Nastran bulk data."""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from slowtime.finite_elements.degrees_of_freedom import DIRECTIONS, DofMap

from .errors import MatrixFileError
from .nastran_bulk import BULK, has_dmig, read_dmig, read_grids, read_points

COLUMNS = ("node", "direction")
PLACES = ("x", "y", "z")
_WORDS = {
    **{name: k for k, name in enumerate(DIRECTIONS)},
    **{str(k + 1): k for k in range(6)},
    **{name: k for k, name in enumerate(("x", "y", "z", "xx", "yy", "zz"))},
}


def read_dof_map(path: Path, positions: Path | None = None) -> DofMap:
    """Read which node and direction each row of the matrices is.

    Parameters
    ----------
    path
        CSV with the columns `node`, `direction` (ux, uy, uz, rx, ry, rz, or 1 to 6) and, where
        known, `x`, `y` and `z` [m], one row for each row of the matrices; or a CalculiX .dof
        file, with a line `node.direction` each; or Nastran bulk data, with DMIG cards or, for
        matrices over all points (KGG, MGG), with GRID cards.
    positions
        CSV with the columns `node`, `x`, `y`, `z`, bulk data with GRID cards, or input of
        Abaqus or CalculiX (.inp) with *NODE, where the positions are in a file of their own.

    Returns
    -------
    The map; nodes without a position are at zero.

    Raises
    ------
    MatrixFileError
        Where the file is none of these.
    """
    if not path.is_file():
        raise MatrixFileError(f"There is no file {path}. Check the path in the model file.")
    suffix = path.suffix.lower()
    where: dict[str, Sequence[float]] = {}
    if suffix == ".dof":
        places = _from_calculix(path)
    elif suffix in BULK:
        places = read_dmig(path)[1] if has_dmig(path) else read_points(path)
        where |= read_grids(path)
    else:
        places, where = _from_table(path)
    if positions is not None:
        where |= _positions(positions)
    return map_of(places, where)


def map_of(places: Sequence[tuple[str, int]], where: Mapping[str, Sequence[float]]) -> DofMap:
    """Map from node and direction of each row, and positions of the nodes.

    Parameters
    ----------
    places
        Node and direction, 0 to 5, of each row.
    where
        Position of each node [m].
    """
    names = tuple(dict.fromkeys(node for node, _ in places))
    number = {name: k for k, name in enumerate(names)}
    try:
        return DofMap(
            node_names=names,
            coordinates=np.array([where.get(name, (0.0, 0.0, 0.0)) for name in names], float),
            node=np.array([number[node] for node, _ in places]),
            direction=np.array([direction for _, direction in places]),
        )
    except ValueError as error:
        raise MatrixFileError(str(error)) from error


def _from_table(path: Path) -> tuple[list[tuple[str, int]], dict[str, Sequence[float]]]:
    places = list[tuple[str, int]]()
    where = dict[str, Sequence[float]]()
    for line, row in _rows(path, COLUMNS):
        word = row["direction"].lower()
        if word not in _WORDS:
            raise MatrixFileError(
                f"Line {line} of {path.name} has the direction {row['direction']!r}. Allowed "
                f"are {', '.join(DIRECTIONS)}, or 1 to 6."
            )
        places.append((row["node"], _WORDS[word]))
        if all(row.get(axis) for axis in PLACES):
            where[row["node"]] = _place(path, line, row)
    return places, where


def _positions(path: Path) -> dict[str, Sequence[float]]:
    if path.suffix.lower() == ".inp":
        return _from_input(path)
    if path.suffix.lower() in BULK:
        return dict(read_grids(path))
    rows = _rows(path, ("node", *PLACES))
    return {row["node"]: _place(path, line, row) for line, row in rows}


def _place(path: Path, line: int, row: Mapping[str, str]) -> tuple[float, ...]:
    try:
        return tuple(float(row[axis]) for axis in PLACES)
    except ValueError:
        raise MatrixFileError(
            f"Line {line} of {path.name} has no three numbers in x, y and z."
        ) from None


def _rows(path: Path, needed: Sequence[str]) -> list[tuple[int, dict[str, str]]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        names = [name.strip().lower() for name in reader.fieldnames or ()]
        missing = [name for name in needed if name not in names]
        if missing:
            raise MatrixFileError(
                f"{path.name} has the columns {', '.join(names) or 'none'}. Needed are "
                f"{', '.join(needed)}; {', '.join(missing)} is missing."
            )
        reader.fieldnames = names
        return [
            (line, {key: (value or "").strip() for key, value in row.items() if key})
            for line, row in enumerate(reader, 2)
        ]


def _from_calculix(path: Path) -> list[tuple[str, int]]:
    found = []
    for line, text in enumerate(path.read_text(encoding="latin-1").split(), 1):
        match = re.fullmatch(r"(\d+)\.([1-6])", text)
        if match is None:
            raise MatrixFileError(
                f"Entry {line} of {path.name} is {text!r}. Allowed is node.direction, as in "
                "12.3."
            )
        found.append((match[1], int(match[2]) - 1))
    return found


def _from_input(path: Path) -> dict[str, Sequence[float]]:
    """Positions of the blocks *NODE of an input of Abaqus or CalculiX."""
    found: dict[str, Sequence[float]] = {}
    inside = False
    for line, text in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        if text.startswith("**") or not text.strip():
            continue
        if text.startswith("*"):
            words = [word.strip().upper() for word in text.split(",")]
            inside = words[0] == "*NODE"
            if inside and any(word.startswith(("INPUT", "SYSTEM")) for word in words):
                raise MatrixFileError(
                    f"Line {line} of {path.name} is {text.strip()!r}. Give the nodes in this "
                    "file, in rectangular coordinates, or a CSV of node, x, y and z."
                )
            continue
        if inside:
            name, *place = (part.strip() for part in text.split(","))
            numbers = dict(zip(PLACES, [*place, "0", "0", "0"], strict=False))
            found[name] = _place(path, line, {k: v or "0" for k, v in numbers.items()})
    if not found:
        raise MatrixFileError(f"{path.name} has no *NODE. Give the input with the nodes.")
    return found
