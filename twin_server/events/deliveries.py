"""An event on its way to a receiver: the row that is kept, and the identity of the event.

The identity says which event it is, however often it is sent, and after a history was estimated
anew: it is made of what the event is about, not of where it stands in the database.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from slowtime_schemas.answers.alarms import DeliveryState

OPEN: tuple[DeliveryState, ...] = ("waiting", "late")

ALARM = "alarm"
ENTERED = "change_entered"
ACKNOWLEDGED = "alarm_acknowledged"
GIVEN_UP = "alarm_not_delivered"
TEST = "alarm_test"
"""Kinds of events."""

LASTING = (ALARM, ENTERED)
"""Kinds that tell of something that holds until another event says that it does not."""

_OF_NO_BOOT = "twin"
_NAMING = ("quantity", "side", "mode", "suspect")


class Delivery(NamedTuple):
    """One event on its way to one receiver.

    Parameters
    ----------
    id
        Identity of the message at its receiver: the event's, `-r1` for its first reminder and
        so on, `@` and the receiver's name.
    event
        Identity of the event.
    remind_s
        After how long the receiver is reminded [s]; 0 for never.
    due_ns
        When it is sent, or tried again [ns since 1970-01-01 UTC].
    ended_ns
        When it was delivered or given up; 0 until then.
    error
        Why the last attempt failed, in a sentence.
    body
        The event as it travels on the bus and its unit of slow time, JSON.
    """

    id: str
    twin: str
    receiver: str
    event: str
    kind: str
    severity: str
    reminder: int
    remind_s: float
    state: DeliveryState
    tries: int
    created_ns: int
    due_ns: int
    ended_ns: int
    error: str
    body: str

    @property
    def key(self) -> str:
        """Key by which a receiver recognises duplicates: event identity and reminder number."""
        return message_key(self.event, self.reminder)

    def reminding(self, now_ns: int) -> "Delivery":
        """Return the reminder that follows."""
        return self._replace(
            id=f"{message_key(self.event, self.reminder + 1)}@{self.receiver}",
            reminder=self.reminder + 1,
            state="waiting",
            tries=0,
            created_ns=now_ns + round(self.remind_s * 1e9),
            due_ns=now_ns + round(self.remind_s * 1e9),
            ended_ns=0,
            error="",
        )


class AlarmAcknowledgement(NamedTuple):
    """Acknowledgement of an alarm by a person.

    Parameters
    ----------
    event
        Identity of the alarm.
    by
        Who it is said to be.
    principal
        Whose token it was.
    """

    event: str
    twin: str
    t_ns: int
    by: str
    principal: str
    note: str


class DeliveryTally(NamedTuple):
    """Number of deliveries of a twin to a receiver in one state, and since when."""

    twin: str
    receiver: str
    state: DeliveryState
    number: int
    oldest_ns: int


def message_key(event: str, reminder: int) -> str:
    """Identity of a message.

    Examples
    --------
    >>> message_key("5f", 0), message_key("5f", 2)
    ('5f', '5f-r2')
    """
    return f"{event}-r{reminder}" if reminder else event


def identity(event: Mapping[str, Any]) -> str:
    """Return the identity of an event: 32 hexadecimal digits.

    An event that follows from readings is the same when its estimate comes out otherwise, and
    another one at another reading, of another quantity or with another limit.

    Examples
    --------
    >>> alarm = {"site": "lab", "asset": "beam", "boot": "b1", "sequence": 7, "t_ns": 5,
    ...          "kind": "alarm", "details": {"side": "below", "limit": -0.1, "estimate": 1}}
    >>> identity(alarm)
    '59f1856b17386c5b4de99fa65efe7580'
    >>> identity(alarm | {"message": "otherwise"}) == identity(alarm)
    True
    >>> identity(alarm | {"sequence": 8}) == identity(alarm)
    False
    """
    details = event["details"]
    if event["boot"] != _OF_NO_BOOT:
        naming = (*_NAMING, "limit") if "side" in details else _NAMING
        details = {name: details[name] for name in naming if name in details}
    told = [event[n] for n in ("site", "asset", "boot", "sequence", "t_ns", "kind")]
    text = json.dumps([*told, details], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def alarm_key(details: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return quantity, side and limit of the alarm that an event is about."""
    return tuple(details.get(name) for name in ("quantity", "side", "limit"))


def happened_ns(delivery: Delivery) -> int:
    """When it happened by the sensor's clock [ns since 1970-01-01 UTC]."""
    return int(json.loads(delivery.body)["t_ns"])


def subject(delivery: Delivery) -> tuple[Any, ...]:
    """Return the subject of an event; deliveries of one subject repeat each other."""
    details = json.loads(delivery.body)["details"]
    about = (*alarm_key(details), details.get("mode"))
    return (delivery.twin, delivery.receiver, delivery.kind, *about)
