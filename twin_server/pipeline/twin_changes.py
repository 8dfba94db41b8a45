"""Changes registrations and recorded events, undoes changes, and lists them with authors."""

import json
from typing import Any

from pydantic import ValidationError

from slowtime_schemas.asset_events import AssetEvent
from slowtime_schemas.twin_changes import CORRECTABLE, TwinChangeOrder
from twin_server.events.asset_events import TOLD, content
from twin_server.persist import EventRow, Store
from twin_server.registration.changes import Author
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

from .asset_events import AssetEvents
from .ingestion.estimation import NotEstimatedError
from .ingestion.pipeline import Pipeline
from .ingestion.routing import UnknownReceiverError

MOST_EVENTS = 10_000
"""Newest events of a twin among which changes are looked for."""

_REGISTERED = "registered"


class ChangeHistory:
    """Interface of store and pipeline for changes of twins, used by REST.

    Parameters
    ----------
    asset_events
        Corrects recorded events.
    """

    def __init__(self, pipeline: Pipeline, store: Store, asset_events: AssetEvents) -> None:
        self._pipeline, self._store, self._asset_events = pipeline, store, asset_events

    def change(self, twin_id: str, order: TwinChangeOrder, principal: str) -> dict[str, Any]:
        """Change fields of a registration or of a recorded event; return the stored change.

        Raises
        ------
        ProblemError
            Where the values are not valid, are others by now, or nothing would change.
        """
        return self._pipeline.call(lambda: self._change(twin_id, order, principal))

    def listed(self, twin_id: str) -> dict[str, Any]:
        """Return the changes of a registration and of recorded events, the newest first."""
        rows = self._store.events(twin_id, limit=MOST_EVENTS, newest=True)
        found: list[dict[str, Any]] = []
        recorded: dict[str, AssetEvent] = {}
        for row in rows:
            if f'"{_REGISTERED}"' not in row.body and '"corrects"' not in row.body:
                continue
            body = json.loads(row.body)
            if body["kind"] == _REGISTERED and "change" in body["details"]:
                found.append(_document(row) | body["details"]["change"])
            elif body["kind"] == TOLD and "corrects" in body["details"]:
                recorded = recorded or {
                    one.event: one.message for one in self._store.asset_events(twin_id)
                }
                found.append(_document(row) | _correction(body["details"], recorded, found))
        undone: dict[int, int] = {}
        for one in reversed(found):  # the undoing of an undoing comes later
            if one["number"] not in undone and one["reverses"] is not None:
                undone.setdefault(one["reverses"], one["number"])
        told = [one | {"reversed_by": undone.get(one["number"])} for one in found]
        return {"id": twin_id, "changes": told[::-1]}

    def _change(self, twin_id: str, order: TwinChangeOrder, principal: str) -> dict[str, Any]:
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            raise ProblemError(404, "no-such-twin", f"No twin is called {twin_id} any more.")
        before: dict[str, Any] = {str(name): value for name, value in order.before.items()}
        after: dict[str, Any] = {str(name): value for name, value in order.after.items()}
        event = order.event
        if order.reverses is not None:
            undone = self._undoable(twin_id, order.reverses)
            event = undone["recorded_as"]
            before = {one["field"]: one["after"] for one in undone["changes"]}
            after = {one["field"]: one["before"] for one in undone["changes"]}
        author = Author(principal, order.person or principal, order.text, order.reverses)
        if event is not None:
            self._asset_events.correct(twin_id, twin.registration, event, after, author)
            return self._newest(twin_id)
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
        try:
            self._pipeline.routing.check(twin_id, registration)
            self._pipeline.register(twin_id, registration, author=author)
        except UnknownReceiverError as error:
            raise ProblemError(422, "no-such-receiver", str(error)) from error
        except NotEstimatedError as error:
            raise ProblemError(422, "not-estimated", str(error)) from error
        return self._newest(twin_id)

    def _newest(self, twin_id: str) -> dict[str, Any]:
        newest: dict[str, Any] = self.listed(twin_id)["changes"][0]
        return newest

    def _undoable(self, twin_id: str, number: int) -> dict[str, Any]:
        """Return the change of a number, of which all former values are kept."""
        changes = self.listed(twin_id)["changes"]
        of_number = (one for one in changes if one["number"] == number)
        found: dict[str, Any] | None = next(of_number, None)
        if found is None or found["others"]:
            can = [str(one["number"]) for one in changes if not one["others"]]
            why = f"It changed {', '.join(found['others'])} too. " if found else ""
            raise ProblemError(
                409,
                "no-such-change",
                f"At body.reverses, {number} was given. {why}Changes that can be undone: "
                f"{', '.join(can[:20]) or 'none'}.",
            )
        return found


def _document(row: EventRow) -> dict[str, Any]:
    return {"number": row.number, "t_ns": row.t_ns, "event": None, "recorded_as": None}


def _correction(
    details: dict[str, Any], recorded: dict[str, AssetEvent], earlier: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the change that a correction is; it undoes the one whose values it puts back.

    Parameters
    ----------
    details
        Of the event that announces the correction.
    recorded
        All recorded events of the asset, by their id.
    earlier
        Changes before this one.
    """
    now = recorded[details["event"]]
    assert now.corrects is not None
    was = recorded.get(now.corrects.event)
    old, new = ({} if one is None else content(one) for one in (was, now))
    changes = [
        {"field": name, "before": old.get(name), "after": new[name]}
        for name in CORRECTABLE
        if old.get(name) != new[name]
    ]
    back = [{"field": c["field"], "before": c["after"], "after": c["before"]} for c in changes]
    prior = next((one for one in earlier if one["recorded_as"] == now.corrects.event), None)
    return {
        "event": now.corrects.event,
        "recorded_as": now.event,
        "person": now.person,
        "principal": now.principal,
        "text": now.corrects.text,
        "reverses": prior["number"] if prior is not None and prior["changes"] == back else None,
        "changes": changes,
        "others": [],
    }


def _validated(given: dict[str, Any]) -> Registration:
    try:
        return Registration.model_validate(given)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join(map(str, ("body", "after", *fault["loc"])))
        raise ProblemError(422, "not-valid", f"At {where}: {fault['msg']}") from error
