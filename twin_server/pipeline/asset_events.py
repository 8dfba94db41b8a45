"""Checks and records events of assets, and lists them with open questions."""

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from slowtime_schemas.asset_events import AssetEvent, Correction
from slowtime_services.clock import Clock, SystemClock
from twin_server.events.asset_events import (
    MOST_KEPT,
    QUESTION,
    AssetEventOrder,
    AssetEventRow,
    accepted,
    content,
    effective,
    is_same,
    sentence,
)
from twin_server.events.deliveries import identity
from twin_server.persist import Store
from twin_server.registration.changes import Author
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError

from .ingestion.pipeline import Pipeline

MOST_EVENTS = 10_000
"""Newest events of a twin among which questions are looked for."""

LONGEST_FIRST = 56
"""Longest id that a number is added to: ids of 64 characters and up to 10,000 events."""

AHEAD_S = 60.0
"""How far ahead of server and readings the time of an event may be: clocks differ [s]."""


class AssetEvents:
    """Interface of store and pipeline for repairs, inspections and notes, used by REST.

    Parameters
    ----------
    clock
        Dates what is accepted.
    """

    def __init__(self, pipeline: Pipeline, store: Store, clock: Clock | None = None) -> None:
        self._pipeline, self._store = pipeline, store
        self._clock = clock or SystemClock()

    def record(
        self, twin_id: str, registration: Registration, order: AssetEventOrder, principal: str
    ) -> tuple[dict[str, Any], bool]:
        """Record an event; return the stored event, and whether it is new.

        Raises
        ------
        ProblemError
            Where another event has its id, or it does not fit the twin or its time.
        """
        return self._pipeline.call(
            lambda: self._record(twin_id, registration, order, principal)
        )

    def listed(self, twin_id: str) -> dict[str, Any]:
        """Return all events of an asset, the newest first, and the questions about it."""
        rows = self._store.asset_events(twin_id)
        events = [row.message for row in rows]
        taken_back = {e.supersedes: e.event for e in events if e.supersedes is not None}
        told = [
            self._event_document(twin_id, row, event, taken_back.get(event.event))
            for row, event in zip(rows, events, strict=True)
        ]
        return {
            "id": twin_id,
            "events": told[::-1],
            "questions": self._questions(twin_id, told, effective(events)),
        }

    def _record(
        self, twin_id: str, registration: Registration, order: AssetEventOrder, principal: str
    ) -> tuple[dict[str, Any], bool]:
        rows = self._store.asset_events(twin_id)
        before = next((row for row in rows if row.event == order.event), None)
        if before is not None:
            if not is_same(order, before.message):
                raise ProblemError(
                    409,
                    "another-event",
                    f"An event with the id {order.event} is already recorded with other "
                    f"content: {sentence(before.message)} Give another id. To correct the "
                    f"recorded event, POST /api/v1/twins/{twin_id}/changes.",
                )
            told = self._event_document(
                twin_id, before, before.message, _undone(rows, order.event)
            )
            return told, False
        self._check(twin_id, registration, order, rows)
        return self._keep(twin_id, rows, order, principal), True

    def correct(
        self,
        twin_id: str,
        registration: Registration,
        name: str,
        after: Mapping[str, Any],
        author: Author,
    ) -> dict[str, Any]:
        """Record an event instead of another one, which is taken back; return the new one.

        Parameters
        ----------
        name
            Event that is corrected.
        after
            New value of each field that is changed, as `AssetEventOrder` has it.

        Raises
        ------
        ProblemError
            Where that event does not hold, nothing would change, or the values do not fit.
        """
        return self._pipeline.call(
            lambda: self._correct(twin_id, registration, name, after, author)
        )

    def _correct(
        self,
        twin_id: str,
        registration: Registration,
        name: str,
        after: Mapping[str, Any],
        author: Author,
    ) -> dict[str, Any]:
        rows = self._store.asset_events(twin_id)
        was = _holding(name, rows, "body.event")
        given = content(was) | dict(after)
        for one, other in (("at", "slow_time"), ("slow_time", "at")):
            if after.get(one) is not None and other not in after:
                given[other] = None  # one time replaces the other
        try:
            order = AssetEventOrder.model_validate(
                given | {"event": _successor(name, rows), "person": author.person}
            )
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            where = ".".join(map(str, ("body", "after", *fault["loc"])))
            raise ProblemError(422, "not-valid", f"At {where}: {fault['msg']}") from error
        self._check(twin_id, registration, order, rows, "body.after")
        told = order.model_copy(update={"person": None})
        times = (order.at_ns, order.slow_time), (was.happened_ns, was.slow_time)
        if is_same(told, was) and times[0] == times[1]:
            raise ProblemError(
                409, "nothing-changed", f"{name} says this already. Give other values."
            )
        correction = Correction(event=name, text=author.text)
        return self._keep(twin_id, rows, order, author.principal, correction)

    def _keep(
        self,
        twin_id: str,
        rows: Sequence[AssetEventRow],
        order: AssetEventOrder,
        principal: str,
        corrects: Correction | None = None,
    ) -> dict[str, Any]:
        latest = self._store.history(twin_id, limit=1, newest=True).states
        now_ns = self._clock.now_ns()
        number = 1 + max((row.number for row in rows), default=0)
        last_ns = int(latest["t_ns"][0]) if len(latest) else None
        event = accepted(order, twin_id, number, now_ns, principal, last_ns, corrects)
        row = self._pipeline.record(event)
        return self._event_document(twin_id, row, event, None)

    def _check(
        self,
        twin_id: str,
        registration: Registration,
        order: AssetEventOrder,
        rows: Sequence[AssetEventRow],
        where: str = "body",
    ) -> None:
        """Refuse an event that does not fit the twin, its history, or earlier events."""
        if len(rows) >= MOST_KEPT:
            raise ProblemError(
                409,
                "too-many-events",
                f"{twin_id} has {len(rows):,} recorded events. Allowed: {MOST_KEPT:,}. "
                "Register a new twin for further events.",
            )
        names = quantities_of(registration)
        if order.quantity is not None and order.quantity not in names:
            raise ProblemError(
                422,
                "not-valid",
                f"At {where}.quantity, {order.quantity:.80} was given. Allowed for {twin_id}: "
                f"{', '.join(names)}; or leave it out for all of the asset.",
            )
        if order.measured is not None and order.quantity is None and len(names) > 1:
            raise ProblemError(
                422,
                "not-valid",
                f"At {where}.quantity, nothing was given with a measured value. Name the "
                f"quantity: {', '.join(names)}.",
            )
        self._check_time(twin_id, order, where)
        if order.reverses is not None:
            _holding(order.reverses, rows, "body.reverses")

    def _check_time(self, twin_id: str, order: AssetEventOrder, where: str) -> None:
        states = self._store.history(twin_id, limit=1, newest=True).states
        if order.at_ns is not None:
            last_ns = int(states["t_ns"][0]) if len(states) else 0
            most_ns = max(last_ns, self._clock.now_ns()) + round(AHEAD_S * 1e9)
            if order.at_ns > most_ns:
                raise ProblemError(
                    422,
                    "not-yet",
                    f"At {where}.at, {order.at} was given, which is in the future. Record an "
                    "event once it has happened.",
                )
        if order.slow_time is not None and len(states):
            last = float(states["slow_time"][0])
            if order.slow_time > last:
                raise ProblemError(
                    422,
                    "not-yet",
                    f"At {where}.slow_time, {order.slow_time:.9g} was given. Allowed: up to "
                    f"{last:.9g}, that of the latest reading. Give `at` for a later "
                    "event, or leave both out.",
                )

    def _event_document(
        self, twin_id: str, row: AssetEventRow, event: AssetEvent, undone_by: str | None
    ) -> dict[str, Any]:
        """Return an event as REST does, with both times where the history has them."""
        content = event.model_dump(mode="json")
        for name in ("version", "site", "asset", "boot", "sequence", "t_ns", "happened_ns"):
            content.pop(name)
        if event.slow_time is None:
            found = self._store.history(
                twin_id, t_ns=(None, event.happened_ns), limit=1, newest=True
            ).states
            content["t_ns"] = event.happened_ns
            content["slow_time"] = float(found["slow_time"][0]) if len(found) else None
        else:
            found = self._store.history(
                twin_id, slow_time=(None, event.slow_time), limit=1, newest=True
            ).states
            content["t_ns"] = int(found["t_ns"][0]) if len(found) else None
        return {
            "number": row.number,
            "accepted_ns": row.t_ns,
            "sentence": sentence(event),
            "reversed_by": undone_by,
            **content,
        }

    def _questions(
        self, twin_id: str, told: Sequence[dict[str, Any]], holding: Sequence[AssetEvent]
    ) -> list[dict[str, Any]]:
        """Return questions, the newest first, with the events that answer them."""
        holds = {event.event for event in holding}
        answers = [one for one in told if one["event"] in holds]
        found = []
        rows = self._store.events(twin_id, limit=MOST_EVENTS, newest=True)
        for row in reversed(rows):
            if QUESTION not in row.body:
                continue
            body = json.loads(row.body)
            if body["kind"] != QUESTION:
                continue
            event_id, details = identity(body), body["details"]
            answer = next((o for o in answers if answers_to(o, event_id, details)), None)
            found.append(
                {
                    "event_id": event_id,
                    "number": row.number,
                    "t_ns": row.t_ns,
                    "message": body["message"],
                    "quantity": details["quantity"],
                    "since": details["since"],
                    "size": details["size"],
                    "sd": details["sd"],
                    "answered_by": None if answer is None else answer["event"],
                }
            )
        return found


def answers_to(one: dict[str, Any], event_id: str, details: dict[str, Any]) -> bool:
    """Whether an event answers a question: explicitly, or as a repair at that time."""
    if one["answers"] == event_id:
        return True
    if one["kind"] not in ("repair", "replacement") or one["slow_time"] is None:
        return False
    concerned = one["quantity"] in (None, details["quantity"])
    return bool(concerned and details["earliest"] <= one["slow_time"] <= details["noticed"])


def quantities_of(registration: Registration) -> tuple[str, ...]:
    """Name the estimated quantities of a twin, which may be repaired."""
    if registration.changes == "elements":
        return tuple(registration.structure().free)
    if registration.changes == "both":
        return ("stiffness_change", "mass_change")
    return (f"{registration.changes}_change",)


def _undone(rows: Sequence[AssetEventRow], name: str) -> str | None:
    every = (row.message for row in rows)
    return next((event.event for event in every if event.supersedes == name), None)


def _holding(name: str, rows: Sequence[AssetEventRow], where: str) -> AssetEvent:
    """Return an event that holds and may be undone or corrected."""
    found = next((row.message for row in rows if row.event == name), None)
    if found is None or found.reverses is not None:
        there = ", ".join(event.event for event in effective(row.message for row in rows))
        raise ProblemError(
            409,
            "no-such-event",
            f"At {where}, {name} was given. Events that can be undone or corrected: "
            f"{there[:500] or 'none'}. A note that undoes an event cannot be undone "
            "itself: record the event again, under another id.",
        )
    by = next((row.message for row in rows if row.message.supersedes == name), None)
    if by is None:
        return found
    if by.corrects is not None:
        raise ProblemError(
            409,
            "corrected-already",
            f"{name} was corrected by {by.person} as {by.event} already. Undo or correct that.",
        )
    raise ProblemError(
        409, "reversed-already", f"{name} was taken back by {by.event} already. That stays."
    )


def _successor(name: str, rows: Sequence[AssetEventRow]) -> str:
    """Make the id of a correction: that of the first event of the chain, and a number."""
    corrects = {event.event: event.corrects for event in (row.message for row in rows)}
    while (correction := corrects.get(name)) is not None:
        name = correction.event
    if len(name) > LONGEST_FIRST:
        name = hashlib.sha256(name.encode()).hexdigest()[:32]
    numbered = (f"{name}.{count}" for count in itertools.count(2))
    return next(each for each in numbered if each not in corrects)
