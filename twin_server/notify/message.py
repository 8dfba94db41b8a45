"""The message of a delivery, and code that all senders share."""

import json
import socket
from pathlib import Path
from typing import Any, NamedTuple

from slowtime_services.outbound.addresses import LocalAddressError
from slowtime_services.reasons import reason_of
from twin_server.events.deliveries import TEST, Delivery
from twin_server.events.receivers import AlarmSettings


class NotDeliveredError(Exception):
    """An attempt that failed; the text gives the reason, without secrets.

    Parameters
    ----------
    wait_s
        How long the receiver asks to be left in peace [s].
    """

    def __init__(self, why: str, wait_s: float = 0.0) -> None:
        super().__init__(why)
        self.wait_s = wait_s


class Message(NamedTuple):
    """Content of a delivery.

    Parameters
    ----------
    key
        The same for doubles of one message.
    content
        JSON, the same at each attempt.
    title
        One line for people.
    """

    key: str
    event: str
    site: str
    asset: str
    kind: str
    severity: str
    content: dict[str, Any]
    title: str
    page: str | None

    @property
    def payload(self) -> bytes:
        """The content as bytes, the same at each attempt."""
        return json.dumps(self.content, sort_keys=True, separators=(",", ":")).encode()


def message_of(delivery: Delivery, settings: AlarmSettings) -> Message:
    """Write the message of a delivery."""
    body = json.loads(delivery.body)
    site, asset = body["site"], body["asset"]
    page = None
    if settings.page_url is not None:
        page = f"{settings.page_url.rstrip('/')}/#{delivery.twin}"
    told = (
        "t_ns", "slow_time", "slow_time_unit", "boot", "sequence", "kind", "severity",
        "message", "details",
    )  # fmt: skip
    content = {
        "slowtime_event": 1,
        "id": delivery.key,
        "event_id": delivery.event,
        "twin": delivery.twin,
        "reminder": delivery.reminder,
        "test": delivery.kind == TEST,
        "page": page,
        **{name: body.get(name) for name in told},
    }
    again = f" (reminder {delivery.reminder})" if delivery.reminder else ""
    said = " ".join(str(body["message"]).split())
    title = f"{delivery.severity}: {delivery.twin}: {said}{again}"
    return Message(
        delivery.key, delivery.event, site, asset, delivery.kind, delivery.severity, content,
        title, page,
    )  # fmt: skip


def credentials(path: Path | None) -> tuple[str, str] | None:
    """Read user and password, a line each; again at each attempt, so that they may change."""
    if path is None:
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise NotDeliveredError(
            f"{path.name} cannot be read: {reading_error_text(error)}."
        ) from error
    if len(lines) < 2 or not lines[0]:
        raise NotDeliveredError(
            f"{path.name} holds {len(lines)} line(s). Give the user in the first line and the "
            "password in the second."
        )
    return lines[0], lines[1]


def reading_error_text(error: OSError | ValueError) -> str:
    """Describe why a file cannot be read, without its path: people of a site see the text."""
    return getattr(error, "strerror", None) or type(error).__name__


def connection_error_text(error: BaseException) -> str:
    """Describe the error of a connection."""
    if isinstance(error, LocalAddressError):
        return str(error)
    if isinstance(error, TimeoutError):
        return "it did not answer in time"
    if isinstance(error, ConnectionRefusedError):
        return "nothing listens there"
    if isinstance(error, socket.gaierror):
        return "its name is not known"
    if isinstance(error, ConnectionError):
        return "it ended the connection"
    return reason_of(error).rstrip(".")[:200]
