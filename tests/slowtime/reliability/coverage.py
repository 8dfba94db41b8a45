"""How often 95 % intervals hold the truth: `python -m tests.slowtime.reliability.coverage`.

Prints one line per method: runs, share of intervals that held (all runs, and runs without a
warning), cells under 85 % without a warning, runs below 0.8 of the truth without a warning and
the number that chance gives, and mean calls.
"""

import argparse
import dataclasses
import time
import zlib

import numpy as np
from scipy.special import ndtr

from slowtime.reliability import estimate
from tests.slowtime.reliability.problems import Known, every

SAMPLERS = ("monte-carlo", "stratified", "importance", "directional", "subset", "cross-entropy")
MOST_CALLS = 400_000


@dataclasses.dataclass(frozen=True)
class Cell:
    """Runs of one method on one problem."""

    method: str
    problem: str
    ratio: np.ndarray
    held: np.ndarray
    warned: np.ndarray
    variation: np.ndarray
    calls: np.ndarray

    @property
    def silent_share(self) -> float:
        """Share of intervals that held, of runs without a warning; 1 where most warned."""
        silent = ~self.warned
        return float(self.held[silent].mean()) if silent.mean() > 0.5 else 1.0

    @property
    def unsafe(self) -> int:
        """Runs below 0.8 of the truth that gave no warning."""
        return int(np.sum((self.ratio < 0.8) & ~self.warned))

    @property
    def by_chance(self) -> float:
        """As many as errors of the variation stated would bring."""
        silent = self.variation[~self.warned]
        spread = np.sqrt(np.log1p(silent**2))
        return float(np.sum(ndtr(np.log(0.8) / np.maximum(spread, 1e-9))))


def run(
    method: str, name: str, known: Known, seeds: int, most_calls: int = MOST_CALLS,
    most_seconds: float = np.inf,
) -> Cell:  # fmt: skip
    """Apply a method with one seed after the other."""
    ratio, held, warned, variation, calls = [], [], [], [], []
    began = time.monotonic()
    offset = zlib.crc32(name.encode()) % 1_000_000
    for seed in range(seeds):
        if seed >= 3 and time.monotonic() - began > most_seconds:
            break
        found = estimate(known.problem, method, calls=most_calls, seed=offset + seed)
        lo, hi = found.interval or (np.nan, np.nan)
        ratio.append(found.probability / known.exact)
        held.append(lo <= known.exact <= hi)
        warned.append(bool(found.warnings))
        variation.append(np.inf if found.variation is None else found.variation)
        calls.append(found.calls)
    return Cell(
        method, name, np.array(ratio), np.array(held), np.array(warned), np.array(variation),
        np.array(calls),
    )  # fmt: skip


def report(cells: list[Cell]) -> str:
    """One line of a method."""
    held = np.concatenate([cell.held for cell in cells])
    warned = np.concatenate([cell.warned for cell in cells])
    calls = np.mean(np.concatenate([cell.calls for cell in cells]))
    poor = [cell.problem for cell in cells if cell.silent_share < 0.85]
    return (
        f"{cells[0].method:14} runs {len(held):5}  held {100 * held.mean():5.1f} %  without a "
        f"warning {100 * held[~warned].mean():5.1f} % of {np.sum(~warned)}  cells < 85 %: "
        f"{poor or 'none'}  below 0.8: {sum(cell.unsafe for cell in cells)} (chance "
        f"{sum(cell.by_chance for cell in cells):.2g})  calls {calls:.0f}"
    )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--methods", default=",".join(SAMPLERS))
    parser.add_argument("--problems", default="", help="parts of names, with commas between")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=np.inf, help="of a cell at most")
    parser.add_argument("--most-calls", type=int, default=MOST_CALLS)
    given = parser.parse_args()
    parts = given.problems.split(",")
    for method in given.methods.split(","):
        cells = []
        for name, known in every().items():
            if not any(part in name for part in parts):
                continue
            if method == "monte-carlo" and known.exact < 3e-4:
                continue  # at 5 % of 1e-4 it takes four million points
            cell = run(method, name, known, given.seeds, given.most_calls, given.seconds)
            cells.append(cell)
            print(
                f"  {method:14} {name:26} n {len(cell.held):3} "
                f"held {100 * cell.held.mean():5.1f} warned {100 * cell.warned.mean():5.1f} "
                f"mean {cell.ratio.mean():.3f} sd {cell.ratio.std():.3f} "
                f"unsafe {cell.unsafe} calls {cell.calls.mean():.0f}",
                flush=True,
            )
        print(report(cells), flush=True)


if __name__ == "__main__":
    main()
