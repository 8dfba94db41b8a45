"""Processes that share the work of one diagnosis.

How processes are made is none of this package's business: whoever starts a diagnosis hands it
`Workers`. Without, all is done in one process. What is found is the same in either case, to the
last bit, and so is the work that is counted.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import Protocol, TypeVar, runtime_checkable

from slowtime.dynamics.work import count_work, metered

Item = TypeVar("Item")
Result = TypeVar("Result")
Found = TypeVar("Found", covariant=True)
Counted = tuple[Result, int]
"""A result, and the work that it took [units]."""


@runtime_checkable
class Pending(Protocol[Found]):
    """A result that another process works on."""

    def result(self) -> Counted[Found] | None:
        """Wait for the result and its work; None where the process was lost."""
        ...

    def drop(self) -> None:
        """End the process: the result is not needed."""
        ...


@runtime_checkable
class Workers(Protocol):
    """Processes beside this one that compute with what is in its memory now."""

    @property
    def count(self) -> int:
        """Number of processes that work at a time, this one included."""
        ...

    def begin(
        self, function: Callable[[], Counted[Result]], shared: Sequence[object]
    ) -> Pending[Result]:
        """Begin to compute beside this process, which sees all that is in memory now."""
        ...

    def map(
        self,
        function: Callable[[Item], Counted[Result]],
        items: Sequence[Item],
        shared: Sequence[object],
    ) -> list[Counted[Result]]:
        """Compute for each item; results stand in the order of the items.

        Objects in `shared` may be referred to by results, and stay the same objects. Raises the
        first exception, in the order of the items, that a computation ended with.
        """
        ...


_WORKERS: ContextVar[Workers | None] = ContextVar("workers", default=None)
_HELPS: ContextVar[bool] = ContextVar("helps", default=False)


@contextlib.contextmanager
def shared_among(workers: Workers | None) -> Iterator[None]:
    """Share what is computed within among workers; none where None."""
    token = _WORKERS.set(workers)
    try:
        yield
    finally:
        _WORKERS.reset(token)


@contextlib.contextmanager
def helping() -> Iterator[None]:
    """Compute for another process: nothing is shared further, and no progress is told."""
    tokens = _WORKERS.set(None), _HELPS.set(True)
    try:
        yield
    finally:
        _WORKERS.reset(tokens[0])
        _HELPS.reset(tokens[1])


def is_helping() -> bool:
    """Whether this is computed for another process."""
    return _HELPS.get()


def current_workers() -> Workers | None:
    """Return the workers that computations are shared among; None where there are none."""
    workers = _WORKERS.get()
    return workers if workers is not None and workers.count > 1 else None


def map_shared(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    shared: Sequence[object] = (),
) -> list[Result]:
    """Compute for each item, beside each other where there are workers.

    The function must not change anything, nor ask for the budget. Objects in `shared` may be
    referred to by results, and stay the same objects.

    Examples
    --------
    >>> map_shared(lambda number: number**2, [1, 2, 3])
    [1, 4, 9]
    """
    workers = current_workers()
    if workers is None or len(items) < 2:
        return [function(item) for item in items]

    def compute(item: Item) -> Counted[Result]:
        with shared_among(None):  # the others are busy
            return counted(lambda: function(item))

    found = workers.map(compute, items, shared)
    count_work(sum(work for _, work in found))
    return [value for value, _ in found]


def counted(function: Callable[[], Result]) -> Counted[Result]:
    """Compute, and count the work it takes [units], which is not counted elsewhere."""
    with metered() as meter:
        value = function()
    count_work(-meter.spent)
    return value, meter.spent
