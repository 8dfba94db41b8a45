"""Stage beside serve: deliveries that are due in, messages to receivers out."""

from .notifier import Desk, Notifier
from .senders import Sender, WrongReceiverError, senders_of
from .sending import Message, NotDeliveredError, message_of

__all__ = [
    "Desk",
    "Message",
    "NotDeliveredError",
    "Notifier",
    "Sender",
    "WrongReceiverError",
    "message_of",
    "senders_of",
]
