"""Reading, reduction and accuracy of a lattice tower of trusses and beams with 30 groups.

Run `python -m benchmarks.methods.lattice_tower.reduction [--part small large] [--trials 200]`.
pyfe3d makes a tower of 20,160 degrees of freedom (`small`) and one of 204,480 (`large`), whose
matrices are written as Matrix Market text. `slowtime model reduce` reads and reduces them in a
process of its own, whose time and memory are measured. Then the reduced model is compared with
full solutions at random parameters. An updated model is measured in milliseconds and as a ratio
to one full solution.
"""

import argparse
import dataclasses
import functools
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slowtime.finite_elements.eigenvalues import lowest_modes
from slowtime.finite_elements.parametric_matrices import ParametricMatrices
from slowtime.finite_elements.reduction import AdaptiveModel
from slowtime.finite_elements.reduction.verification import compare_modes
from slowtime_services.matrices import read_matrix_model
from slowtime_services.matrices.reduced_files import read_reduced

from .structure import TowerLayout, export_tower

MODES, SPAN = 20, 0.3
LAYOUTS = {
    "small": TowerLayout(),
    "large": TowerLayout(leg_elements=36, girt_elements=36),
}
LARGE_TRIALS = 5
"""Random parameters of the large tower [1]: each costs a full solution of half a minute."""

COORDINATES, FREQUENCY_ERROR, AGREEMENT = 100, 1e-3, 0.999
SECONDS, GIGABYTES, UPDATE_S = 60.0, 2.0, 5e-3
"""What the figures are held to; time and memory of the small tower only."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ProcessCost:
    """What a process took.

    Parameters
    ----------
    wall_s, cpu_s
        Time by the clock and of the processor [s].
    memory_gib
        Peak of its memory [GiB].
    """

    wall_s: float
    cpu_s: float
    memory_gib: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Errors of a reduced model at random parameters, and what an updated model costs.

    Parameters
    ----------
    frequency
        Largest relative error of a frequency [1].
    agreement
        Smallest mass-weighted MAC of shapes [1]; of subspaces where modes are close.
    full_s, updated_s
        Median time of the processor for a full and for a reduced solution [s].
    """

    frequency: float
    agreement: float
    full_s: float
    updated_s: float


def reduce_by_command(model: Path, out: Path) -> ProcessCost:
    """Run `slowtime model reduce` in a process of its own.

    Parameters
    ----------
    model
        Model file.
    out
        Reduced model to write, `.npz`.

    Returns
    -------
    What it took, with start-up, without the verification by full solutions.

    Raises
    ------
    RuntimeError
        Where the command fails.
    """
    given = [
        "model",
        "reduce",
        str(model),
        "--modes",
        str(MODES),
        "--setting",
        f"span={SPAN}",
        "--setting",
        "trials=0",
    ]
    command = [sys.executable, "-m", "slowtime_cli", *given, "--out", str(out)]
    start = time.perf_counter()
    _, status, used = os.wait4(os.spawnv(os.P_NOWAIT, sys.executable, command), 0)
    wall = time.perf_counter() - start
    if status:
        raise RuntimeError(f"`slowtime {' '.join(given)}` failed. Run it to see its message.")
    return ProcessCost(
        wall_s=wall, cpu_s=used.ru_utime + used.ru_stime, memory_gib=used.ru_maxrss / 2**20
    )


def compare_at_random(
    full: ParametricMatrices, reduced: AdaptiveModel, trials: int, seed: int
) -> Accuracy:
    """Compare a reduced model with full solutions at random parameters.

    Parameters
    ----------
    full, reduced
        Both models.
    trials
        Number of parameter vectors.
    seed
        Of the parameters, uniform within the span.

    Returns
    -------
    The largest errors and the median times.
    """
    random = np.random.default_rng(seed)
    thetas = random.uniform(-SPAN, SPAN, (trials, len(full.names)))
    reduced.modes(thetas[0], MODES)
    own_s, full_s, errors, alike = [], [], [], []
    for theta in thetas:
        start = time.process_time()
        reduced.modes(theta, MODES)
        own_s.append(time.process_time() - start)
    for theta in thetas:
        start = time.process_time()
        true = lowest_modes(*full.at(theta), MODES + 4, check=False)
        full_s.append(time.process_time() - start)
        found = reduced.modes(theta, MODES)
        error, agreement = compare_modes(full, reduced, found, true, theta)
        errors.append(error)
        alike.append(agreement)
    return Accuracy(
        frequency=max(errors),
        agreement=min(alike),
        full_s=float(np.median(full_s)),
        updated_s=float(np.median(own_s)),
    )


def report(name: str, trials: int, seed: int) -> bool:
    """Print the figures of one tower; return whether they are within what they are held to."""
    with tempfile.TemporaryDirectory() as folder:
        model = export_tower(Path(folder), LAYOUTS[name])
        size = sum(file.stat().st_size for file in Path(folder).iterdir()) / 2**20
        reduced_file = Path(folder, "reduced.npz")
        cost = reduce_by_command(model, reduced_file)
        reduced = read_reduced(reduced_file)
        full = read_matrix_model(model).matrices
    load = os.getloadavg()[0]
    say = functools.partial(print, flush=True)
    say(f"{name}: {full.size} degrees of freedom, {len(full.names)} groups, "
          f"{reduced.size} coordinates, files of {size:.0f} MiB")  # fmt: skip
    say(f"  reading and reduction {cost.cpu_s:.1f} s of CPU, {cost.wall_s:.1f} s by the clock "
          f"at a load of {load:.1f}; peak of memory {cost.memory_gib:.2f} GiB")  # fmt: skip
    found = compare_at_random(full, reduced, trials, seed)
    say(f"  {trials} random parameters up to {SPAN}, {MODES} modes: frequencies within "
          f"{found.frequency:.2e}, MAC at least {found.agreement:.6f}")  # fmt: skip
    say(f"  updated model {found.updated_s * 1e3:.2f} ms of CPU; full solution "
          f"{found.full_s:.2f} s, {found.full_s / found.updated_s:.0f} times that")  # fmt: skip
    accurate = (
        reduced.size <= COORDINATES
        and found.frequency <= FREQUENCY_ERROR
        and found.agreement >= AGREEMENT
        and found.updated_s <= UPDATE_S
    )
    cheap = cost.cpu_s <= SECONDS and cost.memory_gib <= GIGABYTES
    return accurate and (cheap or name != "small")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; return 1 where one lies outside what it is held to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", nargs="*", choices=tuple(LAYOUTS), default=tuple(LAYOUTS))
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    kept = [
        report(name, given.trials if name == "small" else LARGE_TRIALS, given.seed)
        for name in given.part
    ]
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
