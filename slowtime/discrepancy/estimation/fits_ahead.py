"""Fits of candidates that are begun by other processes before it is known if they are needed.

A candidate is fitted with what is known from those before it: the noise, and the cost to beat.
A fit that is begun before those are through knows less, so that it may be another than the one
that is wanted. It is taken only where every comparison that it made has the outcome that it has
now, and there is budget for all of it; otherwise it is made again. So candidates are fitted as
they are one after the other, to the last bit, and the same work is counted.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from slowtime.discrepancy.calibration.levenberg_marquardt import Comparison
from slowtime.discrepancy.workers import Pending, Workers, counted
from slowtime.dynamics.work import count_work

Result = TypeVar("Result")


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Attempt(Generic[Result]):
    """A fit, with what it was compared with.

    Parameters
    ----------
    compared
        Comparisons with the cost to beat, in their order.
    """

    fit: Result
    compared: tuple[Comparison, ...]

    def holds(self, begun_with: float | None, cost_to_beat: float | None) -> bool:
        """Whether the fit would be the same with another cost to beat."""
        return all(
            one.is_beaten(begun_with) == one.is_beaten(cost_to_beat) for one in self.compared
        )


class FitsAhead(Generic[Result]):
    """Fits that are begun ahead, by number of the candidate.

    Parameters
    ----------
    shared
        Objects that fits may refer to, and that stay the same objects.
    """

    def __init__(self, workers: Workers | None, shared: Sequence[object]) -> None:
        self._workers, self._shared = workers, shared
        self._begun: dict[int, tuple[Pending[Attempt[Result]], float | None]] = {}

    @property
    def room(self) -> int:
        """Number of candidates, from the next one on, that are fitted at a time."""
        return 0 if self._workers is None else self._workers.count

    def begin(
        self, number: int, cost_to_beat: float | None, fit: Callable[[], Attempt[Result]]
    ) -> None:
        """Begin a fit that is not begun yet."""
        if self._workers is not None and number not in self._begun:
            pending = self._workers.begin(lambda: counted(fit), self._shared)
            self._begun[number] = pending, cost_to_beat

    def take(
        self, number: int, cost_to_beat: float | None, is_late: Callable[[], bool]
    ) -> Attempt[Result] | None:
        """Take a fit that was begun, and count its work; None where it may be another."""
        if number not in self._begun:
            return None
        pending, begun_with = self._begun.pop(number)
        found = pending.result()
        if found is None or not found[0].holds(begun_with, cost_to_beat):
            return None
        attempt, work = found
        count_work(work)
        if is_late():  # so it may have been before the fit ended
            count_work(-work)
            return None
        return attempt

    def drop(self) -> None:
        """End all fits that were not taken."""
        for pending, _ in self._begun.values():
            pending.drop()
        self._begun.clear()
