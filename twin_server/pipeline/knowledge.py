"""Answers the requests of the serve stage from store, pipeline and analysis."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from slowtime_schemas.codec import decode
from slowtime_schemas.messages import Fatigue
from slowtime_schemas.streams import FATIGUE
from slowtime_services.bus import Bus
from twin_server.estimate import ChangeForecast, current_changes, forecast_from_state, normal_of
from twin_server.estimate.elements import spatial_scene
from twin_server.identity.principals import Principal
from twin_server.orders import SimulationOrder
from twin_server.persist import Store, StoredHistory
from twin_server.registration.changes import Author
from twin_server.registration.costs import RepairTerms
from twin_server.registration.thresholds import Limit
from twin_server.registration.twin import Registration
from twin_server.serve import HistoryPart, Hub, Moment, ProblemError, TwinForecast
from twin_server.serve.conclusion import conclude

from .alarms import raised_of
from .analysis.evidence import EvidenceDesk
from .analysis.fatigue import fatigue_of
from .analysis.forecast_cache import ForecastCache
from .analysis.plans import STALE, PlanCache
from .analysis.risk import RiskCache
from .analysis.simulations import Simulations
from .analysis.track_record import record_answer
from .ingestion.estimation import NotEstimatedError
from .ingestion.pipeline import Pipeline
from .ingestion.routing import UnknownReceiverError
from .ingestion.updates import TwinUpdate
from .ledger_proofs import LedgerProofs
from .workers.processes import CallerThread, WorkerPool

SHIFT = 40
_LOOK_BACK = 1_000
NOT_SIGNED = (
    "The ledger is not signed any more, because the database is not proven. Readings are "
    "taken in as before. The log, `slowtime db ledger head` and events `ledger_refused` say "
    "what differs."
)


class TwinKnowledge:
    """Answers of pipeline and store to the requests of serve.

    Parameters
    ----------
    bus
        Asked whether it is connected, where it can tell.
    refresh
        A forecast learns anew after so many readings.
    workers
        Where is computed what takes long; by default in the thread that asks.
    disagrees
        Whether the model of a twin disagrees with raw samples.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        store: Store,
        *,
        bus: Bus | None = None,
        refresh: int = 25,
        workers: WorkerPool | None = None,
        disagrees: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._pipeline, self._store, self._bus = pipeline, store, bus
        self._workers = workers or CallerThread()
        self.prospects = ForecastCache(
            pipeline,
            store,
            refresh=refresh,
            run=self._workers.run,
            on_renewed=self._assess_anew,
        )
        self._proofs = LedgerProofs(pipeline, store)
        pipeline.listen(self.prospects)
        self._assessing = RiskCache(pipeline, store, self.prospects, self._workers)
        self._planning = PlanCache(pipeline, store, self.prospects, self._workers)
        self._evidence = EvidenceDesk(
            pipeline, self.prospects, self._assessing, self._planning, disagrees
        )
        effects = pipeline.settings.diagnose.effects
        self._simulating = Simulations(store, self._workers, effects)

    def ids(self, principal: Principal) -> list[str]:
        """Twins that a principal may see, in the order of their registration."""
        return principal.seen(twin.id for twin in self._store.twins())

    def registration(self, twin_id: str) -> Registration | None:
        """Return the registration of a twin; None where there is none."""
        twin = self._pipeline.twin(twin_id)
        return None if twin is None else twin.registration

    def nominal(self, twin_id: str) -> dict[str, float] | None:
        """Return the nominal model in use; None while it is being learnt."""
        twin = self._pipeline.twin(twin_id)
        return None if twin is None else twin.checkpoint.nominal()

    def nominal_modes(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the modes of a twin of elements as learnt; empty while they are not."""
        twin = self._pipeline.twin(twin_id)
        return [] if twin is None else twin.checkpoint.nominal_modes()

    def spatial_scene(self, twin_id: str, state: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return measured shapes over the model's in space; None without a geometry."""
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return None
        return spatial_scene(twin.registration, twin.checkpoint.elements, state)

    def normal(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the normal behaviour under covariates, and detected departures from it."""
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return []
        return normal_of(twin.checkpoint.conditions(), twin.registration)

    def alive(self, twin_id: str) -> bool:
        """Whether the edge of a twin is there."""
        return self._pipeline.is_alive(twin_id)

    def heard_ns(self, twin_id: str) -> int | None:
        """When features last came; None where not since this server began."""
        return self._pipeline.heard_ns(twin_id)

    def sensor(self, twin_id: str) -> dict[str, int] | None:
        """Return counters of the live sensor; None for other inputs."""
        return self._pipeline.sensor(twin_id)

    def link(self, twin_id: str) -> dict[str, Any] | None:
        """Return what the edge said of its link; None of one that sends all at once."""
        link = self._pipeline.link(twin_id)
        return None if link is None else link.model_dump()

    def raised(self, twin_id: str) -> list[dict[str, Any]]:
        """Return the alarms that are raised now: quantity, side and limit of each."""
        return raised_of(self._pipeline.twin(twin_id))

    def latest(self, twin_id: str, at: Moment | None) -> HistoryPart:
        """Find the last state, now or at a moment: one, or none."""
        at = at or Moment()
        return _chapter(
            self._store.history(
                twin_id,
                t_ns=(None, at.t_ns),
                slow_time=(None, at.slow_time),
                limit=1,
                newest=True,
            )
        )

    def history(
        self, twin_id: str, start: Moment | None, end: Moment | None, max_points: int
    ) -> HistoryPart:
        """States between two instants; of too many, a selection with statistics of all."""
        start, end = start or Moment(), end or Moment()
        found = self._store.thinned(
            twin_id,
            max_points,
            t_ns=(start.t_ns, end.t_ns),
            slow_time=(start.slow_time, end.slow_time),
        )
        return _chapter(found.history)._replace(bands=found.bands)

    def since(self, twin_id: str, key: int, limit: int) -> HistoryPart:
        """States behind the one of `key`."""
        after = key >> SHIFT, key & ((1 << SHIFT) - 1)
        return _chapter(self._store.history(twin_id, after=after, limit=limit))

    def boot_number(self, twin_id: str, boot: str) -> int | None:
        """Return the number of a boot in the keys of `since`; None where the twin has none."""
        return self._store.boot_number(twin_id, boot)

    def outlook(
        self,
        twin_id: str,
        horizon: float | None,
        count: int,
        thresholds: Sequence[Limit] = (),
        at: Moment | None = None,
    ) -> TwinForecast | None:
        """Forecast a twin from now or from an instant; None if there are too few readings."""
        twin = self._pipeline.twin(twin_id)
        if twin is None:
            return None
        ahead = twin.registration.outlook_horizon if horizon is None else horizon
        if at is None or at == Moment():
            told = self.prospects.foresee(twin_id, ahead, count, tuple(thresholds))
            return None if told is None else _outlook(*told)
        known = self.prospects.at(twin_id, at.t_ns, at.slow_time)
        if known is None:
            return None
        prospect, unit = known
        return _outlook(forecast_from_state(prospect, ahead, count, thresholds, unit), unit)

    def track_record(self, twin_id: str) -> dict[str, Any]:
        """Return the past outlooks of a twin, and what came of them, as REST does."""
        last = self._store.history(twin_id, limit=1, newest=True)
        unit = last.boots[last.number[-1]][1] if len(last.states) else None
        return record_answer(twin_id, self.prospects.verified(twin_id), unit)

    def risk(
        self, twin_id: str, horizon: float | None, since: float | None = None
    ) -> dict[str, Any]:
        """Return the failure probability of a twin by each of its limit states."""
        return self._assessing.risk(twin_id, horizon, since)

    def plan(
        self,
        twin_id: str,
        *,
        stale: bool = False,
        since: float | None = None,
        terms: RepairTerms | None = None,
    ) -> dict[str, Any]:
        """Return the maintenance plan of a twin; with `stale`, one of some readings ago.

        `terms` are terms of a repair other than those registered.
        """
        return self._planning.plan(
            twin_id,
            stale=STALE if stale else 0,
            since=since,
            terms=terms or RepairTerms(),
        )

    def conclusion(
        self, twin_id: str, reasons: int | None, suspects: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Answer whether anything is wrong with a twin, with its latest state given."""
        return conclude(self._evidence.evidence(twin_id, reasons, suspects)).to_dict()

    def _assess_anew(self, twin_id: str, since: float | None) -> None:
        """Keep risk and plan of a twin up to date, though nobody asks; none is made in vain."""
        self._assessing.risk(twin_id, None, since)
        self._planning.plan(twin_id, since=since)

    def check(self, twin_id: str, order: SimulationOrder) -> None:
        """Refuse a load that a twin cannot be run under, at no cost."""
        twin = self._pipeline.twin(twin_id)
        if twin is not None:
            self._simulating.check(twin, order)

    def simulate(self, twin_id: str, order: SimulationOrder) -> bytes:
        """Simulate a twin under a load, and return the response as JSON."""
        twin = self._pipeline.twin(twin_id)
        found = self._store.history(twin_id, limit=_LOOK_BACK, newest=True)
        if twin is None or not len(found.states):
            raise ProblemError(
                409,
                "not-known-yet",
                f"There are no features of {twin_id} yet. Start the edge agent.",
            )
        now = current_changes(self.prospects.prospect(twin_id))
        return self._simulating.run(twin_id, twin, found, now, order)

    def events(
        self, twin_id: str | None, *, after: int, limit: int, newest: bool
    ) -> list[tuple[int, str]]:
        """Find number and body of events in order."""
        rows = self._store.events(twin_id, after=after, limit=limit, newest=newest)
        return [(row.number, row.body) for row in rows]

    def heads(self, after: int | None, limit: int) -> list[dict[str, Any]]:
        """Signed heads of the ledger: those that follow a number, or the newest."""
        rows = self._store.heads(after=after or 0, limit=limit, newest=after is None)
        return [json.loads(row.body)["head"] for row in rows]

    @property
    def proofs(self) -> LedgerProofs:
        """Tree heads of chains, and proofs of them."""
        return self._proofs

    def ledger_refusal(self) -> str:
        """Why heads are not signed any more, with names of twins; empty if all is well."""
        return self._pipeline.ledger_refusal

    def fatigue(self, twin_id: str) -> list[dict[str, Any]]:
        """Damage of each point of a twin, its course and the time that is left."""
        messages = (decode(FATIGUE, row.message) for row in self._store.fatigue(twin_id))
        return fatigue_of([one for one in messages if isinstance(one, Fatigue)])

    def virtual(self, twin_id: str) -> list[dict[str, Any]]:
        """Latest windows of virtual quantities, since this server began."""
        kept = ("boot", "start_ns", "t_ns", "rate_hz", "lowest_hz", "valid", "reasons")
        return [
            {name: getattr(window, name) for name in kept}
            | {"quantities": [quantity.model_dump() for quantity in window.quantities]}
            for window in self._pipeline.virtual(twin_id)
        ]

    def digest(self, twin_id: str) -> tuple[str, int]:
        """SHA-256 of a twin's whole history, and how many features it has."""
        return self._store.digest(twin_id)

    def register(
        self, twin_id: str, registration: Registration, author: Author | None = None
    ) -> bool:
        """Register a twin; True where it is new."""
        try:
            self._pipeline.routing.check(twin_id, registration)
        except UnknownReceiverError as error:
            raise ProblemError(422, "no-such-receiver", str(error)) from error
        try:
            return self._pipeline.register(twin_id, registration, author=author)
        except NotEstimatedError as error:
            raise ProblemError(422, "not-estimated", str(error)) from error

    def delete(self, twin_id: str) -> bool:
        """Forget a twin; False where there is none."""
        return self._pipeline.delete(twin_id)

    def troubles(self) -> list[str]:
        """Return sentences on problems of this server; none if all is well."""
        found = []
        if not self._pipeline.working:
            found.append("The working thread has ended. Restart the server.")
        if self._pipeline.stalled:
            found.append(self._pipeline.stalled)
        if self._pipeline.trouble:
            found.append(self._pipeline.trouble)
        if self._pipeline.failing:
            found.append(f"The last batch failed: {self._pipeline.failing}")
        if not getattr(self._bus, "connected", True):
            found.append("The router is not connected. Start it, or wait: edges keep all.")
        try:
            self._store.check()
        except Exception as error:
            found.append(str(error))
        return found

    def cautions(self) -> list[str]:
        """Return sentences on what fails while readings go on; they name no twin."""
        return [NOT_SIGNED] if self._pipeline.ledger_refusal else []

    def aside(self, twin_id: str) -> int:
        """Count the messages of a twin that are set aside."""
        return self._pipeline.setting_aside.quarantine.count(twin_id)

    def stalled(self) -> str:
        """Say that the pipeline stands still; empty while it goes on."""
        return self._pipeline.stalled

    def counts(self) -> Mapping[str, int]:
        """Return all counters."""
        errors = 0 if self._bus is None else self._bus.callback_errors
        return {**self._pipeline.counts, **self._pipeline.tallies(), "callback_errors": errors}

    def refused(self) -> Mapping[str, int]:
        """Return the number of refusals for each reason."""
        return self._pipeline.refusals.counts

    def gauges(self) -> Mapping[str, Any]:
        """Return the gauges of the server."""
        return {**self._pipeline.gauges(), "forecasts_due": self.prospects.due}


class LiveUpdates:
    """Passes updates to the live stream."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub

    def tell(self, news: TwinUpdate) -> None:
        """Pass on the update of one twin."""
        self._hub.tell(news.twin_id, news.states, news.runs, news.events, news.bodies)

    def reset(self, twin_id: str) -> None:
        """Pass on that a twin's history was rewritten or deleted."""
        self._hub.reset(twin_id)


def _outlook(foresight: ChangeForecast, unit: str | None) -> TwinForecast:
    return TwinForecast(
        foresight.since,
        foresight.horizon,
        foresight.slow_time,
        foresight.bands,
        foresight.until,
        foresight.reasons,
        foresight.crossings,
        {name: one.outlook.period for name, one in foresight.outlooks.items()},
        {name: [at for at, _ in one.outlook.jumps] for name, one in foresight.outlooks.items()},
        unit,
        foresight.misfits,
        foresight.widening,
    )


def _chapter(found: StoredHistory) -> HistoryPart:
    boots = [found.boots[number] for number in found.number]
    return HistoryPart(
        found.states,
        [
            number << SHIFT | sequence
            for number, sequence in zip(
                found.number, found.states["sequence"].tolist(), strict=True
            )
        ],
        [boot for boot, _ in boots],
        [unit for _, unit in boots],
        found.bodies,
    )
