"""Workers of one diagnosis: processes that are forked where they are needed.

A forked process has all that is in memory, so that nothing is sent to it, and it may compute
whatever this one may. Only results are sent back. Where a process is lost, what it had to do is
done by this one.
"""

import contextlib
import dataclasses
import io
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, TypeVar

from slowtime.discrepancy.workers import Counted, Pending, Workers, helping

Item = TypeVar("Item")
Result = TypeVar("Result")
TOKEN_BYTES = 4
"""[bytes] Of the number of an item; as a pipe gives so few whole, each goes to one process."""
MOST_TOKENS = 1000
"""[items] Dealt at a time: so many numbers fit into a pipe of any system (4 KiB)."""


def can_fork() -> bool:
    """Whether this process can be forked: on Linux, and while it runs no other thread.

    On macOS, libraries of the system do not stand a fork; Windows has none. A thread may hold
    a lock that a forked process would wait for.
    """
    return sys.platform == "linux" and threading.active_count() == 1


@dataclasses.dataclass(frozen=True, slots=True)
class ForkedWorkers(Workers):
    """Processes that are forked from this one.

    Parameters
    ----------
    count
        Number of processes that work at a time, this one included.
    """

    count: int

    def begin(
        self, function: Callable[[], Counted[Result]], shared: Sequence[object]
    ) -> Pending[Result]:
        """Begin to compute in a forked process."""
        return _Forked(lambda: [(0, function())], shared)

    def map(
        self,
        function: Callable[[Item], Counted[Result]],
        items: Sequence[Item],
        shared: Sequence[object],
    ) -> list[Counted[Result]]:
        """Compute for each item, each process taking the next whenever it is ready."""
        found: list[Counted[Result]] = []
        for first in range(0, len(items), MOST_TOKENS):
            found += self._map_some(function, items[first : first + MOST_TOKENS], shared)
        return found

    def _map_some(
        self,
        function: Callable[[Item], Counted[Result]],
        items: Sequence[Item],
        shared: Sequence[object],
    ) -> list[Counted[Result]]:
        def attempt(number: int) -> Any:
            try:
                return function(items[number])
            except Exception as error:
                return error

        with _dealt(len(items)) as numbers, contextlib.ExitStack() as stack:
            others: list[_Forked[Result]] = []
            for _ in range(min(self.count, len(items)) - 1):
                others.append(_Forked(lambda: [(n, attempt(n)) for n in numbers()], shared))
                stack.callback(others[-1].drop)
            found = {}
            for number in numbers():
                found[number] = attempt(number)
                if isinstance(found[number], Exception):
                    break
            for other in others:
                found.update(other.results() or ())
        results = []
        for number in range(len(items)):
            one = found[number] if number in found else attempt(number)
            if isinstance(one, Exception):
                raise one
            results.append(one)
        return results


@contextlib.contextmanager
def _dealt(count: int) -> Iterator[Callable[[], Iterator[int]]]:
    """Deal numbers below a count to the processes that take them, each number to one."""
    read, write = os.pipe()
    try:
        os.write(write, b"".join(n.to_bytes(TOKEN_BYTES, "big") for n in range(count)))
    finally:
        os.close(write)

    def take() -> Iterator[int]:
        while len(token := os.read(read, TOKEN_BYTES)) == TOKEN_BYTES:
            yield int.from_bytes(token, "big")

    try:
        yield take
    finally:
        os.close(read)


class _Forked(Generic[Result]):
    """A forked process, and the pipe that brings its results."""

    def __init__(
        self, function: Callable[[], list[tuple[int, Any]]], shared: Sequence[object]
    ) -> None:
        self._shared = tuple(shared)
        self._pipe, write = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        self._process = os.fork()
        if self._process == 0:
            _compute(function, self._shared, write)
        os.close(write)

    def results(self) -> list[tuple[int, Any]] | None:
        """Wait for the results by number; None where the process was lost."""
        if self._process == 0:
            return None
        with open(self._pipe, "rb", closefd=False) as pipe:
            sent = pipe.read()
        self.drop()
        if not sent:
            return None
        found: list[tuple[int, Any]] = _Unpickler(io.BytesIO(sent), self._shared).load()
        return found

    def result(self) -> Counted[Result] | None:
        """Wait for the one result; None where the process was lost."""
        found = self.results()
        return found[0][1] if found else None

    def drop(self) -> None:
        """End the process."""
        if self._process == 0:
            return
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        os.close(self._pipe)
        self._process = 0


def _compute(
    function: Callable[[], list[tuple[int, Any]]], shared: Sequence[object], write: int
) -> None:
    """In the forked process: compute, send the results whole or not at all, and end."""
    try:
        with helping():
            found = function()
        room = io.BytesIO()
        _Pickler(room, shared).dump(found)
        with open(write, "wb") as pipe:
            pipe.write(room.getbuffer())
    finally:
        os._exit(0)  # what this process inherited is for the other to close


class _Pickler(pickle.Pickler):
    """Refers to shared objects by number."""

    def __init__(self, room: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(room, protocol=pickle.HIGHEST_PROTOCOL)
        self._numbers = {id(one): number for number, one in enumerate(shared)}

    def persistent_id(self, obj: Any) -> int | None:
        """Return the number of a shared object, None of others."""
        return self._numbers.get(id(obj))


class _Unpickler(pickle.Unpickler):
    """Finds shared objects by number."""

    def __init__(self, room: io.BytesIO, shared: Sequence[object]) -> None:
        super().__init__(room)
        self._shared = shared

    def persistent_load(self, pid: Any) -> Any:
        """Return the shared object of a number."""
        return self._shared[pid]
