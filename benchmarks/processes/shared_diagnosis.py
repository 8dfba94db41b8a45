"""One diagnosis shared by processes, and the first one of an installation, as ratios.

`python -m benchmarks.processes.shared_diagnosis` takes some minutes. Three masses whose middle
joint stiffens are diagnosed by `slowtime diagnose`, by one process and by two, in turn; then
once with compiled code in an empty folder. Ratios of time on the clock say something only where
the machine has nothing else to do, so the load is printed beside them.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from slowtime.dynamics.plant import Plant
from slowtime_services.matrices import read_any_description

RATE_HZ = 128.0
SAMPLES = 3840
"""[samples] Of each record: 30 s."""
NOISE = 0.03
"""[share of the standard deviation] Of the noise of each sensor: 30 dB."""
MODEL = """\
slowtime_model: 1
name: rig
nodes:
  - {id: m1, mass_kg: 1.5}
  - {id: m2, mass_kg: 2.0}
  - {id: m3, mass_kg: 1.2}
elements:
  - {id: j0, between: [base, m1], stiffness_n_per_m: 900, damping_n_s_per_m: 0.8}
  - {id: j1, between: [m1, m2], stiffness_n_per_m: 1100, damping_n_s_per_m: 0.9}
  - {id: j2, between: [m2, m3], stiffness_n_per_m: 700, damping_n_s_per_m: 0.6}
inputs:
  - {channel: f1, kind: force, node: m1, unit: N}
sensors:
  - {channel: a1, quantity: acceleration, node: m1, frame: absolute, unit: m/s^2}
  - {channel: a2, quantity: acceleration, node: m2, frame: absolute, unit: m/s^2}
  - {channel: a3, quantity: acceleration, node: m3, frame: absolute, unit: m/s^2}
tolerance: {stiffness: 0.03, damping: 0.1, mass: 0.0}
"""
LACKING = "effects:\n  - {effect: cubic_hardening, element: j1, k3_n_per_m3: 4.0e+5}\n"
NAMES = ("low", "high", "other")
LEVELS_N = (6.0, 14.0, 10.0)
PAIRS = 3


def main(arguments: list[str] | None = None) -> int:
    """Print the ratios; 1 where the reports of one and two processes differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=PAIRS)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        return _compare(Path(folder), given.pairs)


def _compare(folder: Path, pairs: int) -> int:
    _write(folder)
    warm = folder / "warm"
    _diagnose(folder, 2, warm)
    alone, shared = [], []
    for _ in range(pairs):
        alone.append(_diagnose(folder, 1, warm))
        shared.append(_diagnose(folder, 2, warm))
    walls = [one[0] / two[0] for one, two in zip(alone, shared, strict=True)]
    costs = [two[1] / one[1] for one, two in zip(alone, shared, strict=True)]
    load = os.getloadavg()[0]
    print(f"load {load:.1f} on {os.cpu_count()} cores; by one process, on the clock, as 1.0")
    print(f"{statistics.median(walls):6.2f}  times as fast by two processes")
    print(f"{statistics.median(costs):6.2f}  processor time of both together, over that of one")
    for jobs, runs in ((1, alone), (2, shared)):
        first = _diagnose(folder, jobs, folder / f"empty {jobs}")
        print(f"{first[0] / runs[-1][0]:6.2f}  first run on the clock, {jobs} process(es)")
        print(f"{first[1] / runs[-1][1]:6.2f}  first run, processor time")
    reports = {report for _, _, report in (*alone, *shared)}
    print(f"{len(reports)} report(s) of {2 * pairs} runs")
    return int(len(reports) > 1)


def _write(folder: Path) -> None:
    """Write the model without the effect, and records of a rig with it."""
    (folder / "truth.yaml").write_text(MODEL + LACKING)
    (folder / "model.yaml").write_text(MODEL)
    truth = Plant.of(read_any_description(folder / "truth.yaml"))
    random = np.random.default_rng(3)
    for name, level in zip(NAMES, LEVELS_N, strict=True):
        force = level * np.convolve(random.standard_normal(SAMPLES), np.hanning(7), "same")
        clean = truth.simulate(truth.values, force[:, None], RATE_HZ)
        noise = NOISE * clean.std(axis=0) * random.standard_normal(clean.shape)
        columns = np.column_stack([force, clean + noise])
        np.savetxt(
            folder / f"{name}.csv", columns, delimiter=",", header="f1,a1,a2,a3", comments=""
        )


def _diagnose(folder: Path, jobs: int, code: Path) -> tuple[float, float, str]:
    """Time on the clock [s], processor time [s], and the report but for its time."""
    before, begun = _processor_s(), time.monotonic()
    subprocess.run(
        [
            sys.executable, "-m", "slowtime_cli", "diagnose", "model.yaml", "low.csv",
            "high.csv", "--holdout", "other.csv", "--rate-hz", f"{RATE_HZ:g}",
            "--jobs", str(jobs), "--out", "found",
        ],
        cwd=folder,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "NUMBA_CACHE_DIR": str(code)},
        check=True,
        capture_output=True,
    )  # fmt: skip
    spent = time.monotonic() - begun, _processor_s() - before
    report = json.loads((folder / "found/report.json").read_text())
    report.pop("seconds", None)
    return *spent, json.dumps(report, sort_keys=True)


def _processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
