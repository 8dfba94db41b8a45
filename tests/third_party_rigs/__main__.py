"""Diagnose rigs that SciPy integrates, and tell how many answers are right.

    python -m tests.third_party_rigs --seeds 0 150 --out var/third_party_rigs

Of each 30 seeds 6 lack something on an element, 12 something elsewhere, 6 both, and 6 nothing.
From seed 1000 on there are gyroscopic couplings, wrongly wired sensors, bases that rock (no
name is right) and frames of beams, in turn; from seed 2000 on masses that jump, and neighbours
that stand still while the base moves. What is there already is not done again.
"""

import argparse
import json
import sys
from pathlib import Path

from .battery import diagnose, scored, table
from .cases import FURTHER, LATEST, draw

WHAT = ("on", "off", "off", "both", "nothing")
WHAT_FROM = {0: WHAT, 1000: tuple(FURTHER), 2000: tuple(LATEST)}
"""What may be missing from each seed on, in turn."""
HOW = ("random", "random", "sweep", "base", "random", "release", "ambient", "sweep")


def plan(seed: int) -> tuple[str, str]:
    """Tell what is missing in a case, and how it is excited."""
    whats = WHAT_FROM[max(first for first in WHAT_FROM if first <= seed)]
    what = whats[seed % len(whats)]
    return what, "base" if what == "neighbour" else HOW[seed // len(whats) % len(HOW)]


def main() -> int:
    """Run the cases; print a line for each, and the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 150))
    parser.add_argument("--out", type=Path, default=Path("var/third_party_rigs"))
    parser.add_argument(
        "--what", nargs="+", choices=(*WHAT, *FURTHER, *LATEST),
        default=(*WHAT, *FURTHER, *LATEST),
    )  # fmt: skip
    parser.add_argument("--how", nargs="+", choices=HOW, default=HOW)
    parser.add_argument("--patience")
    asked = parser.parse_args()
    rows = []
    for seed in range(*asked.seeds):
        what, how = plan(seed)
        if what not in asked.what or how not in asked.how:
            continue
        folder = asked.out / f"{seed:04d}"
        if not (folder / "truth.json").exists():
            draw(seed, what, how).write(folder)
        done = folder / "seconds"
        if not done.exists():
            done.write_text(str(diagnose(folder, asked.patience)))
        row = scored(folder) | {"seconds": float(done.read_text())}
        rows.append(row)
        (folder / "row.json").write_text(json.dumps(row))
        print(
            f"{seed:4d} {row['outcome']:14s} {row['seconds']:5.0f} s  {row['excitation']:8s}"
            f"{row['label']:44s} {row.get('contrast', 0):7.1f} {row.get('left', 0):6.2f}  "
            f"{row['verdict']}: {', '.join(row.get('named', []))}",
            flush=True,
        )
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
