"""Limit of all that a diagnosis does, search and report alike.

The budget of a search says when no more effects are tried. What follows it, such as free runs
on held-out records and a force surface, has to end as well: once the limit is reached, each fit
ends with the best point so far, and steps that would only improve the report are left out.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from contextvars import ContextVar

LEFT_OUT = (
    "The time limit was reached. Left out or ended early: {steps}. Raise it with --patience."
)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class TimeLimit:
    """When a diagnosis is to end, and what that leaves out.

    Parameters
    ----------
    is_reached
        Whether the time is used up.
    budget_share
        Of the usual budgets of steps that have one of their own [1], such as a force surface.
    left_out
        Steps that were left out or ended early, in words.
    """

    is_reached: Callable[[], bool] = bool
    budget_share: float = 1.0
    left_out: list[str] = dataclasses.field(default_factory=list)

    @property
    def note(self) -> str:
        """What was left out, for the reader of the diagnosis; empty where nothing was."""
        return LEFT_OUT.format(steps=", ".join(self.left_out)) if self.left_out else ""


NO_LIMIT = TimeLimit()
_LIMIT: ContextVar[TimeLimit] = ContextVar("time_limit", default=NO_LIMIT)


@contextlib.contextmanager
def limited(limit: TimeLimit) -> Iterator[None]:
    """Apply a limit to what is done within, in this thread."""
    token = _LIMIT.set(limit)
    try:
        yield
    finally:
        _LIMIT.reset(token)


def leave_out(step: str) -> bool:
    """Whether a step is to be left out or ended; if so, the report tells of it.

    Examples
    --------
    >>> limit = TimeLimit(is_reached=lambda: True)
    >>> with limited(limit):
    ...     leave_out("the force surface")
    True
    >>> limit.left_out
    ['the force surface']
    """
    limit = _LIMIT.get()
    if not limit.is_reached():
        return False
    if step not in limit.left_out:
        limit.left_out.append(step)
    return True


def budget_share() -> float:
    """Share of the usual budgets [1] that steps with a budget of their own get."""
    return _LIMIT.get().budget_share
