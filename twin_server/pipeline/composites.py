"""Registers composites, and keeps the latest registration of each in memory."""

import json
import threading
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from slowtime_services.clock import Clock, SystemClock
from twin_server.composites.composite import Composite
from twin_server.composites.hierarchy import WrongCompositeError, check, memberships
from twin_server.persist import CompositeRow, Store
from twin_server.serve import ProblemError

from .ingestion.pipeline import Pipeline

MOST = 4096
"""Composites of one server."""


class CompositeRegistry:
    """All composites of a server.

    Parameters
    ----------
    clock
        Dates what people register.
    """

    def __init__(self, pipeline: Pipeline, store: Store, clock: Clock | None = None) -> None:
        self._pipeline, self._store = pipeline, store
        self._clock = clock or SystemClock()
        self._lock = threading.Lock()
        self._known: Mapping[str, Composite] = MappingProxyType(_latest(store.composites()))

    def all(self) -> Mapping[str, Composite]:
        """All composites, in the order of their registration; does not change any more."""
        return self._known

    def register(
        self,
        composite_id: str,
        wanted: Composite,
        principal: str,
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
            if composite_id not in self._known and len(self._known) >= MOST:
                raise ProblemError(
                    409, "too-many-composites", f"There are {MOST} composites. Delete some."
                )
            try:
                check(composite_id, wanted, self._known, is_twin)
            except WrongCompositeError as error:
                raise ProblemError(422, "wrong-composite", str(error)) from error
            new = composite_id not in self._known
            if new or self._known[composite_id] != wanted:
                self._keep(composite_id, principal, wanted.to_json())
                self._known = MappingProxyType({**self._known, composite_id: wanted})
            return new

    def delete(self, composite_id: str, principal: str) -> None:
        """Delete a composite that is no member of another."""
        with self._lock:
            holders = memberships(composite_id, self._known)
            if holders:
                raise ProblemError(
                    409,
                    "still-a-member",
                    f"{composite_id} is a member of {', '.join(holders)[:200]}. Register those "
                    "without it first.",
                )
            if composite_id in self._known:
                self._keep(composite_id, principal, "")
                rest = {n: one for n, one in self._known.items() if n != composite_id}
                self._known = MappingProxyType(rest)

    def revisions(self, composite_id: str) -> list[dict[str, Any]]:
        """All registrations of a composite, in order."""
        return [
            {
                "t_ns": row.t_ns,
                "principal": row.principal,
                "registration": json.loads(row.body) if row.body else None,
            }
            for row in self._store.composites(composite_id)
        ]

    def _is_twin(self, name: str) -> bool:
        return self._pipeline.twin(name) is not None

    def _keep(self, composite_id: str, principal: str, body: str) -> None:
        row = CompositeRow(0, composite_id, self._clock.now_ns(), principal, body)
        self._store.add_composites([row])


def _latest(rows: Sequence[CompositeRow]) -> dict[str, Composite]:
    """Composites in force, of all that was registered."""
    bodies: dict[str, str] = {}
    for row in rows:
        if row.body:
            bodies[row.composite] = row.body
        else:
            bodies.pop(row.composite, None)
    return {name: Composite.from_json(body) for name, body in bodies.items()}
