"""Registers composites, and keeps the latest registration of each in memory."""

import json
import threading
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from slowtime_services.clock import Clock, SystemClock
from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import WrongCompositeError, above, check, memberships
from twin_server.composites.visibility import Sites, history_of, seen, sites_of
from twin_server.identity.principals import Principal, site_of
from twin_server.persist import CompositeRow, Store
from twin_server.serve import ProblemError
from twin_server.serve.composite_service import out_of_reach

from .ingestion.estimation import note_event
from .ingestion.pipeline import Pipeline
from .ingestion.rows import address

MOST = 4096
"""Composites of one server."""

CHANGED = "member_changed"
"""Kind of the event by which a composite's site is told that a member was changed."""

Change = Literal["registered anew", "deleted"]


class _KnownComposites(NamedTuple):
    """The composites in force, and the sites of each."""

    composites: Mapping[str, Composite]
    sites: Sites


class CompositeRegistry:
    """All composites of a server; each answer tells a principal what it may know.

    Parameters
    ----------
    clock
        Dates what people register.
    """

    def __init__(self, pipeline: Pipeline, store: Store, clock: Clock | None = None) -> None:
        self._pipeline, self._store = pipeline, store
        self._clock = clock or SystemClock()
        self._lock = threading.Lock()
        self._take(_latest(store.composites()))

    def all(self, principal: Principal) -> Mapping[str, Composite]:
        """All composites that a principal may see, in the order of their registration."""
        return seen(*self._seen_by(principal))

    def exists(self, composite_id: str) -> bool:
        """Whether there is a composite of this id."""
        return composite_id in self._known.composites

    def register(
        self,
        composite_id: str,
        wanted: Composite,
        principal: Principal,
        twins: Collection[str] | None = None,
    ) -> bool:
        """Register a composite; True where it is new.

        Parameters
        ----------
        twins
            Those of the members, and of `composite_id`, that are twins, where other processes
            have twins too; None to look among the twins of this process.

        Raises
        ------
        ProblemError
            Where it cannot be; the text says what to change.
        """
        is_twin = self._is_twin if twins is None else twins.__contains__
        with self._lock:
            known = self._known.composites
            after = {**known, composite_id: wanted}
            seen_now = self.all(principal)
            _check_reach(composite_id, wanted, principal, known, seen_now)
            new = composite_id not in known
            if new and len(known) >= MOST:
                raise ProblemError(
                    409, "too-many-composites", f"There are {MOST} composites. Delete some."
                )
            try:
                check(composite_id, wanted, known, is_twin, seen_now.__contains__)
            except WrongCompositeError as error:
                raise ProblemError(422, "wrong-composite", str(error)) from error
            changed = new or known[composite_id] != wanted
            if changed:
                self._keep(composite_id, principal, wanted.to_json())
                self._take(after)
        if changed:
            self._tell_above(composite_id, "registered anew")
        return new

    def delete(self, composite_id: str, principal: Principal) -> None:
        """Delete a composite that is no member of another one that the principal may see.

        One that it may not see keeps its member as it keeps a twin that was deleted.
        """
        with self._lock:
            known = self._known.composites
            holders = memberships(composite_id, self.all(principal))
            if holders:
                raise ProblemError(
                    409,
                    "still-a-member",
                    f"{composite_id} is a member of {', '.join(holders)[:200]}. Register those "
                    "without it first.",
                )
            existed = composite_id in known
            if existed:
                self._keep(composite_id, principal, "")
                self._take({n: one for n, one in known.items() if n != composite_id})
        if existed:
            self._tell_above(composite_id, "deleted")

    def revisions(self, composite_id: str, principal: Principal) -> list[dict[str, Any]]:
        """Registrations of a composite of which the principal may see what they held."""
        rows = self._store.composites()
        registrations = [
            (row.composite, Composite.from_json(row.body) if row.body else None) for row in rows
        ]
        own = [row for row in rows if row.composite == composite_id]
        held = history_of(composite_id, registrations)
        return [
            {
                "t_ns": row.t_ns,
                "principal": row.principal,
                "registration": json.loads(row.body) if row.body else None,
            }
            for row, sites in zip(own, held, strict=True)
            if principal.covers(sites)
        ]

    def events(
        self, composite_id: str, *, after: int, limit: int, newest: bool
    ) -> list[tuple[int, str]]:
        """Find number and body of events of a composite in order."""
        rows = self._store.events(composite_id, after=after, limit=limit, newest=newest)
        return [(row.number, row.body) for row in rows]

    def note_deleted_twin(self, twin_id: str) -> None:
        """Tell the sites of the composites that held a twin that it was deleted."""
        self._tell_above(twin_id, "deleted")

    def _seen_by(
        self, principal: Principal
    ) -> tuple[Mapping[str, Composite], Principal, Sites]:
        known = self._known
        return known.composites, principal, known.sites

    def _take(self, composites: Mapping[str, Composite]) -> None:
        self._known = _KnownComposites(MappingProxyType(composites), sites_of(composites))

    def _is_twin(self, name: str) -> bool:
        return self._pipeline.twin(name) is not None

    def _keep(self, composite_id: str, principal: Principal, body: str) -> None:
        row = CompositeRow(0, composite_id, self._clock.now_ns(), principal.name, body)
        self._store.add_composites([row])

    def _tell_above(self, member: str, change: Change) -> None:
        """Add an event to each composite above a member, in words for its site alone."""
        known = self._known.composites
        for holder in above(member, known):
            self._pipeline.keep(_changed_event(holder, member, change, self._clock.now_ns()))


def _changed_event(holder: str, member: str, change: Change, now_ns: int) -> Any:
    """Make the event that a member was changed; it names one of the composite's site only.

    Whoever may see the composite's site may read it, and need not know the site of the member.
    """
    named = member if site_of(member) == site_of(holder) else None
    who = f"The member {named}" if named else "A member of another site"
    message = (
        f"{who}, at some depth within {holder}, was {change}. Health and failure probability "
        f"of {holder} follow from what there is now; its own registration is unchanged. GET "
        f"/api/v1/composites/{holder} shows it to whoever may see all its members."
    )
    details = {"member": named, "change": change}
    return note_event(*address(holder), CHANGED, "warning", message, details, now_ns)


def _check_reach(
    composite_id: str,
    wanted: Composite,
    principal: Principal,
    known: Mapping[str, Composite],
    visible: Mapping[str, Composite],
) -> None:
    """Refuse members of sites out of reach, before it is looked whether they are there."""
    parts = [composite_id, *wanted.members]
    hidden = [name for name in parts if name in known and name not in visible]
    if hidden or len(principal.seen(parts)) < len(parts):
        raise out_of_reach(composite_id)


def _latest(rows: Sequence[CompositeRow]) -> dict[str, Composite]:
    """Composites in force, of all that was registered."""
    bodies: dict[str, str] = {}
    for row in rows:
        if row.body:
            bodies[row.composite] = row.body
        else:
            bodies.pop(row.composite, None)
    return {name: Composite.from_json(body) for name, body in bodies.items()}
