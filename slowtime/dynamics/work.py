"""Work of simulations, counted where a meter is set: budgets that depend on no clock.

One unit moves one state, or one derivative of a state by a parameter, over one step. A step and
a simulation also cost a fixed number of units, because compiled code has to look up the system
at each step and Python has to prepare each simulation.
"""

import contextlib
import dataclasses
from collections.abc import Iterator
from contextvars import ContextVar

STEP_WORK = 500
"""[units] Fixed cost of one step. Source: least squares of processor times of 14 diagnoses of
systems of one to five degrees of freedom (2.2 µs a step, 4 ns a state)."""
SIMULATION_WORK = 300_000
"""[units] Fixed cost of one simulation. Source: the same fit (1.3 ms)."""


@dataclasses.dataclass(slots=True)
class WorkMeter:
    """Counts work [units]."""

    spent: int = 0


_METER: ContextVar[WorkMeter | None] = ContextVar("work_meter", default=None)


@contextlib.contextmanager
def metered() -> Iterator[WorkMeter]:
    """Count the work that is done within, in this thread.

    Examples
    --------
    >>> with metered() as meter:
    ...     count_simulation(200, 4)
    >>> meter.spent
    400800
    """
    outer = _METER.get()
    meter = WorkMeter()
    token = _METER.set(meter)
    try:
        yield meter
    finally:
        _METER.reset(token)
        if outer is not None:
            outer.spent += meter.spent


@contextlib.contextmanager
def unmetered() -> Iterator[None]:
    """Do not count the work that is done within, in this thread.

    For steps that are bounded by themselves and must not take from the budget of others.

    Examples
    --------
    >>> with metered() as meter, unmetered():
    ...     count_simulation(200, 4)
    >>> meter.spent
    0
    """
    token = _METER.set(None)
    try:
        yield
    finally:
        _METER.reset(token)


def count_work(units: int) -> None:
    """Add work [units] to the meter, if one is set."""
    meter = _METER.get()
    if meter is not None:
        meter.spent += units


def count_simulation(steps: int, width: int) -> None:
    """Add the work of one simulation to the meter, if one is set.

    `width` counts the states that each step moves, with their derivatives by parameters.
    """
    count_work(SIMULATION_WORK + steps * (STEP_WORK + width))
