"""Stage beside serve: deliveries that are due in, messages to receivers out."""

from .message import Message, NotDeliveredError, message_of
from .notifier import DeliveryStore, Notifier
from .senders import Sender, WrongReceiverError, senders_of

__all__ = [
    "DeliveryStore",
    "Message",
    "NotDeliveredError",
    "Notifier",
    "Sender",
    "WrongReceiverError",
    "message_of",
    "senders_of",
]
