"""What a batch has brought, and who wants to hear of it."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from twin_server.history.details import Bodies
from twin_server.history.states import States


class TwinUpdate(NamedTuple):
    """What a batch has brought of one twin, once it is durable."""

    twin_id: str
    states: States
    runs: Sequence[tuple[int, str, str]]
    """Of each state: number and name of its boot, unit of its slow time."""
    events: Sequence[tuple[int, str]]
    bodies: Bodies = ()
    """Of each state of a twin of elements, its detail; empty for other twins."""


class UpdateListener(Protocol):
    """Somebody who wants to know what is new; called by the working thread, must not wait."""

    def tell(self, news: TwinUpdate) -> None:
        """Hear what is new of one twin."""
        ...

    def reset(self, twin_id: str) -> None:
        """Hear that a twin's history has been made anew, or has gone."""
        ...
