"""Score of one report beside its truth: what was right and what was not."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from .laws import LAWS, PHYSICS, family_of

SILENT = ("nothing_missing", "parameters_only")
OPEN = ("unknown_effect", "undecided")
Report = dict[str, Any]
Truth = dict[str, Any]


def judge(truth: Truth, report: Report | None, sealed: Path, result: Path) -> dict[str, Any]:
    """Compare one report with its truth; a report that is missing is a wrong answer."""
    row = _head(truth)
    row["failed"] = report is None
    report = report or {"verdict": "failed", "effects": [], "undecided": []}
    named = _named(report)
    row["verdict"] = str(report.get("verdict"))
    row["named"] = [name for name, _, _ in named]
    row["undecided"] = _undecided(report)
    row["seconds_stated"] = report.get("seconds")
    row |= _naming(truth, row, named)
    row |= _numbers(truth, row, report)
    row |= _gap(truth, report, sealed, result)
    row["stated"] = [
        {"probability": p, "right": _is_true(truth, name, where)} for name, where, p in named
    ]
    return row


def _head(truth: Truth) -> dict[str, Any]:
    design = truth["design"]
    kinds = [effect["effect"] for effect in truth["effects"]]
    return {
        "case": truth["case"],
        "group": truth["group"],
        "truth": kinds,
        "places": [effect["where"] for effect in truth["effects"]],
        "physics": bool(kinds) and all(kind in PHYSICS for kind in kinds),
        "predictable": truth["predictable"],
        "effect_to_noise_db": truth["effect_to_noise_db"],
        "mode": design["mode"],
        "snr_db": design["snr_db"],
        "size": design["size"],
        "drive": design["drive"],
        "coloured": design["coloured"],
        "at_rest": design["at_rest"],
        "stiffness_sd": design["stiffness_sd"],
    }


def _named(report: Report) -> list[tuple[str, dict[str, str], float]]:
    if report.get("verdict") in (*SILENT, *OPEN, "failed"):
        return []
    return [
        (str(e.get("effect")), e.get("where") or {}, float(e.get("probability") or 0.0))
        for e in report.get("effects") or []
    ]


def _undecided(report: Report) -> list[str]:
    if report.get("verdict") != "undecided":
        return []
    given = report.get("undecided") or []
    return sorted({str(e.get("effect")) if isinstance(e, dict) else str(e) for e in given})


def _names(effect: dict[str, Any]) -> tuple[str, ...]:
    return (effect["effect"], *LAWS[effect["effect"]].aliases)


def _same_place(told: dict[str, str], true: dict[str, str]) -> bool:
    return (told.get("kind"), told.get("id")) == (true["kind"], true["id"])


def _is_true(truth: Truth, name: str, where: dict[str, str]) -> bool:
    return any(
        name in _names(effect) and _same_place(where, effect["where"])
        for effect in truth["effects"]
    )


def _naming(
    truth: Truth, row: dict[str, Any], named: list[tuple[str, dict[str, str], float]]
) -> dict[str, Any]:
    effects, verdict = truth["effects"], row["verdict"]
    if truth["group"] in ("nothing", "parameters"):
        wanted = "nothing_missing" if truth["group"] == "nothing" else "parameters_only"
        fine = {wanted, *truth["equivalents"]}
        told = set(row["named"]) or set(row["undecided"]) or {verdict}
        claimed = verdict not in SILENT and not told <= fine
        return {"exact": told <= fine, "claimed": claimed}
    if truth["group"] == "outside":
        own = row["named"] == [effects[0]["effect"]] or set(row["named"]) <= set(
            _names(effects[0])
        )
        right = verdict in OPEN or (bool(row["named"]) and own)
        sure = [(family_of(name), name) for name, _, p in named if p >= 0.9]
        kin = (*effects[0]["kin"], effects[0]["family"])
        lies = [f for f, name in sure if name not in _names(effects[0])]
        return {
            "exact": right, "sure_wrong": bool(lies),
            "sure_far": any(f not in kin for f in lies),
        }  # fmt: skip
    if truth["group"] == "two":
        found = [any(_is_true_one(e, n, w) for n, w, _ in named) for e in effects]
        return {"exact": all(found), "one": any(found), "spurious": len(named) > sum(found)}
    return _single(truth, row, named)


def _is_true_one(effect: dict[str, Any], name: str, where: dict[str, str]) -> bool:
    return name in _names(effect) and _same_place(where, effect["where"])


def _single(
    truth: Truth, row: dict[str, Any], named: list[tuple[str, dict[str, str], float]]
) -> dict[str, Any]:
    effect = truth["effects"][0]
    allowed = {effect["effect"], *truth["equivalents"]}
    if row["verdict"] == "undecided":
        told = set(row["undecided"])
        exact = effect["effect"] in told and told <= allowed
        kin = exact or (bool(told) and {family_of(n) for n in told} == {effect["family"]})
        return {"exact": exact, "family": kin, "place": None, "spurious": False}
    if row["verdict"] in SILENT:
        right = row["verdict"] in truth["equivalents"]
        return {"exact": right, "family": right, "place": None, "spurious": False}
    hits = [where for name, where, _ in named if name == effect["effect"]]
    kin = any(family_of(name) == effect["family"] for name, _, _ in named)
    near = [where for name, where, _ in named if family_of(name) == effect["family"]]
    return {
        "exact": bool(hits) and len(named) == 1,
        "family": kin,
        "place": any(_same_place(w, effect["where"]) for w in near) if near else None,
        "spurious": len(named) > bool(near),
    }


def _numbers(truth: Truth, row: dict[str, Any], report: Report) -> dict[str, Any]:
    """Error and coverage of the leading parameter of an effect that was named in its place."""
    if truth["group"] != "listed" or not row.get("exact") or row["verdict"] in (*SILENT, *OPEN):
        return {}
    effect = truth["effects"][0]
    name = effect["leading"]
    if not name or _wanders(truth, effect):
        return {}
    told = next(e for e in report["effects"] if e["effect"] == effect["effect"])
    if not _same_place(told.get("where") or {}, effect["where"]):
        return {}
    parameters = told.get("parameters") or {}
    estimate = parameters.get(name)
    if not estimate:
        return {"leading_missing": name}
    # A change that is told for another span than the campaign is carried over to it.
    span = (parameters.get("span_s") or {}).get("value")
    factor = truth["world"]["campaign_s"] / span if span else 1.0
    true, value = effect["parameters"][name], estimate["value"] * factor
    sd = (estimate.get("sd") or 0.0) * abs(factor)
    off = abs(value - true)
    return {
        "leading": name,
        "leading_error": off / abs(true),
        # An interval of no width holds what it is at, and nothing else.
        "leading_z": off / sd if sd > 0 else float("inf") if off else 0.0,
    }


def _wanders(truth: Truth, effect: dict[str, Any]) -> bool:
    """Whether a sensor drifts in a way that one number for the campaign does not tell."""
    kind = truth["world"]["wander"]["kind"]
    return bool(effect["effect"] == "sensor_drift" and kind != "campaign")


def _gap(truth: Truth, report: Report, sealed: Path, result: Path) -> dict[str, Any]:
    """Errors of the free run on the held-out record against the clean truth, over the noise.

    From ``holdout.npz`` of the result (`channels`, `t`, `nominal`, `augmented`: [time, sensor])
    where there is one; else from the report's own figures, the true noise taken out.
    """
    if not truth["predictable"]:
        return {}
    with np.load(sealed / "clean.npz") as kept:
        clean, measured, noise = kept["clean"], kept["measured"], kept["noise"]
        channels = kept["channels"].tolist()
    runs = result / "holdout.npz"
    if runs.exists():
        with np.load(runs) as told:
            order = [told["channels"].tolist().index(channel) for channel in channels]
            return {
                f"gap_{name}": float(np.mean(_rms(told[name][:, order] - clean) / noise))
                for name in ("nominal", "refitted_nominal", "augmented")
                if name in told
            } | {"gap_from": "holdout.npz"}
    gap = report.get("gap") or {}
    floor = float(np.mean(noise / measured.std(axis=0)))
    rows = {
        f"gap_{name}": float(np.sqrt(max(gap[name] ** 2 - floor**2, 0.0)) / floor)
        for name in ("nominal", "refitted_nominal", "augmented")
        if isinstance(gap.get(name), int | float)
    }
    return rows | ({"gap_from": "report"} if rows else {})


def _rms(values: Any) -> Any:
    return np.sqrt(np.mean(values**2, axis=0))


def read_report(folder: Path) -> Report | None:
    """Read a report; None where there is none that can be read."""
    try:
        report = json.loads((folder / "report.json").read_text())
    except (OSError, ValueError):
        return None
    return report if isinstance(report, dict) else None
