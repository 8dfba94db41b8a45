"""Results on a set: error on held-out records, time and answer of every tool."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from .pieces import Array
from .running import BLACK_BOX, CONTESTANTS, RUN, SLOWTIME, Contestant
from .sets import SETS, RealSet

RUNS, REPORT, ANSWER = "holdout.npz", "report.json", "answer.json"
DIVERGED = 10.0
"""[1] Error from which a run is said to have diverged. Source: a choice."""
NOMINAL, REFITTED = "model as written", "model refitted"
SPECTRA_ONLY = "Spectra were compared"
"""Words of the note that tells that a record was not run. Source: `slowtime.discrepancy`."""
WORSE = 1.2
"""[1] Ratio to the least error of the others, from which slowtime counts as behind. Source: a
choice; errors of two initial states of one model differ by less."""


@dataclasses.dataclass(frozen=True, eq=False)
class Row:
    """One contestant on one set.

    Parameters
    ----------
    name
        As the page calls it.
    error
        Root mean square error over the standard deviation, mean over channels [1]; None where
        there is no run.
    cpu_s
        Processor time [s]; None for models that slowtime runs along with its own.
    readable
        Answer in words.
    run
        Predicted outputs [time, channel], or None.
    """

    name: str
    error: float | None
    cpu_s: float | None
    readable: str
    run: Array | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class ScoredSet:
    """One set with all its contestants; `measured` [time, channel] follows the records."""

    one: RealSet
    rows: tuple[Row, ...]
    sentence: str
    command: str
    verdict: str
    measured: Array
    times_s: Array
    record: Array
    channels: tuple[str, ...]
    loads: tuple[float, ...]

    def row(self, name: str) -> Row | None:
        """Return the row of this name."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def behind(self) -> str | None:
        """Name of a rival whose error is so much smaller that slowtime is behind, or None."""
        own = self.row(SLOWTIME.title)
        if own is None:
            return None
        rivals = [
            (row.error, row.name)
            for row in self.rows
            if row.error is not None and row.name != SLOWTIME.title
        ]
        if self.one.reference_nrmse is not None:
            rivals.append((self.one.reference_nrmse, "the source"))
        if not rivals:
            return None
        error, name = min(rivals)
        if own.error is None or own.error > WORSE * error:
            return name
        return None


def relative_error(measured: Array, run: Array) -> float:
    """Root mean square error over the standard deviation, mean over channels [1].

    Parameters
    ----------
    measured, run
        Of all records [time, channel].
    """
    if measured.shape != run.shape:
        raise ValueError(f"A run of {run.shape} is compared with a record of {measured.shape}.")
    if not np.isfinite(run).all():
        return float("inf")
    left = np.sqrt(np.mean((measured - run) ** 2, axis=0))
    return float(np.mean(left / np.std(measured, axis=0)))


def outcome_of(one: RealSet, folder: Path) -> ScoredSet | None:
    """Collect what the contestants answered on a set; None where none was run."""
    rows: list[Row] = []
    facts: dict[str, Any] = {"sentence": "", "verdict": "not run", "command": ""}
    grid: dict[str, Array] | None = None
    loads = []
    for contestant in CONTESTANTS:
        run_file = folder / contestant.name / RUN
        if not run_file.exists():
            continue
        told = json.loads(run_file.read_text())
        loads.append(float(told["load"]))
        runs = _runs(folder / contestant.name / RUNS)
        if runs is not None and (grid is None or contestant is SLOWTIME):
            grid = runs
        if contestant is SLOWTIME:
            rows += _own_rows(folder, told, runs)
            facts = _facts(one, folder, told)
        else:
            rows.append(_peer_row(contestant, folder, told, runs))
    if not rows or grid is None:
        return None
    return ScoredSet(
        one=one,
        rows=tuple(rows),
        measured=grid["measured"],
        times_s=grid["t"],
        record=grid["record"],
        channels=tuple(map(str, grid["channels"])),
        loads=tuple(loads),
        **facts,
    )


def _runs(path: Path) -> dict[str, Array] | None:
    if not path.exists():
        return None
    with np.load(path) as arrays:
        return {name: np.asarray(arrays[name]) for name in arrays.files}


def _own_rows(folder: Path, told: dict[str, Any], runs: dict[str, Array] | None) -> list[Row]:
    if told["exit"] or runs is None:
        words = told["last_words"].splitlines()
        return [Row(SLOWTIME.title, None, told["cpu_seconds"], f"failed: {words[-1:] or ''}")]
    report = json.loads((folder / SLOWTIME.name / REPORT).read_text())
    names = ", ".join(effect["effect"] for effect in report["effects"])
    readable = f"yes: {names}" if names else f"yes: {report['verdict'].replace('_', ' ')}"
    measured = runs["measured"]
    found = []
    for name, key, seconds, words in (
        (NOMINAL, "nominal", None, "yes: the model file"),
        (REFITTED, "refitted_nominal", None, "yes: the model file with other constants"),
        (SLOWTIME.title, "augmented", told["cpu_seconds"], readable),
    ):
        found.append(Row(name, relative_error(measured, runs[key]), seconds, words, runs[key]))
    return found


def _peer_row(
    contestant: Contestant, folder: Path, told: dict[str, Any], runs: dict[str, Array] | None
) -> Row:
    if told["exit"] or runs is None:
        words = told["last_words"].splitlines()
        return Row(contestant.title, None, told["cpu_seconds"], f"failed: {words[-1:] or ''}")
    answer = json.loads((folder / contestant.name / ANSWER).read_text())
    error = relative_error(runs["measured"], runs["augmented"])
    if contestant is BLACK_BOX:
        readable = f"no: {answer['readable']}"
    else:
        readable = f"an equation: {answer['readable']}"
    return Row(contestant.title, error, told["cpu_seconds"], readable, runs["augmented"])


def _facts(one: RealSet, folder: Path, told: dict[str, Any]) -> dict[str, Any]:
    report_file = folder / SLOWTIME.name / REPORT
    command = told["command"].replace("slowtime_cli", "slowtime", 1)
    if told["exit"] or not report_file.exists():
        return {"sentence": told["last_words"], "verdict": "failed", "command": command}
    report = json.loads(report_file.read_text())
    return {"sentence": report["sentence"], "verdict": judge(one, report), "command": command}


def judge(one: RealSet, report: dict[str, Any]) -> str:
    """Compare the effects named with the known answer, in words.

    Faults of sensors that are named besides count against an answer unless they are allowed.
    """
    if any(SPECTRA_ONLY in note for note in report["notes"]) and not report["effects"]:
        return "no free run: only spectra were compared"
    named = [{effect["effect"], effect["family"]} for effect in report["effects"]]
    if report["verdict"] == "unknown_effect":
        named = [{"unknown"}]
    rivals = {rival["effect"] for rival in report["undecided"]}
    for effect in report["effects"]:
        rivals |= {rival["effect"] for rival in effect["alternatives"]}
    rivals |= _families(rivals)
    missing = [group for group in one.needed if not any(group & words for words in named)]
    welcome = one.allowed.union(*one.needed)
    more = [words for words in named if not words & welcome]
    if report["verdict"] == "undecided" and all(group & rivals for group in missing):
        return "undecided, the known answer among what may be"
    if report["verdict"] == "unknown_effect" and (missing or not one.needed):
        return "said to be unknown"
    if not missing and not more:
        return "as known"
    if not one.needed:
        return "claims what is not there"
    if not missing:
        return "as known, and more"
    if len(missing) < len(one.needed):
        return "in part"
    if not named and report["verdict"] == "nothing_missing":
        return "nothing found"
    return "another answer"


def _families(kinds: set[str]) -> set[str]:
    from slowtime.dynamics.effects.effect_catalogue import catalogue

    known = catalogue()
    return {known[kind].family for kind in kinds if kind in known}


def outcomes(out: Path) -> list[ScoredSet]:
    """Collect every set that was run, in the order of the table."""
    found = (outcome_of(one, out / one.name) for one in SETS)
    return [one for one in found if one is not None]
