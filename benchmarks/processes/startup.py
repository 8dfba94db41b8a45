"""What the command costs before it works: help, and refusing, as ratios to importing NumPy.

`python -m benchmarks.processes.startup` takes half a minute. Each figure is the processor time
(user and system) of a whole process, the least of `RUNS`, over that of ``python -c "import
numpy"`` in the same run.
"""

import os
import resource
import subprocess
import sys
from collections.abc import Iterator, Sequence

import click

from slowtime_cli.__main__ import app

RUNS = 3
MOST = 3.0
"""Ratio that none may exceed."""


def processor_s(arguments: Sequence[str]) -> float:
    """Least processor time [s] of a process that is started with `arguments`."""
    least = float("inf")
    for _ in range(RUNS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        least = min(least, spent)
    return least


def asked() -> Iterator[tuple[str, ...]]:
    """Help of every verb, and for each that takes a file one that is missing."""
    yield ("--help",)
    context = click.Context(app)
    for verb in app.list_commands(context):
        yield (verb, "--help")
        command = app.get_command(context, verb)
        assert command is not None
        for parameter in command.params:
            if getattr(parameter.type, "exists", False):
                flag = (parameter.opts[0],) if isinstance(parameter, click.Option) else ()
                yield (verb, *flag, "missing.json")
                break
    yield ("tokens", "add", "ann", "--scope", "viewer")
    yield ("keys", "make", "Lab")


def main() -> int:
    """Print each ratio; 1 where one is more than `MOST`."""
    numpy_s = processor_s(["-c", "import numpy"])
    print(f"import numpy: {numpy_s * 1e3:.0f} ms of processor time, as 1.0")
    status = 0
    for arguments in asked():
        ratio = processor_s(["-m", "slowtime_cli", *arguments]) / numpy_s
        print(f"{ratio:6.2f}  slowtime {' '.join(arguments)}")
        status |= ratio > MOST
    return status


if __name__ == "__main__":
    sys.exit(main())
