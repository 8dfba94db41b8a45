"""Cases of a folder: by its table `cases.csv`, or one for each subfolder with records."""

import csv
import dataclasses
from collections.abc import Iterator
from pathlib import Path

TABLE = "cases.csv"
COLUMNS = ("name", "model", "records", "holdout")
MODELS = (".yaml", ".yml")
HELD_OUT = "holdout"
"""Records whose name begins so are held out."""
SEPARATOR = ";"


@dataclasses.dataclass(frozen=True, slots=True)
class Case:
    """A model and records of it.

    Parameters
    ----------
    name
        Unique within the folder; names the folder of its results.
    model
        Model file.
    records
        Files to learn from.
    holdout
        Files that are held out; the last thirds of the others if there are none.
    """

    name: str
    model: Path
    records: tuple[Path, ...]
    holdout: tuple[Path, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that are read."""
        return (self.model, *self.records, *self.holdout)


def cases_of(folder: Path) -> list[Case]:
    """List the cases of a folder.

    Where it holds `cases.csv`, each row of that is a case: columns `name`, `model`, `records`
    and, if any, `holdout`, with several files separated by semicolons, relative to the folder.
    Otherwise each subfolder with records is a case. Its model file is the one `.yaml` in it, or
    the one in the folder above; files whose names begin with `holdout` are held out, all others
    are records.

    Parameters
    ----------
    folder
        That is there.

    Returns
    -------
    Cases in the order of the table, or by name.

    Raises
    ------
    ValueError
        If a case has no model, several, or no records, if a file is missing, or if there is no
        case at all; names what is wrong and where.
    """
    table = folder / TABLE
    found = list(_of_table(table)) if table.is_file() else list(_of_subfolders(folder))
    if not found:
        raise ValueError(
            f"There are no cases in {folder}. Give a folder with {TABLE} "
            f"({', '.join(COLUMNS)}), or with one subfolder for each case."
        )
    names = [case.name for case in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"Several cases of {folder} are called {twice[0]!r}. Rename all but one."
        )
    return found


def _of_table(table: Path) -> Iterator[Case]:
    with table.open(newline="", encoding="utf-8-sig") as stream:
        reader = csv.DictReader(stream)
        missing = [c for c in COLUMNS[:3] if c not in (reader.fieldnames or ())]
        if missing:
            raise ValueError(
                f"{table} has no column {missing[0]!r}. Its first row has to name "
                f"{', '.join(COLUMNS[:3])} and, if any, {COLUMNS[3]}."
            )
        for number, row in enumerate(reader, start=2):
            where = f"{table}, line {number}"
            name = (row["name"] or "").strip()
            if not name or Path(name).name != name:
                raise ValueError(
                    f"{where}: {name!r} names no case. Give a name without slashes."
                )
            yield _checked(
                Case(
                    name,
                    table.parent / (row["model"] or "").strip(),
                    _files(table.parent, row["records"]),
                    _files(table.parent, row.get("holdout")),
                ),
                where,
            )


def _files(folder: Path, field: str | None) -> tuple[Path, ...]:
    names = (one.strip() for one in (field or "").split(SEPARATOR))
    return tuple(folder / name for name in names if name)


def _of_subfolders(folder: Path) -> Iterator[Case]:
    above = _models(folder)
    for inner in sorted(path for path in folder.iterdir() if path.is_dir()):
        files = sorted(
            path for path in inner.iterdir() if path.is_file() and path.name[0] != "."
        )
        if not files:
            continue
        models = _models(inner) or above
        if len(models) != 1:
            raise ValueError(
                f"{inner} has {len(models)} model files ({', '.join(MODELS)}). Put one there, "
                f"or one in {folder} for all cases."
            )
        records = [path for path in files if path.suffix.lower() not in MODELS]
        held_out = [path for path in records if path.name.startswith(HELD_OUT)]
        learnt = [path for path in records if path not in held_out]
        yield _checked(Case(inner.name, models[0], tuple(learnt), tuple(held_out)), str(inner))


def _models(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in MODELS)


def _checked(case: Case, where: str) -> Case:
    """Refuse a case without records, or of which a file is missing."""
    if not case.records:
        raise ValueError(f"{where}: case {case.name!r} has no records. Add one.")
    absent = [path for path in case.files if not path.is_file()]
    if absent:
        raise ValueError(f"{where}: there is no file {absent[0]}.")
    return case
