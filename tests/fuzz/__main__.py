"""A long run of what the default suite samples: ``python -m tests.fuzz wire --cases 9999``."""

import argparse
import logging
import resource
import subprocess
import sys
import time
import warnings

from . import files, formats, wire

MOST_BYTES = 1 << 30
"""That the whole run may add to its memory."""
SLICE = 2_000
"""Requests of one process: what makes them remembers all of them."""


def main() -> int:
    """Run one kind; its counts, its time, and how much memory it took."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("kind", choices=["wire", "files", "formats", "rest"])
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--format", help="One format alone, such as tdms.")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if given.kind == "rest" and given.cases > SLICE:
        return _in_slices(given.cases, given.seed)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
    began = time.monotonic()
    if given.kind == "rest":
        from .house import behind_the_door

        with behind_the_door() as (guard, document, headers):
            from . import rest

            counts = dict(rest.run(guard, document, given.cases, given.seed, headers))
    else:
        # A sum that overflowed is a number that was read wrongly.
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            if given.kind == "formats":
                kinds = (given.format,) if given.format else tuple(formats.MAKERS)
                counts = dict(formats.run(given.cases, given.seed, kinds))
            else:
                counts = {"wire": wire, "files": files}[given.kind].run(given.cases, given.seed)
    took = time.monotonic() - began
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10) - before
    told = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    print(
        f"{given.kind}: {given.cases} cases of seed {given.seed} in {took:.0f} s, "
        f"{more / 2**20:.0f} MiB more at most: {told}"
    )
    return int(more > MOST_BYTES)


def _in_slices(cases: int, seed: int) -> int:
    """Requests in processes of `SLICE`; 1 as soon as one of them fails."""
    for number, begin in enumerate(range(0, cases, SLICE)):
        count = min(SLICE, cases - begin)
        words = ["rest", "--cases", str(count), "--seed", str(1_000 * seed + number)]
        if subprocess.run([sys.executable, "-m", "tests.fuzz", *words], check=False).returncode:
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
