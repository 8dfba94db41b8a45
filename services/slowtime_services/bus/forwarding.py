"""A bus that passes everything to another, for buses that change only a part."""

from collections.abc import Callable, Iterable, Mapping
from typing import Self

from .protocol import MOST_ANSWER_BYTES, Answers, Bus, Handle, Query, Sample


class ForwardingBus:
    """Passes everything to another bus.

    Parameters
    ----------
    bus
        Carries the messages; is closed with this one.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    @property
    def connected(self) -> bool:
        """Whether there is a connection; true of a bus that cannot tell."""
        return bool(getattr(self._bus, "connected", True))

    @property
    def callback_errors(self) -> int:
        """Number of exceptions raised by callbacks and handlers."""
        return self._bus.callback_errors

    @property
    def watch_delay_s(self) -> float:
        """Time that `watch` may take to report processes that are present already [s]."""
        return self._bus.watch_delay_s

    def publish(
        self, key: str, payload: bytes, *, encoding: str, replayed: bool = False
    ) -> None:
        """Send, without waiting for a receiver."""
        self._bus.publish(key, payload, encoding=encoding, replayed=replayed)

    def subscribe(self, key_expression: str, callback: Callable[[Sample], None]) -> Handle:
        """Call `callback` for each message."""
        return self._bus.subscribe(key_expression, callback)

    def answer(
        self, key: str, handler: Callable[[Query], Iterable[tuple[str, bytes]]]
    ) -> Handle:
        """Answer queries on `key` with (key, payload) pairs."""
        return self._bus.answer(key, handler)

    def ask(
        self,
        key_expression: str,
        parameters: Mapping[str, str] | None = None,
        *,
        timeout_s: float = 2.0,
        max_bytes: int = MOST_ANSWER_BYTES,
    ) -> Answers:
        """Return all answers to a query."""
        return self._bus.ask(
            key_expression, parameters, timeout_s=timeout_s, max_bytes=max_bytes
        )

    def announce(self, key: str) -> Handle:
        """Be alive under `key` until the handle is closed or the process ends."""
        return self._bus.announce(key)

    def watch(self, key_expression: str, callback: Callable[[str, bool], None]) -> Handle:
        """Call `callback(key, alive)` for each process."""
        return self._bus.watch(key_expression, callback)

    def close(self) -> None:
        """Close the other bus."""
        self._bus.close()

    def __enter__(self) -> Self:
        """Return the bus, which is closed at the end of the `with` block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()
