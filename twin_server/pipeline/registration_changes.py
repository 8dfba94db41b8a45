"""Changes fields of registrations, undoes such changes, and lists them with their authors."""

import json
from typing import Any

from pydantic import ValidationError

from slowtime_schemas.registration_changes import RegistrationChangeOrder
from twin_server.persist import EventRow, Store
from twin_server.registration.changes import Author
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

from .ingestion.estimation import NotEstimatedError
from .ingestion.pipeline import Pipeline
from .ingestion.routing import UnknownReceiverError

MOST_EVENTS = 10_000
"""Newest events of a twin among which changes are looked for."""

_KIND = "registered"


class RegistrationHistory:
    """Interface of store and pipeline for changes of registrations, used by REST."""

    def __init__(self, pipeline: Pipeline, store: Store) -> None:
        self._pipeline, self._store = pipeline, store

    def change(
        self, twin_id: str, order: RegistrationChangeOrder, principal: str
    ) -> dict[str, Any]:
        """Change fields of a registration; return the stored change.

        Raises
        ------
        ProblemError
            Where the values are not valid, are others by now, or nothing would change.
        """
        return self._pipeline.call(lambda: self._change(twin_id, order, principal))

    def listed(self, twin_id: str) -> dict[str, Any]:
        """Return the changes of a registration, the newest first."""
        rows = self._store.events(twin_id, limit=MOST_EVENTS, newest=True)
        found = [one for row in rows if (one := _change_document(row)) is not None]
        undone: dict[int, int] = {}
        for one in reversed(found):  # the undoing of an undoing comes later
            if one["number"] not in undone and one["reverses"] is not None:
                undone.setdefault(one["reverses"], one["number"])
        told = [one | {"reversed_by": undone.get(one["number"])} for one in found]
        return {"id": twin_id, "changes": told[::-1]}

    def _change(
        self, twin_id: str, order: RegistrationChangeOrder, principal: str
    ) -> dict[str, Any]:
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            raise ProblemError(404, "no-such-twin", f"No twin is called {twin_id} any more.")
        before: dict[str, Any] = {str(name): value for name, value in order.before.items()}
        after: dict[str, Any] = {str(name): value for name, value in order.after.items()}
        if order.reverses is not None:
            before, after = self._reversed(twin_id, order.reverses)
        now = twin.registration.to_dict()
        other = [name for name, value in before.items() if now[name] != value]
        if other:
            raise ProblemError(
                409,
                "changed-meanwhile",
                f"Somebody has changed {', '.join(other)} of {twin_id} meanwhile. Look at the "
                "values that hold now, and change those; undo the latest change first.",
            )
        registration = _validated(now | after)
        if registration == twin.registration:
            raise ProblemError(
                409, "nothing-changed", f"{twin_id} has these values already. Give others."
            )
        author = Author(principal, order.person or principal, order.text, order.reverses)
        try:
            self._pipeline.routing.check(twin_id, registration)
            self._pipeline.register(twin_id, registration, author=author)
        except UnknownReceiverError as error:
            raise ProblemError(422, "no-such-receiver", str(error)) from error
        except NotEstimatedError as error:
            raise ProblemError(422, "not-estimated", str(error)) from error
        newest: dict[str, Any] = self.listed(twin_id)["changes"][0]
        return newest

    def _reversed(self, twin_id: str, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the fields of a change as they have to be now, and as they were before it."""
        changes = self.listed(twin_id)["changes"]
        found = next((one for one in changes if one["number"] == number), None)
        if found is None or found["others"]:
            can = [str(one["number"]) for one in changes if not one["others"]]
            why = f"It changed {', '.join(found['others'])} too. " if found else ""
            raise ProblemError(
                409,
                "no-such-change",
                f"At body.reverses, {number} was given. {why}Changes that can be undone: "
                f"{', '.join(can[:20]) or 'none'}.",
            )
        fields = found["changes"]
        return (
            {one["field"]: one["after"] for one in fields},
            {one["field"]: one["before"] for one in fields},
        )


def _change_document(row: EventRow) -> dict[str, Any] | None:
    """Return the change that an event tells of; None of another event."""
    if f'"{_KIND}"' not in row.body:
        return None
    body = json.loads(row.body)
    if body["kind"] != _KIND or "change" not in body["details"]:
        return None
    return {"number": row.number, "t_ns": row.t_ns, **body["details"]["change"]}


def _validated(given: dict[str, Any]) -> Registration:
    try:
        return Registration.model_validate(given)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join(map(str, ("body", "after", *fault["loc"])))
        raise ProblemError(422, "not-valid", f"At {where}: {fault['msg']}") from error
