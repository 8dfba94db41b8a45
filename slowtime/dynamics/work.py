"""Work of simulations, counted where a meter is set: budgets that depend on no clock.

One unit is one state, or one derivative of a state by a parameter, over one step.
"""

import contextlib
import dataclasses
from collections.abc import Iterator
from contextvars import ContextVar


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
    ...     count_work(200, 4)
    >>> meter.spent
    800
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


def count_work(steps: int, width: int) -> None:
    """Add work to the meter, if one is set.

    Parameters
    ----------
    steps
        Steps of integration that were taken.
    width
        States that each step moves, with their derivatives by parameters.
    """
    meter = _METER.get()
    if meter is not None:
        meter.spent += steps * width
