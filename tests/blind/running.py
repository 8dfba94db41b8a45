"""Runs of cases, one process each, with its time and memory."""

import dataclasses
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import Any

from .answers import judge, read_report
from .cases import Case, build, draw_cases
from .design import Design
from .files import CASES, SEALED, write_case

RESULTS = "results"
Drawn = tuple[str, Design, int]
Builder = Callable[[str, Design, int], Case]
ONE_THREAD = {
    name: "1"
    for name in (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "MKL_NUM_THREADS",
    )
}


@dataclasses.dataclass(frozen=True)
class Trial:
    """What is run on every case: a command that takes MODEL RECORD... --holdout R --out DIR."""

    name: str
    command: tuple[str, ...]
    timeout_s: float = 600.0


def diagnose(command: str | None = None, timeout_s: float = 600.0) -> Trial:
    """Run `slowtime diagnose` of this environment, or what was given instead."""
    words = (
        shlex.split(command) if command else [sys.executable, "-m", "slowtime_cli", "diagnose"]
    )
    return Trial("slowtime", tuple(words), timeout_s)


def generate(
    out: Path, count: int, seed: int, jobs: int = 1, only: str | None = None
) -> list[str]:
    """Write a battery of cases; those that are there already are left as they are."""
    drawn = draw_cases(count, seed, only)
    todo = [one for one in drawn if not is_written(out, one[0])]
    if jobs == 1:
        return [write_one(out, one, build) for one in todo]
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(write_one, repeat(out), todo, repeat(build)))


def is_written(out: Path, name: str) -> bool:
    """Whether a case is there, whole."""
    return (out / SEALED / name / "clean.npz").exists()


def write_one(out: Path, drawn: Drawn, builder: Builder) -> str:
    """Build a case and write it, in place of what an interrupted run may have left of it."""
    name, design, seed = drawn
    case = builder(name, design, seed)
    for part in (CASES, SEALED):
        shutil.rmtree(out / part / name, ignore_errors=True)
    write_case(case, out)
    return name


def run_all(out: Path, trial: Trial, jobs: int = 1, again: bool = False) -> None:
    """Run the command on every case that has no result yet."""
    names = sorted(folder.name for folder in (out / CASES).iterdir())
    results = out / RESULTS / trial.name
    todo = [n for n in names if again or not (results / n / "run.json").exists()]
    with ThreadPoolExecutor(jobs) as pool:
        for number, _ in enumerate(
            pool.map(lambda n: run_one(out / CASES / n, results / n, trial), todo)
        ):
            print(
                f"\r{trial.name}: {number + 1} of {len(todo)}",
                end="",
                file=sys.stderr,
                flush=True,
            )
    print(file=sys.stderr)


def run_one(folder: Path, result: Path, trial: Trial) -> dict[str, Any]:
    """Run the command on one case; its time, memory and last words go to ``run.json``."""
    listing = json.loads((folder / "case.json").read_text())
    result.mkdir(parents=True, exist_ok=True)
    words = [*trial.command, listing["model"], *listing["records"]]
    words += ["--holdout", listing["holdout"], "--out", str(result.resolve())]
    begun = time.monotonic()
    with (result / "log.txt").open("wb") as log:
        process = subprocess.Popen(
            words, cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            env=os.environ | ONE_THREAD, start_new_session=True,
        )  # fmt: skip
        status, usage, in_time = _wait(process, begun + trial.timeout_s)
    run = {
        "exit": os.waitstatus_to_exitcode(status),
        "in_time": in_time,
        "seconds": time.monotonic() - begun,
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
        "mebibytes": usage.ru_maxrss / 1024,
    }
    (result / "run.json").write_text(json.dumps(run, indent=1))
    return run


def _wait(process: subprocess.Popen[bytes], until: float) -> tuple[int, Any, bool]:
    in_time = True
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return status, usage, in_time
        if in_time and time.monotonic() > until:
            in_time = False
            os.killpg(process.pid, signal.SIGKILL)
        time.sleep(0.02)


def score(out: Path, trial_name: str) -> list[dict[str, Any]]:
    """Judge every case that was run."""
    rows = []
    for result in sorted((out / RESULTS / trial_name).iterdir()):
        sealed = out / SEALED / result.name
        truth = json.loads((sealed / "truth.json").read_text())
        known = sealed / "equivalent.json"
        if known.exists():
            more = json.loads(known.read_text())
            truth["equivalents"] += [name for name, same in more.items() if same["equivalent"]]
        row = judge(truth, read_report(result), sealed, result)
        rows.append(row | json.loads((result / "run.json").read_text()))
    return rows
