"""The loop that "cannot decide" must close: an experiment proposed, run, and decisive."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from .answers import read_report
from .experiment import Request, perform
from .files import CASES, SEALED, write_case
from .pairs import PAIRS, build_pair
from .running import RESULTS, Trial, run_one
from .tables import rate


def generate_pairs(out: Path, count: int, seed: int) -> list[str]:
    """Write cases of equivalent pairs, every kind in turn."""
    rng = np.random.default_rng([seed, 6])
    names = [f"{word:08x}" for word in rng.choice(2**32, count, replace=False)]
    seeds = rng.integers(2**62, size=count).tolist()
    kinds = rng.permutation(len(PAIRS))
    for number, (name, own) in enumerate(zip(names, seeds, strict=True)):
        if not (out / SEALED / name / "clean.npz").exists():
            write_case(build_pair(PAIRS[kinds[number % len(PAIRS)]], name, own), out)
    return names


def close_loop(out: Path, name: str, trial: Trial) -> dict[str, Any]:
    """Diagnose a pair, run what is proposed, diagnose again."""
    truth = json.loads((out / SEALED / name / "truth.json").read_text())
    results = out / RESULTS / trial.name
    first = _diagnosed(out / CASES / name, results / name, trial)
    row = {
        "case": name,
        "pair": truth["pair"]["name"],
        "verdict": first.get("verdict"),
        "undecided": undecided_holds(first, truth),
        "proposed": False,
        "decided": False,
        "after": None,
    }
    proposal = first.get("experiment_request")
    if not row["undecided"] or not proposal:
        return row
    row["proposed"] = True
    again = f"{(int(name, 16) + 1) % 2**32:08x}"
    try:
        request = Request.from_report(proposal)
        if not (out / CASES / again).exists():
            perform(out, name, request, again)
    except (ValueError, KeyError, TypeError, ArithmeticError) as error:
        return row | {"after": f"the request could not be run: {error}"}
    second = _diagnosed(out / CASES / again, results / again, trial)
    return row | {"after": second.get("verdict"), "decided": named(second, truth)}


def _diagnosed(folder: Path, result: Path, trial: Trial) -> dict[str, Any]:
    if not (result / "run.json").exists():
        run_one(folder, result, trial)
    return read_report(result) or {}


def undecided_holds(report: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether a report leaves truth and rival open, their places too where these differ."""
    if report.get("verdict") != "undecided":
        return False
    effect, pair = truth["effects"][0]["effect"], truth["pair"]
    given = report.get("undecided") or []
    told = {str(e.get("effect")) if isinstance(e, dict) else str(e) for e in given}
    if pair["places"][0]:
        places = {(e.get("where") or {}).get("id") for e in given if isinstance(e, dict)}
        return effect in told and set(pair["places"]) <= places
    return {effect, pair["rival"]} <= told


def named(report: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether a report names the truth, its place and nothing else."""
    effects = report.get("effects") or []
    if report.get("verdict") in ("undecided", "unknown_effect") or len(effects) != 1:
        return False
    true = truth["effects"][0]
    where = effects[0].get("where") or {}
    place = (where.get("kind"), where.get("id")) == (true["where"]["kind"], true["where"]["id"])
    return bool(effects[0].get("effect") == true["effect"] and place)


def tabulate_pairs(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Give the figures of the loop."""
    open_rows = [row for row in rows if row["undecided"]]
    return {
        "undecided": rate(row["undecided"] for row in rows),
        "experiment_proposed": rate(row["proposed"] for row in open_rows),
        "decided_of_undecided": rate(row["decided"] for row in open_rows),
        "decided_of_all": rate(row["decided"] for row in rows),
        "verdicts": dict(Counter(str(row["verdict"]) for row in rows)),
        "kinds": len({row["pair"] for row in rows}),
    }
