"""Stage beside serve: deliveries that are due in, messages to receivers out."""

from .message import Message, NotDeliveredError, message_of
from .notifier import Desk, Notifier
from .senders import Sender, WrongReceiverError, senders_of

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
