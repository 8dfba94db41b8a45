"""Diagnoses drawn rigs from the command line, and scores the answers."""

import itertools
import json
import math
import os
import resource
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.stats import binomtest

SHARES = (0.25, 0.5, 1.0)
"""[share of each record] To which cases are cut."""
WORTH = {"wrong": 0, "no answer": 0, "partial": 2, "alike": 3, "exact": 3}
"""Of outcomes; of those that say too little, 1."""
TEN_DECIBEL = math.sqrt(10.0)
LEAST_TOLD, MOST_ALIKE = 3.0, 10.0
"""Nats between the truth and its best rival, below which to leave it undecided is right, and
above which it is not."""
HELD_OUT = 1.15
"""Error on the held-out record over the noise's, up to which the gap is closed."""


def diagnose(folder: Path, patience: str | None = None) -> float:
    """Run the command on a case; return the processor time it took [s].

    Bytecode is kept, as that of an installed command is: without, imports take half the time.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [
        Path(sys.executable).parent / "slowtime", "diagnose", "rig.yaml", "a.npz", "b.npz",
        "--holdout", "held.npz", "--out", "found",
    ]  # fmt: skip
    command += [] if patience is None else ["--patience", patience]
    with (folder / "log").open("w") as log:
        env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        subprocess.run(
            list(map(str, command)), cwd=folder, stdout=log, stderr=log, check=False, env=env
        )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def cut(folder: Path, share: float) -> Path:
    """Cut the records of a case, but the held-out one, to their first part; give its folder."""
    if share == 1.0:
        return folder
    part = folder / f"cut_{round(100 * share):03d}"
    part.mkdir(exist_ok=True)
    for name in ("rig.yaml", "truth.json", "held.npz"):
        (part / name).write_bytes((folder / name).read_bytes())
    for name in ("a.npz", "b.npz"):
        with np.load(folder / name) as whole:
            channels = {k: v[: round(share * len(v))] for k, v in whole.items()}
        np.savez(part / name, allow_pickle=False, **channels)
    return part


def gets_worse(outcomes: Sequence[str]) -> bool:
    """Whether any outcome is worth less than one by shorter records, which come first."""
    worth = [WORTH.get(one, 1) for one in outcomes]
    return any(after < before for before, after in itertools.pairwise(worth))


def scored(folder: Path) -> dict[str, Any]:
    """Compare the answer to a case with the truth."""
    case: dict[str, Any] = json.loads((folder / "truth.json").read_text())
    path = folder / "found/report.json"
    if not path.exists():
        return case | {"outcome": "no answer", "verdict": "failed"}
    found = json.loads(path.read_text())
    own = _own(folder)
    named = [(one["effect"], _where(one["where"], own)) for one in found["effects"]]
    numbers = {n: one["parameters"] for n, one in zip(named, found["effects"], strict=True)}
    sought = [
        (one["kinds"], _set(one["where"]), one["parameter"], one["value"])
        for one in case["truth"]
    ]
    right = [
        next((n for n in named if n[0] in kinds and n[1] == where), None)
        for kinds, where, _, _ in sought
    ]
    within = [
        abs(p["value"] - value) <= 1.96 * p["sd"] + 1e-3 * abs(value)
        for hit, (_, _, parameter, value) in zip(right, sought, strict=True)
        if hit is not None and (p := numbers[hit].get(parameter)) is not None
    ]
    gap = found["gap"]
    floor = max(gap["noise_floor"], 1e-12)
    extra = len(named) - sum(one is not None for one in right)
    verdict = found["verdict"]
    if verdict in ("nothing_missing", "parameters_only"):
        outcome = "exact" if not sought else "missed"
    elif any("rocking" in kinds for kinds, *_ in sought):
        outcome = "exact" if verdict in ("unknown_effect", "undecided") else "wrong"
    elif verdict == "undecided" and case.get("nats", MOST_ALIKE) < LEAST_TOLD:
        rivals = [(one["effect"], _where(one["where"], own)) for one in found["undecided"]]
        held = all(
            any(k in kinds and w == where for k, w in rivals) for kinds, where, *_ in sought
        )
        outcome = "alike" if held else verdict
    elif verdict in ("undecided", "unknown_effect"):
        outcome = verdict
    elif None not in right and not extra:
        outcome = "exact"
    elif any(one is not None for one in right) and not extra:
        outcome = "partial"
    else:
        outcome = "wrong"
    return case | {
        "outcome": outcome,
        "verdict": verdict,
        "named": [f"{kind} at {'-'.join(sorted(place))}" for kind, place in named],
        "contrast": gap["refitted_nominal"] / floor,
        "left": gap["augmented"] / floor,
        "within": within,
    }  # fmt: skip


def _set(where: str | list[str]) -> frozenset[str]:
    return frozenset([where] if isinstance(where, str) else where)


def _own(folder: Path) -> set[str]:
    """Names of the elements that the model as given has."""
    given = yaml.safe_load((folder / "rig.yaml").read_text())
    return {one["id"] for one in given["elements"]}


def _where(where: dict[str, str], own: set[str]) -> frozenset[str]:
    """Both ends of an element that the model as given has not got, whose name joins theirs."""
    new = where["kind"] == "element" and where["id"] not in own
    return frozenset(where["id"].split("-") if new else [where["id"]])


def _shows(row: dict[str, Any]) -> bool:
    """Whether what is missing shows 10 dB over the noise, or in ambient spectra at all."""
    if row["excitation"] == "ambient":
        return bool(row.get("nothing_nats", 0.0) >= MOST_ALIKE)
    return bool(row.get("contrast", 0.0) >= TEN_DECIBEL)


def _share(count: int, of: int) -> str:
    if not of:
        return "0 of 0"
    low, high = binomtest(count, of).proportion_ci()
    return f"{count} of {of} ({100 * low:.0f}-{100 * high:.0f} %)"


def table(rows: Iterable[dict[str, Any]]) -> str:
    """Tell how many were right."""
    every = list(rows)
    seen = [r for r in every if r["truth"] and _shows(r)]
    alike = [r for r in seen if r["outcome"] == "alike"]
    exact = [r for r in seen if r["outcome"] == "exact"]
    told = [r for r in seen if r.get("nats", MOST_ALIKE) >= LEAST_TOLD]
    off = [r for r in seen if any(one["off"] for one in r["truth"])]
    closed = [r for r in exact if r["left"] <= HELD_OUT]
    within = [one for r in seen for one in r["within"]]
    none = [r for r in every if not r["truth"]]
    times = sorted(r["seconds"] for r in every)
    lines = [
        f"{len(every)} cases, {len(seen)} with an effect 10 dB over the noise",
        f"named and placed: {_share(len(exact), len(seen))}; {len(alike)} more were rightly "
        "left undecided",
        f"the same, of those {LEAST_TOLD:g} nats or more from their best rival: "
        + _share(sum(r["outcome"] == "exact" for r in told), len(told)),
        "of those with something off the model: "
        + _share(sum(r["outcome"] == "exact" for r in off), len(off)),
        f"wrong name: {_share(sum(r['outcome'] == 'wrong' for r in seen), len(seen))}",
        f"held-out error at the noise: {_share(len(closed), len(exact))} of those",
        f"leading number within its 95 % interval: {_share(sum(within), len(within))}",
        "nothing missing, and something named: "
        + _share(sum(r["outcome"] != "exact" for r in none), len(none)),
    ]
    if times:
        at = [times[min(int(q * len(times)), len(times) - 1)] for q in (0.5, 0.95)]
        lines.append(
            f"processor time: median {at[0]:.0f}, 95 % {at[1]:.0f}, most {times[-1]:.0f} s"
        )
    return "\n".join(lines)
