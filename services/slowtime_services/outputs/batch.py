"""States and events on their way to a receiver, and the interface of what sends them."""

from typing import NamedTuple, Protocol

from slowtime_schemas.answers.history import EventModel
from slowtime_schemas.answers.twins import RegisteredTwin, State


class Batch(NamedTuple):
    """States and events of one twin, in order.

    Parameters
    ----------
    twin
        As it is now: its registration, whether its edge agent is online, raised alarms.
    is_latest
        Whether the last state is the twin's newest.
    """

    twin: RegisteredTwin
    states: tuple[State, ...]
    events: tuple[EventModel, ...]
    is_latest: bool = True

    @property
    def site(self) -> str:
        """Site of the twin."""
        return self.twin.id.partition(".")[0]

    @property
    def asset(self) -> str:
        """Asset of the twin."""
        return self.twin.id.partition(".")[2]


class NotSentError(Exception):
    """An attempt that failed; the text gives the reason, without secrets.

    Parameters
    ----------
    wait_s
        How long the receiver asks to be left in peace [s].
    is_refused
        Whether the receiver will refuse it again until somebody changes the settings.
    """

    def __init__(self, why: str, wait_s: float = 0.0, *, is_refused: bool = False) -> None:
        super().__init__(why)
        self.wait_s, self.is_refused = wait_s, is_refused


class Output(Protocol):
    """Sends to one receiver, in one thread; `NotSentError` where it does not succeed.

    Parameters
    ----------
    is_archive
        Whether the receiver keeps a history, in which a state that is sent again replaces the
        former one.
    """

    is_archive: bool

    def start(self) -> None:
        """Connect; called again after each failure."""
        ...

    def send(self, batch: Batch) -> None:
        """Send, and return when the receiver has acknowledged."""
        ...

    def close(self) -> None:
        """Disconnect; also after a failure."""
        ...
