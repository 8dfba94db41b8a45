"""The notice by which estimation asks for an event."""

from typing import Any, Literal, NamedTuple


class Notice(NamedTuple):
    """A fact that estimation asks an event for.

    Parameters
    ----------
    row
        Which of the states it belongs to.
    """

    row: int
    kind: str
    severity: Literal["info", "warning", "alarm"]
    message: str
    details: dict[str, Any]
