"""Selects the receivers of each event, and makes deliveries that are kept with it.

Only what is live leaves: nothing of a replay, of a record or, unless the settings say so, of a
simulation. What follows from readings that were old on arrival does not either; an alarm among
them waits, and is sent if it still holds when newer readings have come.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from slowtime_schemas.answers.alarms import DeliveryState
from twin_server.collect import Ordered
from twin_server.estimate import Twin
from twin_server.events.deliveries import (
    ACKNOWLEDGED,
    GIVEN_UP,
    LASTING,
    TEST,
    Delivery,
    identity,
)
from twin_server.events.receivers import AlarmRoute, AlarmSettings
from twin_server.persist import EventRow
from twin_server.registration.twin import Registration, WrongRegistrationsError

SENSOR = ("sensor_silent", "sensor_back", "samples_lost", "source_restarted")
"""Kinds that only a live sensor causes, be it one of which no reading has come yet."""
ALWAYS = (ACKNOWLEDGED, GIVEN_UP, TEST, *SENSOR)
"""Kinds that say nothing of readings, and leave whether these are live or not."""


class UnknownReceiverError(WrongRegistrationsError):
    """A route to a receiver that an operator has not declared for the twin's site."""


class Routing:
    """Stores for each twin whether its readings are live.

    Parameters
    ----------
    listening
        Whether readings come from a bus at all.
    """

    def __init__(self, settings: AlarmSettings, *, listening: bool) -> None:
        self.settings = settings
        self._listening = listening
        self._live: dict[tuple[str, str], bool] = {}
        self._newest_ns: dict[tuple[str, str], int | None] = {}
        self._units: dict[tuple[str, str, str], str] = {}

    def hear(self, ordered: Iterable[Ordered]) -> None:
        """Note which twins sent readings, whether these are live, their times and units."""
        # Of this batch only: an event that has a slow time follows from a reading beside it.
        self._units = {}
        for one in ordered:
            boot = one.features.site, one.features.asset, one.features.boot
            self._units[boot] = one.features.slow_time_unit
            key = one.features.site, one.features.asset
            base = one.features.time_base
            simulated = base == "simulated" and self.settings.simulated
            self._live[key] = not one.replayed and (base == "live" or simulated)
            self._newest_ns[key] = None if simulated else one.features.t_ns

    def forget(self, key: tuple[str, str]) -> None:
        """Forget the readings of a twin."""
        self._live.pop(key, None)
        self._newest_ns.pop(key, None)

    def is_fresh(self, key: tuple[str, str], now_ns: int) -> bool:
        """Whether the newest reading of a twin is live, and not old."""
        newest_ns = self._newest_ns.get(key)
        return self._live.get(key, False) and not self._is_old(newest_ns, now_ns)

    def deliveries(
        self, events: Sequence[EventRow], twins: Mapping[tuple[str, str], Twin], now_ns: int
    ) -> list[Delivery]:
        """Make the deliveries of events that are about to be stored."""
        if not self.settings.receivers or not self._listening:
            return []
        found: list[Delivery] = []
        for event in events:
            key = event.site, event.asset
            twin = twins.get(key)
            if twin is None or not twin.registration.alarm_routes:
                continue
            body = json.loads(event.body)
            if body["kind"] not in ALWAYS and not self._live.get(key, False):
                continue
            state: DeliveryState = "waiting"
            if event.derived and self._is_old(self._age_of(key, event), now_ns):
                if body["kind"] not in LASTING:
                    continue
                state = "late"
            routes = self.routes(event.site, twin.registration)
            body["slow_time_unit"] = self._units.get((*key, body["boot"]))
            found += [
                new_delivery(route, body, state, now_ns)
                for route in routes
                if route.takes(body["kind"], body["severity"])
                and not _is_about(body, route.receiver)
            ]
        return found

    def routes(self, site: str, registration: Registration) -> list[AlarmRoute]:
        """Routes of a registration whose receivers exist."""
        allowed = self.settings.of_site(site)
        return [route for route in registration.alarm_routes if route.receiver in allowed]

    def check(self, twin_id: str, registration: Registration) -> None:
        """Refuse a registration that names a receiver which its twin may not use.

        Raises
        ------
        UnknownReceiverError
            Naming those that it may.
        """
        site = twin_id.partition(".")[0]
        allowed = self.settings.of_site(site)
        for route in registration.alarm_routes:
            if route.receiver not in allowed:
                raise UnknownReceiverError(
                    f"{twin_id}: a route to {route.receiver} was given. Allowed for twins of "
                    f"{site}: {', '.join(sorted(allowed)) or 'none'}. An operator declares "
                    "receivers in the server's settings, under alarms.receivers."
                )

    def _age_of(self, key: tuple[str, str], event: EventRow) -> int | None:
        """Sensor time by which the age of an event is judged; none for a simulation."""
        return None if self._newest_ns.get(key) is None else event.t_ns

    def _is_old(self, t_ns: int | None, now_ns: int) -> bool:
        return t_ns is not None and now_ns - t_ns > self.settings.max_reading_age_s * 1e9


def new_delivery(
    route: AlarmRoute, body: Mapping[str, Any], state: DeliveryState, now_ns: int
) -> Delivery:
    """Begin the delivery of an event by a route.

    Parameters
    ----------
    body
        The event as it travels on the bus, and `slow_time_unit` beside it where it is known.
    """
    event = identity(body)
    remind_s = route.remind_s if body["kind"] in LASTING and route.remind_s else 0.0
    return Delivery(
        id=f"{event}@{route.receiver}",
        twin=f"{body['site']}.{body['asset']}",
        receiver=route.receiver,
        event=event,
        kind=body["kind"],
        severity=body["severity"],
        reminder=0,
        remind_s=float(remind_s),
        state=state,
        tries=0,
        created_ns=now_ns,
        due_ns=now_ns,
        ended_ns=0,
        error="",
        body=json.dumps(body, separators=(",", ":")),
    )


def _is_about(body: Mapping[str, Any], receiver: str) -> bool:
    """Whether an event reports that this receiver could not be reached."""
    return bool(body["kind"] == GIVEN_UP and body["details"].get("receiver") == receiver)
