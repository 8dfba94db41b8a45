"""Tables of what a battery shows, as values and as text."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.stats import binomtest

from .laws import FAULTS

Row = dict[str, Any]
STRONG_DB = 10.0
BINS = (0.0, 0.5, 0.7, 0.9, 0.99, 1.0)


def rate(hits: Iterable[Any]) -> dict[str, Any]:
    """Share with its 95 % interval of Clopper and Pearson."""
    found = [bool(hit) for hit in hits]
    if not found:
        return {"of": 0}
    interval = binomtest(sum(found), len(found)).proportion_ci(0.95, method="exact")
    return {
        "right": sum(found), "of": len(found), "share": sum(found) / len(found),
        "low": float(interval.low), "high": float(interval.high),
    }  # fmt: skip


def tabulate(rows: list[Row]) -> dict[str, Any]:
    """All tables."""
    listed = [row for row in rows if row["group"] == "listed"]
    strong = [row for row in listed if row["effect_to_noise_db"] >= STRONG_DB]
    physics = [row for row in strong if row["physics"]]
    return {
        "cases": len(rows),
        "failed": rate(row["failed"] for row in rows),
        "naming": {
            "physics": _naming(physics),
            "faults": _naming([row for row in strong if row["truth"][0] in FAULTS]),
            "weak": _naming([row for row in listed if row not in strong]),
            "by_effect": _split(strong, lambda row: row["truth"][0]),
            "by_mode": _split(strong, lambda row: row["mode"]),
            "by_snr": _split(strong, lambda row: f"{row['snr_db']} dB"),
            "by_size": _split(strong, lambda row: f"{row['size']} masses"),
            "by_stiffness": _split(strong, lambda row: f"{row['stiffness_sd']:.0%} stiffness"),
            "by_start": _split(strong, lambda row: "at rest" if row["at_rest"] else "moving"),
            "by_noise": _split(strong, lambda row: "coloured" if row["coloured"] else "white"),
        },
        "confusion": _confusion(listed),
        "nothing": _nothing(rows),
        "outside": _outside(rows),
        "two": _two(rows),
        "gap": _gap(rows),
        "numbers": _numbers(listed),
        "calibration": _calibration(rows),
        "cost": _cost(rows),
    }


def _naming(rows: list[Row]) -> dict[str, Any]:
    return {
        "exact": rate(row["exact"] for row in rows),
        "family": rate(row["family"] for row in rows),
        "place": rate(
            row["place"] for row in rows if row["family"] and row["place"] is not None
        ),
        "spurious": rate(row["spurious"] for row in rows),
        "undecided": rate(row["verdict"] == "undecided" for row in rows),
    }


def _split(rows: list[Row], key: Callable[[Row], str]) -> dict[str, Any]:
    parts: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        parts[key(row)].append(row)
    return {name: _naming(parts[name]) for name in sorted(parts)}


def _confusion(rows: list[Row]) -> dict[str, dict[str, int]]:
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        told = "+".join(row["named"]) or "|".join(row["undecided"]) or row["verdict"]
        table[row["truth"][0]][told] += 1
    return {name: dict(table[name].most_common()) for name in sorted(table)}


def _nothing(rows: list[Row]) -> dict[str, Any]:
    clear = [row for row in rows if row["group"] == "nothing"]
    moved = [row for row in rows if row["group"] == "parameters"]
    return {
        "discovery_claimed": rate(row["claimed"] for row in clear),
        "said_parameters_only": rate(row["verdict"] == "parameters_only" for row in clear),
        "by_noise": {
            colour: rate(r["claimed"] for r in clear if r["coloured"] == (colour == "coloured"))
            for colour in ("white", "coloured")
        },
        "parameters_only_right": rate(row["exact"] for row in moved),
    }


def _outside(rows: list[Row]) -> dict[str, Any]:
    outside = [row for row in rows if row["group"] == "outside"]
    return {
        "unknown_or_undecided": rate(row["exact"] for row in outside),
        "sure_of_another_name": rate(row["sure_wrong"] for row in outside),
        "sure_of_a_wrong_family": rate(row["sure_far"] for row in outside),
        "by_effect": {
            name: rate(row["exact"] for row in outside if row["truth"][0] == name)
            for name in sorted({row["truth"][0] for row in outside})
        },
    }


def _two(rows: list[Row]) -> dict[str, Any]:
    two = [row for row in rows if row["group"] == "two"]
    return {
        "both": rate(row["exact"] for row in two),
        "at_least_one": rate(row["one"] for row in two),
        "with_others": rate(row["spurious"] for row in two),
    }


def _gap(rows: list[Row]) -> dict[str, Any]:
    told = [row for row in rows if "gap_augmented" in row]
    due = [
        row
        for row in rows
        if row["predictable"] and row["group"] in ("listed", "nothing", "parameters")
    ]
    physics = [row for row in due if row["physics"]]
    worse = [row for row in told if "gap_nominal" in row]
    return {
        "at_the_floor": rate(row.get("gap_augmented", np.inf) <= 1.0 for row in physics),
        "refitted_nominal_at_the_floor": rate(
            row.get("gap_refitted_nominal", np.inf) <= 1.0 for row in physics
        ),
        "nothing_missing_at_the_floor": rate(
            row.get("gap_augmented", np.inf) <= 1.0 for row in due if not row["physics"]
        ),
        "worse_than_nominal": rate(
            # Below a tenth of the floor, two percent are nothing.
            row["gap_augmented"] > 1.02 * row["gap_nominal"] and row["gap_augmented"] > 0.1
            for row in worse
        ),
        "median_over_floor": _median(row["gap_augmented"] for row in told if row["physics"]),
        "from": dict(Counter(row["gap_from"] for row in told)),
    }


def _numbers(rows: list[Row]) -> dict[str, Any]:
    found = [row for row in rows if "leading_error" in row]
    return {
        "median_error": _median(row["leading_error"] for row in found),
        "covered": rate(row["leading_z"] <= 1.96 for row in found),
        "median_z": _median(row["leading_z"] for row in found),
        "missing": sum("leading_missing" in row for row in rows),
        "by_effect": {
            name: {
                "median_error": _median(
                    r["leading_error"] for r in found if r["truth"][0] == name
                ),
                "covered": rate(r["leading_z"] <= 1.96 for r in found if r["truth"][0] == name),
            }
            for name in sorted({row["truth"][0] for row in found})
        },
    }


def _calibration(rows: list[Row]) -> list[dict[str, Any]]:
    stated = [one for row in rows for one in row["stated"]]
    table = []
    for low, high in itertools.pairwise(BINS):
        inside = [
            o for o in stated if low <= o["probability"] < high or o["probability"] == high == 1
        ]
        mean = float(np.mean([o["probability"] for o in inside])) if inside else None
        table.append(
            {"from": low, "to": high, "stated": mean, **rate(o["right"] for o in inside)}
        )
    sure = [o["right"] for o in stated if o["probability"] >= 0.9]
    return [*table, {"from": 0.9, "to": 1.0, "stated": None, **rate(sure)}]


def _cost(rows: list[Row]) -> dict[str, Any]:
    def of(key: str) -> dict[str, Any]:
        values = [row[key] for row in rows if row.get(key) is not None]
        if not values:
            return {}
        return {
            "median": float(np.median(values)),
            "p95": float(np.quantile(values, 0.95)),
            "worst": max(values),
        }

    return {
        "seconds": of("seconds"),
        "cpu_seconds": of("cpu_seconds"),
        "mebibytes": of("mebibytes"),
    }


def _median(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.median(found)) if found else None


SPLITS = (
    "by_mode", "by_snr", "by_size", "by_stiffness", "by_start", "by_noise", "by_effect"
)  # fmt: skip


def text_of(tables: dict[str, Any], title: str = "blind cases") -> str:
    """Write all tables as text."""
    naming = tables["naming"]
    heads = "".join(f"{name:>24}" for name in ("exact", "family", "place"))
    lines = [
        f"{title}: {tables['cases']} cases; no report from {_said(tables['failed'])}",
        "",
        "1. Naming, effect-to-noise 10 dB or more, with 95 % intervals",
        f"{'':28}{heads}{'spurious':>10}{'undecided':>10}",
        _naming_line("physics", naming["physics"]),
        _naming_line("faults", naming["faults"]),
        _naming_line("(below 10 dB)", naming["weak"]),
    ]
    for split in SPLITS:
        lines += ["", *(_naming_line(name, part) for name, part in naming[split].items())]
    lines += ["", "   Confusion (true: told)"]
    for name, told in tables["confusion"].items():
        said = ", ".join(f"{what} {count}" for what, count in told.items())
        lines.append(f"   {name:24}{said}")
    lines += ["", "2. Nothing missing, outside the list, two at once"]
    for part in ("nothing", "outside", "two"):
        lines += leaves(tables[part], 3)
    lines += ["", "3. The gap on the held-out record, against the clean truth"]
    lines += [*leaves(tables["gap"], 3), "", "4. Numbers", *leaves(tables["numbers"], 3)]
    lines.append("   probability stated: right")
    for one in tables["calibration"]:
        mean = "" if one["stated"] is None else f" (mean {one['stated']:.3f})"
        lines.append(f"   {one['from']:.2f} to {one['to']:.2f}{mean}: {_said(one)}")
    return "\n".join([*lines, "", "5. Cost", *leaves(tables["cost"], 3)]) + "\n"


def _naming_line(name: str, part: dict[str, Any]) -> str:
    cells = "".join(f"{_said(part[key]):>24}" for key in ("exact", "family", "place"))
    few = "".join(f"{_few(part[key]):>10}" for key in ("spurious", "undecided"))
    return f"{name:28}{cells}{few}"


def leaves(part: dict[str, Any], indent: int) -> list[str]:
    """Write a tree of figures, one line each."""
    lines = []
    for name, value in part.items():
        label = " " * indent + name.replace("_", " ")
        if isinstance(value, dict) and "of" in value:
            lines.append(f"{label}: {_said(value)}")
        elif isinstance(value, dict):
            lines += [f"{label}:", *leaves(value, indent + 2)]
        else:
            lines.append(f"{label}: {'-' if value is None else f'{value:.4g}'}")
    return lines


def _said(one: dict[str, Any]) -> str:
    if not one["of"]:
        return "-"
    ends = f"{100 * one['low']:.0f}-{100 * one['high']:.0f}"
    return f"{100 * one['share']:.1f} % ({ends}) of {one['of']}"


def _few(one: dict[str, Any]) -> str:
    return f"{one['right']}/{one['of']}" if one["of"] else "-"


BESIDE = {
    "physics named exactly": "naming physics exact",
    "  the family": "naming physics family",
    "  the place": "naming physics place",
    "faults named exactly": "naming faults exact",
    "below 10 dB, exactly": "naming weak exact",
    "nothing missing, but claimed": "nothing discovery_claimed",
    "only constants, said so": "nothing parameters_only_right",
    "outside: unknown or undecided": "outside unknown_or_undecided",
    "  sure of a wrong family": "outside sure_of_a_wrong_family",
    "two at once: both": "two both",
    "unseen record at the floor": "gap at_the_floor",
    "worse than the nominal": "gap worse_than_nominal",
    "leading number, median error": "numbers median_error",
    "  within its 95 % interval": "numbers covered",
    "p of 0.9 and more: right": "calibration",
    "CPU median [s]": "cost cpu_seconds median",
    "CPU worst [s]": "cost cpu_seconds worst",
    "memory, worst [MiB]": "cost mebibytes worst",
}
"""What is told of several tools beside each other, and where it stands in the tables."""


def beside(tables: dict[str, dict[str, Any]]) -> str:
    """Write the figures of several tools on the same cases into one table."""
    names = list(tables)
    lines = [f"{'':32}" + "".join(f"{name:>24}" for name in names)]
    lines.append(f"{'cases':32}" + "".join(f"{tables[n]['cases']:>24}" for n in names))
    for label, way in BESIDE.items():
        cells = [_told(_at(tables[name], way.split())) for name in names]
        lines.append(f"{label:32}" + "".join(f"{cell:>24}" for cell in cells))
    return "\n".join(lines) + "\n"


def _at(tables: Any, way: list[str]) -> Any:
    for step in way:
        tables = tables.get(step) if isinstance(tables, dict) else None
    # Of the bins of stated probability, the last holds all that are sure.
    return tables[-1] if isinstance(tables, list) else tables


def _told(value: Any) -> str:
    if isinstance(value, dict):
        return _said(value)
    return "-" if value is None else f"{value:.4g}"
