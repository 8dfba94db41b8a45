"""What a diagnosis made of a law that it cannot know: unknown, resembling, or a name."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tests.blind.answers import OPEN, SILENT
from tests.blind.laws import LAWS
from tests.blind.tables import Row, leaves, rate

from .families import FAMILIES

SURE = 0.9
"""[probability] From which a name is sure. Source: as in the other tables of hidden cases."""
MOST_OVER_FLOOR = 2.0
"""[1] Error on the held-out record over its noise, wanted at most. Source: a decision."""
AT_THE_FLOOR = 1.1
"""[1] The same, up to which a related law does all that the true one would. Source: errors of
the size of the noise's half would make it 1.12."""
LIKENESS = ("most like", "resembles")
"""Words with which a report says what an unknown force is like."""


def verdict_row(
    truth: dict[str, Any], report: dict[str, Any] | None, row: Row, sealed: Path, result: Path
) -> Row:
    """Return the figures of one case beside those that every case has.

    Parameters
    ----------
    truth
        Of the case, with one effect that is in no list.
    report
        Of the diagnosis; None where it failed.
    row
        Figures of `answers.judge`.
    sealed, result
        Folders of the truth and of the diagnosis.
    """
    kin = LAWS[truth["effects"][0]["effect"]].kin
    over = _error_over_floor(sealed, result)
    lies = [name for name in row["named"] if FAMILIES.get(name, name) not in kin]
    sure = [
        name for name, p in zip(row["named"], _probabilities(row), strict=True) if p >= SURE
    ]
    return row | {
        "error_over_floor": over,
        "said": _said(row, report or {}, kin, over),
        "sure_of_a_wrong_family": any(name in lies for name in sure),
        "resembled": _likeness(report or {}),
    }


def _probabilities(row: Row) -> list[float]:
    return [one["probability"] for one in row["stated"]]


def _said(row: Row, report: dict[str, Any], kin: Iterable[str], over: float | None) -> str:
    """Sort one answer."""
    verdict, named = row["verdict"], row["named"]
    if verdict == "unknown_effect":
        return "resembling" if _likeness(report) else "unknown"
    if verdict == "undecided":
        related = all(FAMILIES.get(name, name) in kin for name in row["undecided"])
        return "undecided among related" if related else "undecided with unrelated"
    if verdict in SILENT or verdict == "failed" or not named:
        return "failed" if row["failed"] else "nothing said"
    if any(FAMILIES.get(name, name) not in kin for name in named):
        return "unrelated name"
    at_floor = over is not None and over <= AT_THE_FLOOR
    return "related name at the noise" if at_floor else "related name above the noise"


def _likeness(report: dict[str, Any]) -> str:
    """Return the sentence that says what an unknown force is like; empty where none does."""
    if report.get("resembles"):
        return str(report["resembles"])
    said = [
        note for note in report.get("notes") or [] if any(w in note.lower() for w in LIKENESS)
    ]
    return " ".join(said) if report.get("verdict") in OPEN else ""


def _error_over_floor(sealed: Path, result: Path) -> float | None:
    """Error of the augmented model on the held-out record over its noise, mean of its sensors.

    It is 1 where the model does all that can be done; None where no free run was written.
    """
    if not (result / "holdout.npz").exists():
        return None
    with np.load(sealed / "clean.npz") as kept, np.load(result / "holdout.npz") as told:
        order = [told["channels"].tolist().index(one) for one in kept["channels"].tolist()]
        left = told["augmented"][:, order] - kept["measured"]
        return float(np.mean(np.sqrt(np.mean(left**2, axis=0)) / kept["noise"]))


RESEMBLING = ("resembling", "related name at the noise", "undecided among related")


def tabulate(rows: list[Row]) -> dict[str, Any]:
    """All tables of laws that are in no list."""
    foretold = [row for row in rows if row["predictable"]]
    over = [row.get("error_over_floor") or np.inf for row in foretold]
    return {
        "cases": len(rows),
        "unknown or resembling": rate(row["said"] in ("unknown", *RESEMBLING) for row in rows),
        "the same, undecided not counted": rate(
            row["said"] in ("unknown", *RESEMBLING[:2]) for row in rows
        ),
        "sure of a wrong family": rate(row["sure_of_a_wrong_family"] for row in rows),
        "held-out error at most twice the noise": rate(one <= MOST_OVER_FLOOR for one in over),
        "median of that error over the noise": float(np.median(over)) if over else None,
        "said": {
            said: rate(row["said"] == said for row in rows)
            for said in sorted({row["said"] for row in rows})
        },
    }


def text_of(tables: dict[str, Any], rows: list[Row]) -> str:
    """Write the tables, and a line for each case."""
    lines = ["Laws that are in no list", *leaves(tables, 2), "", "  true: told"]
    for row in sorted(rows, key=lambda row: row["truth"]):
        lines.append(f"  {line_of(row)}")
    return "\n".join(lines) + "\n"


def line_of(row: Row) -> str:
    """Write one case on a line."""
    told = "+".join(row["named"]) or "|".join(row["undecided"]) or row["verdict"]
    over = row.get("error_over_floor")
    size = "-" if over is None else f"{over:.2f}"
    doubt = "" if row["predictable"] else " (chaotic)"
    return (
        f"{row['case']} {row['truth'][0]:28}{row['effect_to_noise_db']:5.1f} dB  "
        f"{row['said']:30}{size:>8}  {row['seconds']:5.0f} s  {told}{doubt}"
    )
