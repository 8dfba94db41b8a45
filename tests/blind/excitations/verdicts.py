"""How often common effects are named, by the way in which the rig was excited."""

from pathlib import Path
from typing import Any

from tests.blind.answers import SILENT
from tests.blind.tables import Row, leaves, rate

UNMEASURED = ("ambient",)
"""Excitations that nobody measures: only spectra can be compared."""


def excitation_row(
    truth: dict[str, Any], report: dict[str, Any] | None, row: Row, sealed: Path, result: Path
) -> Row:
    """Return the figures of one case with its excitation, and whether anything was noticed."""
    noticed = report is not None and row["verdict"] not in SILENT
    return row | {"excitation": truth["excitation"], "noticed": noticed}


def tabulate(rows: list[Row]) -> dict[str, Any]:
    """All tables."""
    measured = [row for row in rows if row["excitation"] not in UNMEASURED]
    ways = sorted({row["excitation"] for row in rows})
    kinds = sorted({row["truth"][0] for row in rows})
    return {
        "cases": len(rows),
        "named, all but ambient": rate(row["exact"] for row in measured),
        "named": rate(row["exact"] for row in rows),
        "family, all but ambient": rate(row["family"] for row in measured),
        "a name that is wrong": rate(bool(row["named"]) and not row["exact"] for row in rows),
        "ambient: noticed": rate(r["noticed"] for r in rows if r["excitation"] in UNMEASURED),
        "by excitation": {
            way: rate(row["exact"] for row in rows if row["excitation"] == way) for way in ways
        },
        "by effect, all but ambient": {
            kind: rate(row["exact"] for row in measured if row["truth"][0] == kind)
            for kind in kinds
        },
    }


def text_of(tables: dict[str, Any], rows: list[Row]) -> str:
    """Write the tables, and a line for each case."""
    lines = ["Excitations", *leaves(tables, 2), ""]
    lines += [
        f"  {line_of(row)}" for row in sorted(rows, key=lambda r: (r["excitation"], r["truth"]))
    ]
    return "\n".join(lines) + "\n"


def line_of(row: Row) -> str:
    """Write one case on a line."""
    told = "+".join(row["named"]) or "|".join(row["undecided"]) or row["verdict"]
    right = "right" if row["exact"] else "WRONG" if row["named"] else "not named"
    return (
        f"{row['case']} {row['excitation']:13}{row['truth'][0]:20}"
        f"{row['effect_to_noise_db']:5.1f} dB  {row['size']} {row['mode']:14}{right:10}"
        f"{row['seconds']:5.0f} s  {told}"
    )
