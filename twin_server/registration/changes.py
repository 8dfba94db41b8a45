"""Two registrations of a twin → what changed between them, with its author."""

import dataclasses
from typing import Any

from slowtime_schemas.twin_changes import SETTABLE

from .twin import Registration

DISPLAYED = frozenset(
    {
        "name",
        "costs",
        "decision",
        "limit_states",
        "alarm_routes",
        "forecast",
        "on_disagreement",
    }
)
"""Fields that no estimate depends on: after changing them, all states stay as they are."""


@dataclasses.dataclass(frozen=True, slots=True)
class Author:
    """Who changes a registration, and why.

    Parameters
    ----------
    principal
        Whose token it is.
    person
        Name that was given, or that of the token.
    reverses
        Number of the change that is undone.
    """

    principal: str
    person: str
    text: str = ""
    reverses: int | None = None


def changed_fields(before: Registration, after: Registration) -> list[str]:
    """Name the fields that differ, in the order of the registration."""
    names = type(before).model_fields
    return [name for name in names if getattr(before, name) != getattr(after, name)]


def change_details(before: Registration, after: Registration, author: Author) -> dict[str, Any]:
    """Return the change as it is kept in the event that says so."""
    old, new = before.to_dict(), after.to_dict()
    names = changed_fields(before, after)
    return {
        "person": author.person,
        "principal": author.principal,
        "text": author.text,
        "reverses": author.reverses,
        "changes": [
            {"field": name, "before": old[name], "after": new[name]}
            for name in names
            if name in SETTABLE
        ],
        "others": [name for name in names if name not in SETTABLE],
    }


def change_sentence(details: dict[str, Any]) -> str:
    """Say who changed which fields of a registration, and why."""
    names = [one["field"] for one in details["changes"]] + details["others"]
    done = "Changed" if details["reverses"] is None else f"Undone: change {details['reverses']}"
    why = f" {details['text']}" if details["text"] else ""
    return f"{done} by {details['person']}: {', '.join(names)}.{why}"
