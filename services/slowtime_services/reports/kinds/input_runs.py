"""Runs of inputs that have the same distribution, which lists write as one."""

from collections.abc import Iterator, Sequence
from typing import Any

from slowtime.reliability import Conditional, Problem
from slowtime_services.problem_files.stated import Stated

FEWEST_ALIKE = 4
"""Inputs in a row [1] from which they are written as one: three take hardly more room."""


def runs_of_inputs(problem: Problem, stated: Stated) -> list[list[str]]:
    """Group neighbouring inputs of the same distribution and unit; others stand alone."""
    return [
        part
        for run in _neighbours(problem, stated)
        for part in ([run] if len(run) >= FEWEST_ALIKE else [[name] for name in run])
    ]


def run_name(run: Sequence[str]) -> str:
    """Name the inputs of a run.

    Examples
    --------
    >>> run_name(["r"]), run_name(["x0", "x1", "x2", "x3"])
    ('r', 'x0 … x3 (4)')
    """
    return run[0] if len(run) == 1 else f"{run[0]} … {run[-1]} ({len(run)})"


def _neighbours(problem: Problem, stated: Stated) -> Iterator[list[str]]:
    run: list[str] = []
    last: Any = None
    for name, law in problem.inputs.items():
        # Distributions of scipy are not compared: each is its own.
        own = (law.name, law.parameters) if getattr(law, "parameters", ()) else id(law)
        key = (id(law) if isinstance(law, Conditional) else own, stated.units.get(name, ""))
        if run and key == last:
            run.append(name)
            continue
        if run:
            yield run
        run, last = [name], key
    if run:
        yield run
