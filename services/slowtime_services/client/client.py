"""The client: one method a question."""

import hashlib
import os
import time
from collections.abc import Generator, Iterator, Mapping
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeVar

from pydantic_core import from_json

from slowtime_schemas.answers.asset_events import AssetEventList, AssetEventModel
from slowtime_schemas.answers.base import RestAnswer
from slowtime_schemas.answers.composites import CompositeBrief, CompositeList, CompositeModel
from slowtime_schemas.answers.forecasts import ForecastModel, TrackRecordModel
from slowtime_schemas.answers.history import EventList, EventModel, HashModel, HistoryModel
from slowtime_schemas.answers.plans import FleetPlanModel, PlanModel
from slowtime_schemas.answers.risks import RiskModel
from slowtime_schemas.answers.twins import RegisteredTwin, State
from slowtime_schemas.twin_changes import TwinChange, TwinChanges

from .history import TwinHistory
from .http import AnswerError, HttpConnection, UnreachableError

AnyAnswer = TypeVar("AnyAnswer", bound=RestAnswer)

TOKEN = "SLOWTIME_TOKEN"
"""Name of the variable that holds the token; arguments may be read by others."""

_V1 = "/api/v1"
_PIECE = 2**16
_LONGEST_NAME = 64
"""Characters of the id of an event."""
_SILENT_S = 30.0
"""The server says that it is there every ten seconds."""


class Live(NamedTuple):
    """Something that has happened: a state, an event, or that the history is another now."""

    state: State | None = None
    event: EventModel | None = None
    reset: bool = False
    id: str = ""
    """Where to go on from, for `Client.live`."""


class Client:
    """A twin server, asked.

    Parameters
    ----------
    url
        Of the server.
    token
        Where the server wants one; by default what the variable `TOKEN` holds.
    ca
        Certificates to trust instead of the system's, such as a site's own (PEM).

    Examples
    --------
    >>> Client("http://127.0.0.1:8000").url
    'http://127.0.0.1:8000'
    >>> Client("127.0.0.1")
    Traceback (most recent call last):
    ValueError: '127.0.0.1' is not a valid address of a server. Give one such as http://127.0.0.1:8000.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8000",
        *,
        token: str | None = None,
        ca: Path | None = None,
        timeout_s: float = 60.0,
    ) -> None:
        self._token = token or os.environ.get(TOKEN)
        self._door = HttpConnection(url, self._token, ca, timeout_s)
        self._patient = HttpConnection(url, self._token, ca, _SILENT_S)

    @property
    def url(self) -> str:
        """Where the server is."""
        return self._door.url

    def __enter__(self) -> Self:
        """Return the client; it keeps no connection open between requests."""
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: there is nothing to close."""

    def json(
        self,
        method: str,
        path: str,
        query: Mapping[str, object] | None = None,
        body: object = None,
    ) -> dict[str, Any]:
        """Ask anything under ``/api/v1``; the answer as it came.

        Raises
        ------
        AnswerError
            Where the server refuses.
        UnreachableError
            Where it does not answer, or not in JSON.
        """
        text = self._door.read(method, f"{_V1}{path}", query, body)
        try:
            found: dict[str, Any] = from_json(text)
        except ValueError as error:
            raise UnreachableError(
                f"{self.url} is not a twin server: it answered {text[:40]!r}. Give its address."
            ) from error
        return found

    def _ask(
        self,
        answer: type[AnyAnswer],
        method: str,
        path: str,
        query: Mapping[str, object] | None = None,
        body: object = None,
    ) -> AnyAnswer:
        return answer.model_validate(self.json(method, path, query, body))

    def ready(self) -> bool:
        """Whether the server is there and can do its work."""
        try:
            self._door.read("GET", "/readyz")
        except (AnswerError, UnreachableError):
            return False
        return True

    def twins(self) -> list[RegisteredTwin]:
        """All twins that the token may see, each with its latest state."""
        told = self.json("GET", "/twins")["twins"]
        return [RegisteredTwin.model_validate(one) for one in told]

    def twin(self, twin_id: str, *, at: str | None = None) -> RegisteredTwin:
        """Find a twin as it is, or as it was `at` a moment.

        `at` is RFC 3339, nanoseconds since 1970, or slow time as ``slow:812.5``; so are all
        moments here.
        """
        return self._ask(RegisteredTwin, "GET", f"/twins/{twin_id}", {"at": at})

    def heads(self, *, after: int | None = None, limit: int = 1) -> list[dict[str, Any]]:
        """Signed heads of the ledger: the newest, or those that follow a number."""
        told = self.json("GET", "/ledger/heads", {"after": after, "limit": limit})
        return list(told["heads"])

    def tree_head(self, twin_id: str) -> dict[str, Any]:
        """Signed tree head of a twin's chain, to be kept elsewhere."""
        return dict(self.json("GET", f"/twins/{twin_id}/ledger"))

    def consistency(self, twin_id: str, first: int) -> dict[str, Any]:
        """Proof that a twin's chain begins with the `first` entries of a kept tree head."""
        return dict(self.json("GET", f"/ledger/chains/{twin_id}/consistency", {"first": first}))

    def inclusion(
        self, twin_id: str, boot: str, sequence: int, *, before: int | None = None
    ) -> dict[str, Any]:
        """Proof that a reading is among the entries of a twin's chain."""
        asked = {"boot": boot, "sequence": sequence, "before": before}
        return dict(self.json("GET", f"/ledger/chains/{twin_id}/inclusion", asked))

    def register(self, twin_id: str, registration: Mapping[str, Any]) -> RegisteredTwin:
        """Register a twin; an existing one is replaced, and its history estimated again."""
        return self._ask(RegisteredTwin, "PUT", f"/twins/{twin_id}", body=dict(registration))

    def change(
        self,
        twin_id: str,
        after: Mapping[str, Any],
        *,
        event: str | None = None,
        before: Mapping[str, Any] | None = None,
        person: str | None = None,
        text: str = "",
    ) -> TwinChange:
        """Change fields of a registration, such as ``{"alarms": [...]}``, or correct an event.

        Parameters
        ----------
        event
            Recorded event to be corrected, with ``after`` such as
            ``{"repair": {"restored_share": 0.6}}``; another one is recorded instead of it.
        before
            Values that hold as far as the author knows; refused if others hold now.
        text
            Reason, kept with the change.
        """
        body: dict[str, Any] = {"after": dict(after), "person": person, "text": text}
        body |= {"event": event, "before": dict(before or {})}
        return self._ask(TwinChange, "POST", f"/twins/{twin_id}/changes", body=body)

    def undo_change(
        self, twin_id: str, number: int, *, person: str | None = None, text: str = ""
    ) -> TwinChange:
        """Put back what a change has replaced; refused if it was changed again since."""
        body = {"reverses": number, "person": person, "text": text}
        return self._ask(TwinChange, "POST", f"/twins/{twin_id}/changes", body=body)

    def changes(self, twin_id: str) -> tuple[TwinChange, ...]:
        """Return changes of registration and events, with authors and values, newest first."""
        return self._ask(TwinChanges, "GET", f"/twins/{twin_id}/changes").changes

    def delete(self, twin_id: str) -> None:
        """Forget a twin and its history."""
        self._door.read("DELETE", f"{_V1}/twins/{twin_id}")

    def quarantine(self, twin_id: str) -> list[dict[str, Any]]:
        """Messages of a twin that the server set aside, the newest first."""
        return list(self.json("GET", f"/twins/{twin_id}/quarantine")["messages"])

    def release(self, twin_id: str, number: int) -> None:
        """Try a message that was set aside again; all states are estimated anew with it."""
        self._door.read("POST", f"{_V1}/twins/{twin_id}/quarantine/{number}/release")

    def drop(self, twin_id: str, number: int) -> None:
        """Delete a message that was set aside; its place stays without an estimate."""
        self._door.read("DELETE", f"{_V1}/twins/{twin_id}/quarantine/{number}")

    def history(
        self,
        twin_id: str,
        *,
        start: str | None = None,
        end: str | None = None,
        max_points: int | None = None,
    ) -> TwinHistory:
        """States from `start` to `end`; of too many, a selection with statistics of all.

        `bands` of the answer then hold means, extremes and intervals of all of them.
        """
        query = {"start": start, "end": end, "max_points": max_points}
        found = self._ask(HistoryModel, "GET", f"/twins/{twin_id}/history", query)
        return TwinHistory(found.points, found.bands)

    def history_after(
        self, twin_id: str, position: str = ":0", *, limit: int = 1_000
    ) -> TwinHistory:
        """States that follow one, in order and none left out; ``:0`` begins with the first.

        Parameters
        ----------
        position
            ``BOOT:SEQUENCE`` of that state, such as ``f"{state.boot}:{state.sequence}"``.
        """
        query = {"after": position, "max_points": limit}
        found = self._ask(HistoryModel, "GET", f"/twins/{twin_id}/history", query)
        return TwinHistory(found.points)

    def export(
        self,
        twin_id: str,
        out: Path,
        form: Literal["csv", "parquet"] = "csv",
        *,
        start: str | None = None,
        end: str | None = None,
    ) -> int:
        """Write every state of the history to a file, piece by piece; how many bytes."""
        query = {"format": form, "start": start, "end": end}
        path = f"{_V1}/twins/{twin_id}/history/export"
        written = 0
        with self._door.ask("GET", path, query) as answer, out.open("wb") as file:
            while piece := answer.read(_PIECE):
                written += file.write(piece)
        return written

    def digest(self, twin_id: str) -> HashModel:
        """SHA-256 of a twin's whole history."""
        return self._ask(HashModel, "GET", f"/twins/{twin_id}/history/hash")

    def forecast(
        self,
        twin_id: str,
        *,
        horizon: float | None = None,
        points: int | None = None,
        threshold: float | None = None,
    ) -> ForecastModel:
        """Return the forecast of a twin, and when thresholds are reached."""
        query = {"horizon": horizon, "points": points, "threshold": threshold}
        return self._ask(ForecastModel, "GET", f"/twins/{twin_id}/forecast", query)

    def track_record(self, twin_id: str) -> TrackRecordModel:
        """Return what came of the past outlooks of a twin: coverage, reliability, scores."""
        return self._ask(TrackRecordModel, "GET", f"/twins/{twin_id}/forecast/record")

    def plan(
        self,
        twin_id: str,
        *,
        lead_time: float | None = None,
        months: str | None = None,
        accepted: float | None = None,
    ) -> PlanModel:
        """Return the recommended action for a twin's structure, with date and reasons.

        Lead time (in the unit of its costs), months such as "5-9" and accepted probability
        take the place of those registered.
        """
        query = {"lead_time": lead_time, "months": months, "accepted": accepted}
        return self._ask(PlanModel, "GET", f"/twins/{twin_id}/plan", query)

    def risk(self, twin_id: str, *, horizon: float | None = None) -> RiskModel:
        """Return the probability of failure by each limit state of a twin."""
        query = {"horizon": horizon}
        return self._ask(RiskModel, "GET", f"/twins/{twin_id}/risk", query)

    def fleet_plan(
        self,
        *,
        teams: int | None = None,
        visits: int | None = None,
        window_d: float | None = None,
        budget: float | None = None,
    ) -> FleetPlanModel:
        """Return where inspection teams should go within a window [days]."""
        query = {"teams": teams, "visits": visits, "window_d": window_d, "budget": budget}
        return self._ask(FleetPlanModel, "GET", "/fleet/plan", query)

    def simulate(self, twin_id: str, order: Mapping[str, Any]) -> dict[str, Any]:
        """Run today's twin under a load; as `docs/foresight.md` describes order and answer."""
        return self.json("POST", f"/twins/{twin_id}/simulate", body=dict(order))

    def events(
        self, twin_id: str, *, after: int | None = None, limit: int | None = None
    ) -> list[EventModel]:
        """Find the newest events, or with `after` those that follow the one of that number."""
        query = {"after": after, "limit": limit}
        return list(self._ask(EventList, "GET", f"/twins/{twin_id}/events", query).events)

    def record_event(self, twin_id: str, event: Mapping[str, Any]) -> AssetEventModel:
        """Record a repair, replacement, inspection, load test or note of an asset.

        `docs/events.md` describes what `event` holds; the same one twice is one event.
        """
        return self._ask(AssetEventModel, "POST", f"/twins/{twin_id}/events", body=dict(event))

    def undo_event(
        self,
        twin_id: str,
        event: str,
        *,
        name: str | None = None,
        person: str | None = None,
        text: str = "",
    ) -> AssetEventModel:
        """Withdraw an event: the forecast is as if it had never been reported.

        Parameters
        ----------
        name
            Id of the note that takes it back; by default made of that of the event.
        """
        own = f"undo-{event}"
        if len(own) > _LONGEST_NAME:
            own = f"undo-{hashlib.sha256(event.encode()).hexdigest()[:32]}"
        undone = {"event": name or own, "kind": "note", "reverses": event}
        return self.record_event(twin_id, undone | {"person": person, "text": text})

    def recorded_events(self, twin_id: str) -> AssetEventList:
        """Return reported events, and changes that the twin asks about."""
        return self._ask(AssetEventList, "GET", f"/twins/{twin_id}/events/recorded")

    def alarms(self, twin_id: str, *, limit: int | None = None) -> list[dict[str, Any]]:
        """Return the newest alarms: whether each is still raised, and who acknowledged it."""
        found = self.json("GET", f"/twins/{twin_id}/alarms", {"limit": limit})
        return list(found["alarms"])

    def acknowledge(
        self, twin_id: str, event_id: str, *, by: str | None = None, note: str = ""
    ) -> dict[str, Any]:
        """Acknowledge an alarm."""
        path = f"/twins/{twin_id}/alarms/{event_id}/acknowledge"
        return self.json("POST", path, body={"by": by, "note": note})

    def test_alarm(self, twin_id: str, receiver: str | None = None) -> dict[str, Any]:
        """Send a test alarm to all receivers of a twin, or to one of them."""
        body = {"receiver": receiver}
        return self.json("POST", f"/twins/{twin_id}/alarms/test", body=body)

    def deliveries(self, twin_id: str, *, limit: int | None = None) -> dict[str, Any]:
        """Return deliveries of a twin's events, and the reasons of failures."""
        return self.json("GET", f"/twins/{twin_id}/alarms/deliveries", {"limit": limit})

    def holdings(self) -> dict[str, Any]:
        """Return what is under way for the sites of the token, and what is allowed."""
        return self.json("GET", "/holdings")

    def cancel(self, holding_id: str) -> dict[str, Any]:
        """End something that is under way, by its id; return what still is."""
        return self.json("DELETE", f"/holdings/{holding_id}")

    def dtdl(self, *, site: str | None = None, form: str = "dtdl-3") -> dict[str, Any]:
        """Return sites, twins, composites and relations as a graph.

        `form` is ``dtdl-3`` or ``dtdl-2``, with models of that version, or ``json-ld``.
        """
        return self.json("GET", "/dtdl", {"site": site, "as": form})

    def dtdl_of(self, twin_id: str, *, form: str = "dtdl-3") -> dict[str, Any]:
        """Return one twin, the parts of its model and their relations, likewise."""
        return self.json("GET", f"/twins/{twin_id}/dtdl", {"as": form})

    def composites(self) -> list[CompositeBrief]:
        """All composites whose twins the token may see, with their health."""
        return list(self._ask(CompositeList, "GET", "/composites").composites)

    def composite(self, composite_id: str, *, horizon: float | None = None) -> CompositeModel:
        """Find a composite: health, failure probability, importance, pooled rates."""
        return self._ask(
            CompositeModel, "GET", f"/composites/{composite_id}", {"horizon": horizon}
        )

    def register_composite(
        self, composite_id: str, registration: Mapping[str, Any]
    ) -> CompositeModel:
        """Register a composite; an existing one is replaced."""
        return self._ask(
            CompositeModel, "PUT", f"/composites/{composite_id}", body=dict(registration)
        )

    def delete_composite(self, composite_id: str) -> None:
        """Delete a composite; its members stay."""
        self._door.read("DELETE", f"{_V1}/composites/{composite_id}")

    def memberships(self, twin_id: str) -> list[str]:
        """Name the composites that a twin is a member of."""
        return list(self.json("GET", f"/twins/{twin_id}/memberships")["composites"])

    def live(
        self, twin_id: str, *, last_id: str | None = None, patience_s: float = 60.0
    ) -> Generator[Live, None, None]:
        """States and events as they become durable, for ever; nothing is left out.

        Where the connection breaks it is made again, and goes on where it was.

        Parameters
        ----------
        last_id
            `id` of what was seen last, such as in an earlier run; the latest state without.
        patience_s
            For how long a server may be away.
        """
        seen, away_s = last_id, None
        while True:
            headers = {} if seen is None else {"Last-Event-ID": seen}
            path = f"{_V1}/twins/{twin_id}/live"
            try:
                with self._patient.ask("GET", path, headers=headers) as answer:
                    away_s = None
                    for one in _server_sent_events(answer):
                        seen = one.id or seen
                        yield one
            except UnreachableError:
                away_s = time.monotonic() if away_s is None else away_s
                if time.monotonic() - away_s > patience_s:
                    raise
            time.sleep(0.5)


def _server_sent_events(answer: HTTPResponse) -> Iterator[Live]:
    """Return server-sent events until the connection ends or has been silent for too long."""
    fields: dict[str, str] = {}
    while True:
        try:
            line = answer.readline()
        except (OSError, HTTPException):
            return
        if not line:
            return
        name, _, value = line.decode().rstrip("\n").partition(": ")
        if name:
            fields[name] = value
        elif fields:
            if (one := _live(fields)) is not None:
                yield one
            fields = {}


def _live(fields: Mapping[str, str]) -> Live | None:
    kind, told, at = fields.get("event"), fields.get("data", ""), fields.get("id", "")
    if kind == "state":
        return Live(state=State.model_validate_json(told), id=at)
    if kind == "event":
        return Live(event=EventModel.model_validate_json(told), id=at)
    return Live(reset=True, id=at) if kind == "reset" else None
