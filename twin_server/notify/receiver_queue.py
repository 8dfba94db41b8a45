"""The threads that send to one receiver, so that a slow receiver delays no other."""

import logging
import queue
import threading
from collections.abc import Callable
from typing import NamedTuple

from twin_server.events.deliveries import Delivery
from twin_server.events.receivers import AlarmSettings

from .message import NotDeliveredError, message_of
from .senders import Sender

logger = logging.getLogger(__name__)

_WAITING_OF_EACH = 16
"""Messages that a thread has before it: their outcomes wait for the disk together."""


class Attempted(NamedTuple):
    """Outcome of one attempt.

    Parameters
    ----------
    said
        Of a success what there is to say, of a failure why.
    wait_s
        How long the receiver asks to be left in peace [s].
    """

    delivery: Delivery
    delivered: bool
    said: str
    wait_s: float = 0.0


class ReceiverQueue:
    """Threads and deliveries of one receiver.

    Parameters
    ----------
    tell
        Told each outcome, by the threads of the queue.
    """

    def __init__(
        self,
        name: str,
        sender: Sender,
        concurrency: int,
        settings: AlarmSettings,
        tell: Callable[[Attempted], None],
    ) -> None:
        self.name = name
        self._sender, self._settings, self._tell = sender, settings, tell
        self._most = concurrency * _WAITING_OF_EACH
        self._given: queue.SimpleQueue[Delivery | None] = queue.SimpleQueue()
        self._held: set[str] = set()
        self._threads = [
            threading.Thread(target=self._run, name=f"notify-{name}", daemon=True)
            for _ in range(concurrency)
        ]

    def start(self) -> None:
        """Begin to send."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Begin no more deliveries; those in progress continue."""
        while True:
            try:
                self._given.get_nowait()
            except queue.Empty:
                break
        for _ in self._threads:
            self._given.put(None)

    def join(self, timeout_s: float) -> None:
        """Wait for deliveries in progress, but not for a receiver that takes longer.

        Parameters
        ----------
        timeout_s
            Longest time to wait for each thread [s].
        """
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout_s)

    @property
    def held(self) -> int:
        """Number of deliveries in the queue that are not settled."""
        return len(self._held)

    @property
    def room(self) -> int:
        """Number of deliveries that still fit."""
        return self._most - len(self._held)

    def give(self, delivery: Delivery) -> None:
        """Queue a delivery, unless it is in progress."""
        if delivery.id not in self._held and self.room > 0:
            self._held.add(delivery.id)
            self._given.put(delivery)

    def settled(self, delivery: Delivery) -> None:
        """Note that the outcome of one has become durable."""
        self._held.discard(delivery.id)

    def _run(self) -> None:
        while (delivery := self._given.get()) is not None:
            self._tell(self._attempt(delivery))

    def _attempt(self, delivery: Delivery) -> Attempted:
        try:
            said = self._sender.send(message_of(delivery, self._settings))
        except NotDeliveredError as error:
            return Attempted(delivery, False, str(error), error.wait_s)
        except Exception as error:  # a fault of ours costs this attempt and no other
            logger.exception("%s could not be sent to %s.", delivery.key, self.name)
            return Attempted(delivery, False, f"A fault of the server: {type(error).__name__}.")
        return Attempted(delivery, True, said)
