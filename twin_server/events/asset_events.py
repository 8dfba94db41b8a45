"""Events of assets: as ordered, as kept, and as a sentence."""

from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple, Self

from pydantic import ConfigDict, Field, ValidationError, model_validator

from slowtime_schemas.asset_events import (
    AssetEvent,
    Correction,
    EventContent,
    EventName,
    PersonName,
)
from slowtime_schemas.quantities import Finite
from twin_server.orders import Moment, moment_ns

TOLD = "asset_event"
"""Kind of the event that says what somebody has told of the asset."""

QUESTION = "repair_suspected"
"""Kind of the event that asks whether something was repaired, as nobody has told of it."""

MOST_KEPT = 10_000
"""Events of one asset that are kept."""

NO_BOOT = "twin"
"""Stands for an edge's boot in what the twin says of its own accord."""

_WORDS = {
    "repair": "Repair",
    "replacement": "Replacement",
    "inspection": "Inspection",
    "load_test": "Load test",
    "note": "Note",
}
_CONTENT = tuple(EventContent.model_fields)

EXAMPLES: list[Any] = [
    {
        "event": "work-order-118",
        "kind": "repair",
        "at": "2026-11-21T09:30:00Z",
        "repair": {"restored_share": 0.8, "restored_share_sd": 0.1},
        "text": "Bolts of the base replaced and tightened.",
        "person": "Ann Moreau",
    },
    {
        "event": "scan-7",
        "kind": "inspection",
        "at": "2026-11-22T10:00:00Z",
        "quantity": "stiffness_change",
        "detection": {
            "detected": False,
            "probability_of_detection": {"a50": 0.1, "slope": 2.0},
        },
        "conditions": {"temperature_c": 11.5},
    },
    {"event": "undo-118", "kind": "note", "reverses": "work-order-118"},
]


class AssetEventOrder(EventContent):
    """A report of something that happened to an asset: what, when, and by whom."""

    model_config = ConfigDict(json_schema_extra={"examples": EXAMPLES})

    event: EventName
    at: Annotated[
        Moment | None,
        Field(
            description="RFC 3339, or nanoseconds since 1970-01-01 UTC, of the sensor's clock; "
            "with slow_time left out too, just after the latest reading."
        ),
    ] = None
    slow_time: Annotated[Finite | None, Field(description="Instead of `at`.")] = None
    person: Annotated[
        PersonName | None,
        Field(description="Who reports it; by default the name of the token."),
    ] = None

    @model_validator(mode="after")
    def _has_one_time(self) -> Self:
        if self.at is not None and self.slow_time is not None:
            raise ValueError("at and slow_time were given. Give one of them.")
        if self.at_ns is not None and self.at_ns < 0:
            raise ValueError(f"{self.at} is before 1970. Give the time of the sensor's clock.")
        return self

    @property
    def at_ns(self) -> int | None:
        """When it happened by the sensor's clock [ns since 1970-01-01 UTC]."""
        return moment_ns(self.at)


class AssetEventRow(NamedTuple):
    """An event of an asset as it is kept.

    Parameters
    ----------
    number
        Counts the events of a twin, from 1.
    t_ns
        When it was accepted, by the server's clock [ns since 1970-01-01 UTC].
    principal
        Whose token it was.
    body
        The message as it travels on the bus, JSON.
    """

    twin: str
    event: str
    number: int
    t_ns: int
    principal: str
    body: str

    @property
    def message(self) -> AssetEvent:
        """The event as a message."""
        return AssetEvent.model_validate_json(self.body)


def is_same(order: AssetEventOrder, kept: AssetEvent) -> bool:
    """Whether an order repeats a stored event, as far as it states values."""
    return (
        all(getattr(order, name) == getattr(kept, name) for name in _CONTENT)
        and (order.at_ns is None or order.at_ns == kept.happened_ns)
        and (order.slow_time is None or order.slow_time == kept.slow_time)
        and (order.person is None or order.person == kept.person)
    )


def accepted(
    order: AssetEventOrder,
    twin_id: str,
    number: int,
    now_ns: int,
    principal: str,
    latest_ns: int | None,
    corrects: Correction | None = None,
) -> AssetEvent:
    """Make the message of an order that is accepted.

    Parameters
    ----------
    latest_ns
        Sensor time of the latest reading, for an event without a time [ns]; None of a twin
        without readings.
    """
    site, _, asset = twin_id.partition(".")
    happened_ns = order.at_ns
    if happened_ns is None and order.slow_time is None:
        happened_ns = now_ns if latest_ns is None else latest_ns
    return AssetEvent(
        site=site,
        asset=asset,
        boot=NO_BOOT,
        sequence=number,
        t_ns=now_ns,
        event=order.event,
        happened_ns=happened_ns,
        slow_time=order.slow_time,
        person=order.person or principal,
        principal=principal,
        corrects=corrects,
        **{name: getattr(order, name) for name in _CONTENT},
    )


def content(event: AssetEvent) -> dict[str, Any]:
    """Return what an event tells as `AssetEventOrder` takes it, but for id and person."""
    told = event.model_dump(mode="json", include={*_CONTENT} - {"reverses"})
    return told | {"at": event.happened_ns, "slow_time": event.slow_time}


def effective(events: Iterable[AssetEvent]) -> list[AssetEvent]:
    """Return the events that hold: neither withdrawn nor corrected nor withdrawals.

    Parameters
    ----------
    events
        All events of an asset, in the order of acceptance.

    Returns
    -------
    The events in that order. A correction stands at the place of what it corrects, since the
    order of two events after one reading matters: a repair, and an inspection of its result.
    """
    every = list(events)
    gone = {event.supersedes for event in every}
    place: dict[str, int] = {}
    for count, event in enumerate(every):
        corrects = event.corrects
        place[event.event] = count if corrects is None else place.get(corrects.event, count)
    holding = [e for e in every if e.reverses is None and e.event not in gone]
    return sorted(holding, key=lambda event: place[event.event])


def sentence(event: AssetEvent) -> str:
    """Describe an event and its reporter."""
    if event.reverses is not None:
        return f"{event.person} took back the event {event.reverses}.{_text(event)}"
    of = f" of {event.quantity}" if event.quantity is not None else ""
    found = f"{event.person}{_finding_text(event)}"
    said = f"{_WORDS[event.kind]}{of} recorded by {found}.{_text(event)}"
    if event.corrects is None:
        return said
    why = f": {event.corrects.text}" if event.corrects.text else "."
    return f"{said} Corrects the event {event.corrects.event}{why}"


def _text(event: AssetEvent) -> str:
    return f" {event.text}" if event.text else ""


def _finding_text(event: AssetEvent) -> str:
    if event.kind == "repair":
        share = None if event.repair is None else event.repair.restored_share
        if share is None:
            return ": restored share unknown"
        sd = 0.0 if event.repair is None else event.repair.restored_share_sd
        if share == 1.0 and sd == 0.0:
            return ": perfect, all damage restored"
        return f": {100 * share:.3g} % ± {100 * sd:.2g} % of the damage restored"
    if event.kind == "replacement":
        part = event.replacement
        if part is not None and part.change is None:
            return ": stiffness of the new part unknown until readings follow"
        at = 0.0 if part is None or part.change is None else part.change
        return f": new part at {100 * at:+.3g} % of the nominal model"
    if event.measured is not None:
        return f": {100 * event.measured.value:+.3g} % ± {100 * event.measured.sd:.2g} %"
    if event.detection is not None:
        return ": damage found" if event.detection.detected else ": no damage found"
    return ""


def orders_in(content: object) -> list[AssetEventOrder]:
    """Read orders from JSON content: a list of them, or one.

    Raises
    ------
    ValueError
        Naming the first that cannot be read.
    """
    given = content if isinstance(content, list) else [content]
    found = []
    for place, one in enumerate(given):
        try:
            found.append(AssetEventOrder.model_validate(one))
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            where = ".".join(map(str, fault["loc"])) or "event"
            raise ValueError(
                f"Event {place + 1}, at {where}: {fault['msg']}. Give what POST "
                "/api/v1/twins/{id}/events takes, such as "
                '[{"event": "r1", "kind": "repair", "slow_time": 120.0, "person": "Ann"}].'
            ) from error
    return found
