"""A long run of what the default suite samples: ``python -m tests.fuzz wire --cases 9999``."""

import argparse
import resource
import sys
import time

from . import files, wire

MOST_BYTES = 1 << 30
"""That the whole run may add to its memory."""


def main() -> int:
    """Run one kind; its counts, its time, and how much memory it took."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("kind", choices=["wire", "files", "rest"])
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
    began = time.monotonic()
    if given.kind == "rest":
        from .house import behind_the_door

        with behind_the_door() as (guard, document, headers):
            from . import rest

            counts = dict(rest.run(guard, document, given.cases, given.seed, headers))
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


if __name__ == "__main__":
    sys.exit(main())
