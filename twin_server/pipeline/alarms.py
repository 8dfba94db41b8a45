"""Alarms of all twins: raised ones, acknowledgements, and deliveries."""

import json
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from slowtime_services.clock import Clock, SystemClock
from twin_server.estimate import Twin, normal_of
from twin_server.events.deliveries import (
    ACKNOWLEDGED,
    ALARM,
    GIVEN_UP,
    LASTING,
    OPEN,
    TEST,
    AlarmAcknowledgement,
    Delivery,
    DeliveryTally,
    alarm_key,
    identity,
)
from twin_server.events.receivers import AlarmRoute
from twin_server.persist import EventRow, Store
from twin_server.serve import ProblemError

from .ingestion.estimation import note_event
from .ingestion.pipeline import Pipeline
from .ingestion.routing import new_delivery
from .ingestion.rows import address
from .ingestion.updates import TwinUpdate

MOST_EVENTS = 10_000
"""Newest events of a twin among which an alarm is looked for."""


class Alarms:
    """Interface of store and pipeline for alarms, used by notifier and REST.

    Parameters
    ----------
    clock
        Dates what people do.
    """

    def __init__(self, pipeline: Pipeline, store: Store, clock: Clock | None = None) -> None:
        self._pipeline, self._store = pipeline, store
        self._clock = clock or SystemClock()
        self._settings = pipeline.settings.alarms
        self._acknowledging = threading.Lock()

    def due(self, receiver: str, now_ns: int, limit: int) -> Sequence[Delivery]:
        """Deliveries that wait and are due, the earliest first."""
        return self._store.deliveries(
            receiver=receiver, states=("waiting",), due_ns=now_ns, limit=limit
        )

    def late(self, limit: int) -> Sequence[Delivery]:
        """Deliveries of readings that were old on arrival, those that came last."""
        return self._store.deliveries(states=("late",), limit=limit)

    def waiting(self, limit: int) -> Sequence[Delivery]:
        """Deliveries that wait for their time, those that were begun last."""
        return self._store.deliveries(states=("waiting",), limit=limit)

    def unsendable(self, receivers: Sequence[str], before_ns: int) -> Sequence[Delivery]:
        """Deliveries to none of these receivers, that have waited since then."""
        named = {
            tally.receiver
            for tally in self._store.tallies()
            if tally.state in OPEN
            and tally.receiver not in receivers
            and tally.oldest_ns < before_ns
        }
        rows = [
            row
            for name in sorted(named)
            for row in self._store.deliveries(receiver=name, states=OPEN)
        ]
        return [row for row in rows if row.created_ns < before_ns]

    def settle(self, settled: Sequence[Delivery], begun: Sequence[Delivery] = ()) -> None:
        """Store outcomes of deliveries, and begin others."""
        self._store.settle(settled, begun)

    def give_up(self, delivery: Delivery) -> None:
        """Store that a delivery has failed for good, with an event that reports it."""
        if delivery.kind == GIVEN_UP or self._pipeline.twin(delivery.twin) is None:
            self._store.settle([delivery])
            return
        hours = (delivery.ended_ns - delivery.created_ns) / 3.6e12
        message = (
            f"{delivery.receiver} could not be notified of an event ({delivery.kind}) in "
            f"{hours:.3g} h and {delivery.tries} attempts; no more attempts are made. The "
            f"last attempt: {delivery.error} Inform them by other means, and check the "
            "receiver's settings."
        )
        details = {
            "receiver": delivery.receiver,
            "event_id": delivery.event,
            "kind": delivery.kind,
            "tries": delivery.tries,
            "error": delivery.error,
        }
        event = self._event(delivery.twin, GIVEN_UP, "warning", message, details)
        self._pipeline.keep(event, self._routed(event), settled=[delivery])

    def holds(self, delivery: Delivery) -> bool:
        """Whether the alarm is still raised and not acknowledged."""
        body = json.loads(delivery.body)
        if not holds(self._pipeline.twin(delivery.twin), body["kind"], body["details"]):
            return False
        return delivery.event not in self._store.acknowledgements(delivery.twin)

    def is_fresh(self, delivery: Delivery) -> bool:
        """Whether the newest reading of its twin is live and not old."""
        routing = self._pipeline.routing
        return routing.is_fresh(address(delivery.twin), self._clock.now_ns())

    def forget(self, before_ns: int) -> None:
        """Delete deliveries that ended before an instant."""
        self._store.forget_deliveries(before_ns)

    def alarms(self, twin_id: str, limit: int) -> list[dict[str, Any]]:
        """Return the newest alarms of a twin: whether raised, and acknowledgements."""
        twin = self._pipeline.twin(twin_id)
        seen = self._store.acknowledgements(twin_id)
        told = []
        lasting: set[tuple[Any, ...]] = set()
        for row, body in self._events(twin_id):
            if body["severity"] != "alarm":
                continue
            about = (
                body["kind"],
                *alarm_key(body["details"]),
                body["details"].get("mode"),
            )
            # Of several that were raised for the same limit, only the newest can hold still.
            raised = about not in lasting and holds(twin, body["kind"], body["details"])
            lasting.add(about)
            event_id = identity(body)
            kept = ("kind", "severity", "t_ns", "slow_time", "message")
            told.append(
                {
                    "event_id": event_id,
                    "number": row.number,
                    **{name: body.get(name) for name in kept},
                    "raised": raised,
                    "acknowledged": _acknowledgement_document(seen.get(event_id)),
                }
            )
            if len(told) == limit:
                break
        return told

    def acknowledge(
        self, twin_id: str, event_id: str, by: str, principal: str, note: str
    ) -> dict[str, Any]:
        """Store an acknowledgement of an alarm, with an event."""
        with self._acknowledging:
            return self._acknowledge(twin_id, event_id, by, principal, note)

    def _acknowledge(
        self, twin_id: str, event_id: str, by: str, principal: str, note: str
    ) -> dict[str, Any]:
        before = self._store.acknowledgements(twin_id).get(event_id)
        if before is not None:
            raise ProblemError(
                409,
                "acknowledged-already",
                f"The alarm {event_id} was already acknowledged by {before.by}. The first "
                "acknowledgement is kept.",
            )
        found = next(
            (
                body
                for _, body in self._events(twin_id)
                if body["severity"] == "alarm" and identity(body) == event_id
            ),
            None,
        )
        if found is None:
            raise ProblemError(
                404,
                "no-such-alarm",
                f"{event_id} is none of the alarms among the {MOST_EVENTS:,} newest events of "
                f"{twin_id}. GET /api/v1/twins/{twin_id}/alarms lists them.",
            )
        now_ns = self._clock.now_ns()
        made = AlarmAcknowledgement(event_id, twin_id, now_ns, by, principal, note)
        said = f": {note}" if note else "."
        message = f"Acknowledged by {by}{said} The alarm: {found['message']}"
        details = {"event_id": event_id, "by": by, "token": principal, "note": note}
        event = self._event(twin_id, ACKNOWLEDGED, "info", message, details)
        self._pipeline.keep(event, self._routed(event), acknowledgements=[made])
        told = _acknowledgement_document(made)
        assert told is not None
        return {"event_id": event_id, **told}

    def test(self, twin_id: str, receiver: str | None, by: str) -> dict[str, Any]:
        """Send a test event to all receivers of a twin, or to one of them."""
        routes = [
            route
            for route in self._routes(twin_id)
            if receiver is None or route.receiver == receiver
        ]
        if not routes:
            there = ", ".join(route.receiver for route in self._routes(twin_id)) or "none"
            raise ProblemError(
                409,
                "no-such-route",
                f"A test of {receiver or 'all receivers'} was asked for. {twin_id} is routed "
                f"to: {there}. Add a route to its registration's alarm_routes.",
            )
        names = [route.receiver for route in routes]
        message = (
            f"This is a test alarm to {', '.join(names)}, requested by {by}. "
            "No limit was passed."
        )
        details = {"receivers": names, "by": by}
        event = self._event(twin_id, TEST, "info", message, details)
        now_ns, body = self._clock.now_ns(), json.loads(event.body)
        rows = [new_delivery(route, body, "waiting", now_ns) for route in routes]
        self._pipeline.keep(event, rows)
        return {"event_id": identity(body), "receivers": names}

    def deliveries(self, twin_id: str, limit: int) -> dict[str, Any]:
        """Return the state of a twin's routes, and its newest deliveries."""
        twin = self._pipeline.twin(twin_id)
        allowed = self._settings.of_site(address(twin_id)[0])
        rows = self._store.deliveries(twin=twin_id, limit=limit)
        counts = {
            (tally.receiver, tally.state): tally.number
            for tally in self._store.tallies()
            if tally.twin == twin_id
        }
        routes = []
        for route in () if twin is None else twin.registration.alarm_routes:
            name = route.receiver
            tries = [r for r in rows if r.receiver == name and r.tries]
            last = max(tries, key=lambda row: row.ended_ns or row.due_ns, default=None)
            there = name in allowed
            routes.append(
                {
                    "receiver": name,
                    "kind": allowed[name].kind if there else None,
                    "waiting": sum(counts.get((name, state), 0) for state in OPEN),
                    "delivered": counts.get((name, "delivered"), 0),
                    "failed": counts.get((name, "failed"), 0),
                    "last_error": _trouble(there, name, last),
                }
            )
        return {"id": twin_id, "routes": routes, "deliveries": [_row(row) for row in rows]}

    def tallies(self) -> list[DeliveryTally]:
        """Count deliveries by twin, receiver and state."""
        return self._store.tallies()

    def _routes(self, twin_id: str) -> list[AlarmRoute]:
        twin = self._pipeline.twin(twin_id)
        site = address(twin_id)[0]
        return [] if twin is None else self._pipeline.routing.routes(site, twin.registration)

    def _routed(self, event: EventRow) -> list[Delivery]:
        twin = self._pipeline.twin(f"{event.site}.{event.asset}")
        twins = {} if twin is None else {(event.site, event.asset): twin}
        return self._pipeline.routing.deliveries([event], twins, self._clock.now_ns())

    def _event(
        self,
        twin_id: str,
        kind: str,
        severity: Literal["info", "warning", "alarm"],
        message: str,
        details: Mapping[str, Any],
    ) -> EventRow:
        now_ns = self._clock.now_ns()
        return note_event(*address(twin_id), kind, severity, message, details, now_ns)

    def _events(self, twin_id: str) -> list[tuple[EventRow, dict[str, Any]]]:
        """Read the newest events, the last first."""
        rows = self._store.events(twin_id, limit=MOST_EVENTS, newest=True)
        return [(row, json.loads(row.body)) for row in reversed(rows)]


class NotifierTrigger:
    """Wakes the notifier when an event has become durable."""

    def __init__(self, wake: Any) -> None:
        self._wake = wake

    def tell(self, news: TwinUpdate) -> None:
        """Take the update of one twin."""
        if news.events:
            self._wake()

    def reset(self, twin_id: str) -> None:
        """Do nothing: receivers are not notified of a rewritten history."""


def raised_of(twin: Twin | None) -> list[dict[str, Any]]:
    """Return the alarms of a twin that are raised now: quantity, side and limit of each."""
    if twin is None or not twin.registration.alarms:
        return []
    watched = zip(twin.registration.watched(), twin.checkpoint.raised, strict=True)
    return [
        {"quantity": name, "side": alarm.limit[0], "limit": alarm.limit[1]}
        for (name, alarm), belief in watched
        if belief.holds
    ]


def holds(twin: Twin | None, kind: str, details: Mapping[str, Any]) -> bool:
    """Whether the alarm of an event is still raised."""
    if twin is None or kind not in LASTING:
        return False
    if kind == ALARM:
        return alarm_key(details) in map(alarm_key, raised_of(twin))
    normal = normal_of(twin.checkpoint.conditions(), twin.registration)
    return any(
        one["entered"] is not None
        and details.get("mode") == (None if (m := one["model_mode"]) is None else m + 1)
        for one in normal
    )


def _acknowledgement_document(made: AlarmAcknowledgement | None) -> dict[str, Any] | None:
    if made is None:
        return None
    return {"by": made.by, "token": made.principal, "note": made.note, "t_ns": made.t_ns}


def _trouble(there: bool, name: str, last: Delivery | None) -> str | None:
    """Return why deliveries to a receiver fail; None where the last one succeeded."""
    if not there:
        return (
            f"No receiver is called {name}. An operator declares it in the server's settings, "
            "under alarms.receivers."
        )
    return None if last is None or not last.error else last.error


def _row(row: Delivery) -> dict[str, Any]:
    return {
        "id": row.key,
        "event_id": row.event,
        "receiver": row.receiver,
        "kind": row.kind,
        "severity": row.severity,
        "reminder": row.reminder,
        "state": row.state,
        "tries": row.tries,
        "created_ns": row.created_ns,
        "due_ns": None if row.ended_ns else row.due_ns,
        "ended_ns": row.ended_ns or None,
        "error": row.error or None,
        "message": json.loads(row.body)["message"],
    }
