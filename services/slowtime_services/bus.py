"""How messages move between processes: one protocol, over Zenoh or within one process."""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol


class Sample(NamedTuple):
    """One message as it arrived."""

    key: str
    payload: bytes
    sent_ns: int | None
    """The sender's clock when it handed the message to the bus; None from a foreign sender."""
    replayed: bool
    """Whether it comes from a recording, so that its age says nothing about clocks."""


class Query(NamedTuple):
    """A question put to a process on one of its keys."""

    key: str
    parameters: Mapping[str, str]


class Handle(Protocol):
    """Something declared on the bus; it lasts until closed."""

    def close(self) -> None:
        """Undeclare it."""
        ...


class Bus(Protocol):
    """What every process of the house speaks."""

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send, without waiting for anybody to receive."""
        ...

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback`, from a thread of the bus, for each message; it must only enqueue."""
        ...

    def answer(
        self, key: str, handler: Callable[[Query], Iterable[tuple[str, bytes]]]
    ) -> Handle:
        """Answer questions on `key` with (key, payload) pairs; an exception becomes an error reply."""
        ...

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
    ) -> list[Sample]:
        """All answers to a question; an empty list where nobody answers."""
        ...

    def announce(self, key: str) -> Handle:
        """Be alive under `key` until the handle is closed or the process ends."""
        ...

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback(key, alive)` for each process that is alive, appears or disappears."""
        ...

    def close(self) -> None:
        """End everything that was declared and leave."""
        ...
