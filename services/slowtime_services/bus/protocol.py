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


MOST_ANSWER_BYTES = 2**30
"""Bytes of all answers to one query, unless fewer are allowed: sixteen of the longest blocks of
raw samples, so that a process that answers without end does not fill the memory."""


_EACH_BYTES = 512
"""Memory of an answer besides its payload [bytes]."""


class Query(NamedTuple):
    """A question put to a process on one of its keys."""

    key: str
    parameters: Mapping[str, str]


class Answers(list[Sample]):
    """The answers to a query, and the errors of those that could not answer."""

    def __init__(self, answers: Iterable[Sample] = (), errors: Iterable[str] = ()) -> None:
        super().__init__(answers)
        self.errors = tuple(errors)

    @classmethod
    def first_of(cls, samples: Iterable[Sample], max_bytes: int) -> Self:
        """Take answers as they come, up to `max_bytes` of payloads; then say so in `errors`."""
        taken: list[Sample] = []
        left = max_bytes
        for sample in samples:
            left -= len(sample.payload) + _EACH_BYTES
            if left < 0:
                said = f"Answers of more than {max_bytes:,} bytes were given; the rest is left."
                return cls(taken, [said])
            taken.append(sample)
        return cls(taken)


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
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """Return all answers to a query, and `errors` of those that failed.

        Where they are of more than `max_bytes`, the first of them, with an error.
        """
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
