"""Runs of the contestants in processes of their own, with their processor times."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from .pieces import JUDGE, LEARN, files_of
from .sets import ROOT, RealSet

PEERS = ROOT / ".venv-peers/bin/python"
"""Interpreter with the other tools; `make real` sets it up."""
MODEL, FACTS, RUN = "model.yaml", "facts.json", "run.json"
LIMIT_S = 1500.0
"""[s] Time after which a contestant is stopped. Source: a decision."""
ONE_THREAD = {
    name: "1"
    for name in (
        "OPENBLAS_NUM_THREADS",
        "OMP_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "MKL_NUM_THREADS",
    )
} | {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}


@dataclasses.dataclass(frozen=True)
class Contestant:
    """A tool that is run on every set.

    Parameters
    ----------
    name
        Of its folder of results.
    title
        As the page calls it.
    module
        What is run: it takes ``MODEL LEARN... --holdout JUDGE... --out FOLDER``.
    peer
        Whether it runs in the environment of the peers.
    """

    name: str
    title: str
    module: tuple[str, ...]
    peer: bool


SLOWTIME = Contestant("slowtime", "slowtime", ("slowtime_cli", "diagnose"), peer=False)
SINDY = Contestant("pysindy", "PySINDy", ("benchmarks.real_rigs.peers.sindy",), peer=True)
BLACK_BOX = Contestant(
    "jax_sysid", "jax-sysid", ("benchmarks.real_rigs.peers.black_box",), peer=True
)
KNOWN = Contestant(
    "known_law", "known law, fitted", ("benchmarks.real_rigs.peers.known_law",), peer=False
)
CONTESTANTS = (SLOWTIME, SINDY, BLACK_BOX, KNOWN)
"""The last is told the answer: it shows what can be reached."""


def prepare(one: RealSet, data: Path, out: Path) -> Path:
    """Write the model and the pieces of a set into its folder, and return that.

    Raises
    ------
    OSError
        Where a file of the measurements is missing.
    """
    folder = out / one.name
    pieces = one.load(data)
    for stale in (*files_of(folder, LEARN), *files_of(folder, JUDGE)):
        stale.unlink()
    pieces.write(folder)
    shutil.copy(one.model, folder / MODEL)
    (folder / FACTS).write_text(json.dumps({"imposed": one.imposed, "law": one.law}) + "\n")
    return folder


def words_of(contestant: Contestant, folder: Path) -> list[str]:
    """Return the arguments of a contestant, relative to the folder of a set."""
    words = [MODEL, *(path.name for path in files_of(folder, LEARN))]
    for path in files_of(folder, JUDGE):
        words += ["--holdout", path.name]
    return [*words, "--out", contestant.name]


def run(contestant: Contestant, folder: Path, limit_s: float = LIMIT_S) -> dict[str, Any]:
    """Run a contestant on a set, and write command, exit status and times to ``run.json``."""
    result = folder / contestant.name
    shutil.rmtree(result, ignore_errors=True)
    result.mkdir()
    python = str(PEERS) if contestant.peer else sys.executable
    words = words_of(contestant, folder)
    begun = time.monotonic()
    with (result / "log.txt").open("wb") as log:
        process = subprocess.Popen(
            [python, "-m", *contestant.module, *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=_environment(),
        )
        late = threading.Timer(limit_s, process.kill)
        late.start()
        _, status, usage = os.wait4(process.pid, 0)
        late.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
    told = {
        "command": " ".join([*contestant.module, *words]),
        "exit": process.returncode,
        "seconds": time.monotonic() - begun,
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
        "load": os.getloadavg()[0],
        "version": _version(),
        "last_words": (result / "log.txt").read_text(errors="replace").strip()[-300:],
    }
    (result / RUN).write_text(json.dumps(told, indent=1) + "\n")
    return told


def is_done(contestant: Contestant, folder: Path) -> bool:
    """Whether a contestant was run on a set already."""
    return (folder / contestant.name / RUN).exists()


def _version() -> str:
    """Return the commit that was run, so that old results can be told; empty without git."""
    told = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return told.stdout.strip()


def _environment() -> dict[str, str]:
    paths = [str(ROOT), str(ROOT / "schemas"), str(ROOT / "services")]
    return os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(paths)}
