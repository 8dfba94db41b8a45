"""The update of one twin after a batch, and the protocol of listeners to updates."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from twin_server.history.details import Bodies
from twin_server.history.states import States


class TwinUpdate(NamedTuple):
    """Durable states and events of one twin after a batch."""

    twin_id: str
    states: States
    runs: Sequence[tuple[int, str, str]]
    """Of each state: number and name of its boot, unit of its slow time."""
    events: Sequence[tuple[int, str]]
    bodies: Bodies = ()
    """Of each state of a twin of elements, its detail; empty for other twins."""


class UpdateListener(Protocol):
    """Receives the updates of twins in the working thread, and must not wait."""

    def tell(self, news: TwinUpdate) -> None:
        """Take the update of one twin."""
        ...

    def reset(self, twin_id: str) -> None:
        """Note that a twin's history has been rewritten or deleted."""
        ...
