"""Compilation of the integrator by several processes, where no code is on disk yet."""

from slowtime.discrepancy.workers import Workers
from slowtime.dynamics.plant.kernel import ROUTINES


def compile_ahead(workers: Workers) -> None:
    """Compile what a diagnosis needs of the integrator, each routine by the next free worker.

    What others compile is read from the disk afterwards. Where the first routine is on disk,
    the others are taken to be, too.

    Parameters
    ----------
    workers
        Processes that share the work.
    """
    if ROUTINES.compile(0):
        return
    # Long ones stand last, and are begun first, so that no worker ends much after the others.
    rest = range(len(ROUTINES) - 1, 0, -1)
    workers.map(lambda number: (ROUTINES.compile(number), 0), rest, ())
