"""What an edge agent costs before its first sample, as ratios to the libraries it stands on.

`python -m benchmarks.processes.edge_startup` takes ten seconds. The floor is a process that
imports NumPy, `scipy.signal`, zenoh and pydantic in the same run; memory is the most that a
process held.
"""

import os
import subprocess
import sys

RUNS = 3
MOST = 1.0
"""Ratio that neither figure may exceed: an edge is lighter than `scipy.signal` is."""

FLOOR = "import numpy, scipy.signal, zenoh, pydantic"
EDGE = "import edge_agent.__main__"
MEASURED = """
import resource
{code}
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def cost(code: str) -> tuple[float, float]:
    """Least processor time [s] and memory [MiB] of a process that runs `code`."""
    found = []
    for _ in range(RUNS):
        done = subprocess.run(
            [sys.executable, "-c", MEASURED.format(code=code)],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )
        seconds, memory = map(float, done.stdout.split())
        found.append((seconds, memory))
    return min(one[0] for one in found), min(one[1] for one in found)


def main() -> int:
    """Print both ratios; 1 where one is more than `MOST`."""
    floor, edge = cost(FLOOR), cost(EDGE)
    print(f"floor: {floor[0]:.2f} s of processor time, {floor[1]:.0f} MiB, as 1.0")
    ratios = [mine / least for mine, least in zip(edge, floor, strict=True)]
    print(f"{ratios[0]:6.2f}  processor time of importing the edge, {edge[0]:.2f} s")
    print(f"{ratios[1]:6.2f}  memory of importing the edge, {edge[1]:.0f} MiB")
    return int(max(ratios) > MOST)


if __name__ == "__main__":
    sys.exit(main())
