"""The protocol of every bus: publish, subscribe, ask, answer, announce and watch."""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol, Self, runtime_checkable


class Sample(NamedTuple):
    """One message as it arrived."""

    key: str
    payload: bytes
    sent_ns: int | None
    """The sender's clock when it handed the message to the bus; None from a foreign sender."""
    replayed: bool
    """Whether it comes from a recording, so that its age says nothing about clocks."""
    arrived_ns: int | None = None
    """The receiver's clock when it came, where it may wait before it is worked on."""


class Query(NamedTuple):
    """A question put to a process on one of its keys."""

    key: str
    parameters: Mapping[str, str]


class Answers(list[Sample]):
    """The answers to a query, and the errors of those that could not answer."""

    def __init__(self, answers: Iterable[Sample] = (), errors: Iterable[str] = ()) -> None:
        super().__init__(answers)
        self.errors = tuple(errors)


MOST_ANSWERED_BYTES = 2**28
"""What is read of all answers to a query together [bytes], as an inbox holds: four times the
ring of raw samples of an edge, or 10,000 features of 26 KiB."""
_EACH_BYTES = 512
"""Memory of an answer besides its payload [bytes]."""
_LONGEST_ERROR = 1000
"""Characters of an error that another process has answered with, which are kept."""


class AnswersRead:
    """Answers to a query as they come, until they are too much."""

    def __init__(self) -> None:
        self._answers: list[Sample] = []
        self._errors: list[str] = []
        self._bytes = 0

    def take(self, answer: Sample | str) -> bool:
        """Keep an answer or an error; return whether more may come."""
        if isinstance(answer, str):
            self._errors.append(answer[:_LONGEST_ERROR])
            self._bytes += _EACH_BYTES + len(self._errors[-1])
        else:
            self._answers.append(answer)
            self._bytes += _EACH_BYTES + len(answer.payload)
        if self._bytes <= MOST_ANSWERED_BYTES:
            return True
        self._errors.append(
            f"More than {MOST_ANSWERED_BYTES:,} bytes were answered; the rest was not read."
        )
        return False

    @property
    def answers(self) -> Answers:
        """What was read so far."""
        return Answers(self._answers, self._errors)


class BusClosedError(RuntimeError):
    """Something was asked of a bus that has been closed."""

    def __init__(self) -> None:
        super().__init__("This bus is closed. Open a new one; a closed bus stays closed.")


class BusUnreachableError(ConnectionError):
    """No router or peer could be reached, or a port was taken."""


@runtime_checkable
class Handle(Protocol):
    """Something declared on the bus; it lasts until closed."""

    def close(self) -> None:
        """Undeclare it; a second time does nothing."""
        ...


@runtime_checkable
class Bus(Protocol):
    """Interface of the bus that all processes use.

    Callbacks run in a thread of the bus and must only enqueue (see `Inbox`): a slow one holds
    up its sender, and over Zenoh is cut off after five seconds. A callback that raises is
    logged and counted; the stream goes on.
    """

    @property
    def callback_errors(self) -> int:
        """Number of exceptions raised by callbacks and handlers."""
        ...

    @property
    def watch_delay_s(self) -> float:
        """Time that `watch` may take to report processes that are present already [s]."""
        ...

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send, without waiting for a receiver."""
        ...

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback`, from a thread of the bus, for each message; it must only enqueue."""
        ...

    def answer(
        self, key: str, handler: Callable[[Query], Iterable[tuple[str, bytes]]]
    ) -> Handle:
        """Answer queries on `key` with (key, payload) pairs; exceptions are sent as errors."""
        ...

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
    ) -> Answers:
        """Return all answers to a query, and `errors` of those that failed."""
        ...

    def announce(self, key: str) -> Handle:
        """Be alive under `key` until the handle is closed or the process ends."""
        ...

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback(key, alive)` for each process that is alive, appears or disappears."""
        ...

    def close(self) -> None:
        """End everything that was declared and leave; a second time does nothing."""
        ...

    def __enter__(self) -> Self:
        """Return the bus, which is closed at the end of the `with` block."""
        ...

    def __exit__(self, *_: object) -> None:
        """Close."""
        ...
