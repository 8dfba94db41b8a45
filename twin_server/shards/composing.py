"""Composites and graphs of a fleet, composed of the answers of its shards.

Shard 0 keeps the registrations of all composites, so that one lock guards against cycles. The
shard of a twin computes what a composite needs to know of it, and the front does the rest with
the arithmetic of a single server.
"""

import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from twin_server.composites.composite import Composite
from twin_server.composites.visibility import seen
from twin_server.identity.principals import Principal
from twin_server.registration.twin import Registration
from twin_server.serve.composite_service import CompositeService
from twin_server.serve.composites import (
    Failure,
    FailureQuestion,
    Rates,
    TwinFacts,
)
from twin_server.serve.exports import Asset
from twin_server.serve.shard_interface import (
    AssetsAsked,
    CompositeOrder,
    DeletedTwin,
    Deletion,
    EventsAsked,
    FailuresAsked,
    RevisionsAsked,
    TwinsAsked,
)

from .calls import Calls, owner

KEEPER = 0
"""Shard that keeps the registrations of composites."""


class ShardFacts(TwinFacts):
    """Facts about twins, each from the shard that has it."""

    def __init__(self, calls: Calls) -> None:
        self._calls = calls

    def health(self, twins: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Find out whether twins are alive and valid, and their alarms."""
        return self._of_each("/shard/health", twins)

    def failures(self, asked: Mapping[str, FailureQuestion]) -> dict[str, Failure]:
        """Compute the failure probability of each twin asked about."""
        bodies = {
            index: FailuresAsked.model_validate(
                {"asked": {name: asked[name]._asdict() for name in names}}
            )
            for index, names in self._divided(list(asked)).items()
        }
        answers = self._calls.ask_each("/shard/failures", bodies)
        told = {name: one for answer in answers.values() for name, one in answer.items()}
        return {
            name: Failure(value, lo, hi, tuple(reasons), *rest)
            for name in asked
            for value, lo, hi, reasons, *rest in [told[name]]
        }

    def rates(self, twins: Sequence[str]) -> dict[str, Rates]:
        """Compute the drift rates of twins."""
        return {
            name: Rates({quantity: tuple(rate) for quantity, rate in of.items()}, unit)
            for name, (of, unit) in self._of_each("/shard/rates", twins).items()
        }

    def _of_each(self, path: str, twins: Sequence[str]) -> dict[str, Any]:
        bodies = {
            index: TwinsAsked(twins=names) for index, names in self._divided(twins).items()
        }
        answers = self._calls.ask_each(path, bodies)
        told = {name: one for answer in answers.values() for name, one in answer.items()}
        return {name: told[name] for name in twins}

    def _divided(self, twins: Sequence[str]) -> dict[int, list[str]]:
        return divided(twins, self._calls.count)


class ShardComposites(CompositeService):
    """Registrations of composites, which one shard keeps for all."""

    def __init__(self, calls: Calls) -> None:
        self._calls = calls
        self._lock = threading.Lock()
        self._version, self._known = "", dict[str, Composite]()

    def all(self, principal: Principal) -> Mapping[str, Composite]:
        """All composites that a principal may see, in the order of their registration."""
        return seen(self._all(), principal)

    def exists(self, composite_id: str) -> bool:
        """Whether there is a composite of this id."""
        return composite_id in self._all()

    def _all(self) -> Mapping[str, Composite]:
        told = self._calls.ask(KEEPER, f"/shard/composites?known={self._version}")
        if "composites" not in told:
            return self._known
        known = {name: Composite.from_json(text) for name, text in told["composites"].items()}
        with self._lock:
            self._version, self._known = told["version"], known
        return known

    def register(self, composite_id: str, wanted: Composite, principal: Principal) -> bool:
        """Register a composite; True where it is new."""
        bodies = {
            index: TwinsAsked(twins=names)
            for index, names in divided(
                list(dict.fromkeys([composite_id, *wanted.members])), self._calls.count
            ).items()
        }
        answers = self._calls.ask_each("/shard/registered", bodies)
        order = CompositeOrder(
            id=composite_id,
            registration=wanted.to_json(),
            principal=principal.to_message(),
            twins=[name for names in answers.values() for name in names],
        )
        return bool(self._calls.ask(KEEPER, "/shard/composites", order))

    def delete(self, composite_id: str, principal: Principal) -> None:
        """Delete a composite that is no member of another that may be seen."""
        order = Deletion(id=composite_id, principal=principal.to_message())
        self._calls.ask(KEEPER, "/shard/composites/delete", order)

    def revisions(self, composite_id: str, principal: Principal) -> list[dict[str, Any]]:
        """Registrations of a composite of which the principal may see what they held."""
        asked = RevisionsAsked(id=composite_id, principal=principal.to_message())
        found: list[dict[str, Any]]
        found = self._calls.ask(KEEPER, "/shard/composites/revisions", asked)
        return found

    def events(
        self, composite_id: str, *, after: int, limit: int, newest: bool
    ) -> list[tuple[int, str]]:
        """Find number and body of events of a composite in order."""
        asked = EventsAsked(id=composite_id, after=after, limit=limit, newest=newest)
        found = self._calls.ask(KEEPER, "/shard/composites/events", asked)
        return [(number, body) for number, body in found]

    def note_deleted_twin(self, twin_id: str) -> None:
        """Tell the sites of the composites that held a twin that it was deleted."""
        self._calls.ask(KEEPER, "/shard/composites/deleted_twin", DeletedTwin(id=twin_id))


class ShardAssets:
    """Twins of the graph of a fleet, from all shards."""

    def __init__(self, calls: Calls) -> None:
        self._calls = calls

    def of_sites(self, site: str | None, principal: Principal) -> list[Asset]:
        """Return the twins of a site, or of all, of those that a caller may see, by id."""
        asked = AssetsAsked(site=site)
        answers = self._calls.ask_each(
            "/shard/assets", dict.fromkeys(range(self._calls.count), asked)
        )
        found = [
            one for told in answers.values() for one in _assets(told) if principal.sees(one.id)
        ]
        return sorted(found, key=lambda one: one.id)

    def of_twin(self, twin_id: str) -> Iterator[Asset]:
        """Return one twin."""
        index = owner(twin_id, self._calls.count)
        return _assets(self._calls.ask(index, "/shard/assets", AssetsAsked(twin=twin_id)))


def divided(twins: Sequence[str], count: int) -> dict[int, list[str]]:
    """Divide twins by the shards that have them.

    Examples
    --------
    >>> divided(["lab.a", "lab.b", "lab.c", "lab.d"], 2)
    {0: ['lab.a', 'lab.b'], 1: ['lab.c', 'lab.d']}
    """
    found: dict[int, list[str]] = {}
    for twin_id in twins:
        found.setdefault(owner(twin_id, count), []).append(twin_id)
    return found


def _assets(told: Sequence[Any]) -> Iterator[Asset]:
    for twin_id, registration, state in told:
        yield Asset(twin_id, Registration.from_json(registration), state)
