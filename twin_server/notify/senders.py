"""Makes the sender of each declared receiver."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from twin_server.events.receivers import AlarmSettings

from .mail import Email
from .message import Message, NotDeliveredError
from .mqtt import MqttSender
from .plugin import PluginSender
from .webhook import Webhook


class WrongReceiverError(ValueError):
    """A receiver that cannot be sent to as it is declared."""


class Sender(Protocol):
    """Sends to one receiver, in whatever thread; waits no longer than the receiver's time."""

    def check(self) -> None:
        """Raise `NotDeliveredError` where it cannot be sent to as things are."""
        ...

    def send(self, message: Message) -> str:
        """Send, or raise `NotDeliveredError`; return a note on the success."""
        ...


KINDS: Mapping[str, Callable[[Any], Sender]] = {
    "webhook": Webhook,
    "email": Email,
    "mqtt": MqttSender,
    "own": PluginSender,
}


def senders_of(settings: AlarmSettings) -> dict[str, Sender]:
    """Make the sender of each receiver, by its name.

    Raises
    ------
    WrongReceiverError
        Where a secret, a password or a driver is not there.
    """
    found = {}
    for name, receiver in settings.receivers.items():
        try:
            found[name] = KINDS[receiver.kind](receiver)
            found[name].check()
        except NotDeliveredError as error:
            raise WrongReceiverError(f"The receiver {name} cannot be used. {error}") from error
    return found
