"""Diagnose rigs that SciPy integrates, and tell how many answers are right.

    python -m tests.third_party_rigs --seeds 0 150 --out var/third_party_rigs

Of each 30 seeds 6 lack something on an element, 12 something elsewhere, 6 both, and 6 nothing.
From seed 1000 on there are gyroscopic couplings, wrongly wired sensors, bases that rock (no
name is right) and frames of beams, in turn; from seed 2000 on masses that jump, and neighbours
that stand still while the base moves. What is there already is not done again.
With `--lengths`, each case is also diagnosed by the first quarter and half of its two records;
no answer may be worse by longer ones.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from .battery import SHARES, cut, diagnose, gets_worse, scored, table
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
    parser = argparse.ArgumentParser(
        prog="python -m tests.third_party_rigs", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=int, nargs=2, default=(0, 150), metavar=("FIRST", "END")
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("var/third_party_rigs"))
    parser.add_argument(
        "--what", nargs="+", choices=(*WHAT, *FURTHER, *LATEST),
        default=(*WHAT, *FURTHER, *LATEST),
    )  # fmt: skip
    parser.add_argument("--how", nargs="+", choices=HOW, default=HOW)
    parser.add_argument("--patience")
    parser.add_argument(
        "--lengths", action="store_true", help="also cut to a quarter and half of their length"
    )
    asked = parser.parse_args()
    rows, worse, shares = [], [], SHARES if asked.lengths else SHARES[-1:]
    for seed in range(*asked.seeds):
        what, how = plan(seed)
        if what not in asked.what or how not in asked.how:
            continue
        folder = asked.out / f"{seed:04d}"
        if not (folder / "truth.json").exists():
            draw(seed, what, how).write(folder)
        told = [_row(cut(folder, share), asked.patience) for share in shares]
        rows.append(told[-1])
        if gets_worse([row["outcome"] for row in told]):
            worse.append(seed)
        for share, row in zip(shares, told, strict=True):
            named = ", ".join(row.get("named", []))
            print(
                f"{seed:4d} {100 * share:3.0f} % {row['outcome']:14s} {row['seconds']:5.0f} s  "
                f"{row['excitation']:8s}{row['label']:44s} {row.get('contrast', 0):7.1f} "
                f"{row.get('left', 0):6.2f}  {row['verdict']}: {named}",
                flush=True,
            )
    print(table(rows))
    if asked.lengths:
        print(f"worse with longer records: {len(worse)} of {len(rows)} {worse}")
    return 0


def _row(folder: Path, patience: str | None) -> dict[str, Any]:
    """Diagnose a case, unless that is done already, and score the answer."""
    done = folder / "seconds"
    if not done.exists():
        done.write_text(str(diagnose(folder, patience)))
    row = scored(folder) | {"seconds": float(done.read_text())}
    (folder / "row.json").write_text(json.dumps(row))
    return row


if __name__ == "__main__":
    sys.exit(main())
