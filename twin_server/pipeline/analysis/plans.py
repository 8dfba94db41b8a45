"""Computes maintenance plans of twins on request, and keeps them until their next reading."""

import collections
import dataclasses
import threading
from typing import Any, NamedTuple

import numpy as np

from slowtime_schemas.slow_times import FIRST_CLOCK_S
from twin_server.estimate import (
    ForecastState,
    NotPlannableError,
    Past,
    PlanOrder,
    Twin,
    past_of,
    past_of_elements,
    plan_answer,
    refusal_of,
)
from twin_server.persist import Store, StoredHistory
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.pipeline.workers.processes import WorkerPool
from twin_server.registration.costs import RepairTerms
from twin_server.registration.twin import Registration

from .forecast_cache import ForecastCache

NEWEST = 60
"""States that tell how often and how well is read, and the pace of slow time."""

SHOWN = 400
"""States among which a plan tells the valid readings: as many as a forecast is made from."""

MOST_KEPT = 500
"""Plans that are kept, those asked for last: some 70 kB each."""

STALE = 25
"""Readings that a plan may be old where a whole fleet is asked for."""

AS_REGISTERED = RepairTerms()
"""Terms of a repair as the registration has them."""

NO_DECISION = (
    "There is nothing to decide: the registration has no `costs` and `decision`. Register the "
    "twin with both; docs/maintenance_plan.md describes them."
)
TOO_FEW = (
    "There are too few valid readings for a plan. Wait for more, or see the reasons "
    "given with the latest states."
)


class _Epoch(NamedTuple):
    """The reading after which a plan was made."""

    boot: int
    sequence: int


class _CachedPlan(NamedTuple):
    registration: Registration
    epoch: _Epoch
    prospect: ForecastState | None
    answer: dict[str, Any]


class PlanCache:
    """Plans of twins, made where workers compute.

    Parameters
    ----------
    prospects
        Give what is believed of each change after its last reading.
    """

    def __init__(
        self, pipeline: Pipeline, store: Store, prospects: ForecastCache, workers: WorkerPool
    ) -> None:
        self._pipeline, self._store = pipeline, store
        self._prospects, self._workers = prospects, workers
        self._kept: collections.OrderedDict[str, _CachedPlan] = collections.OrderedDict()
        self._lock = threading.Lock()

    def plan(
        self,
        twin_id: str,
        *,
        stale: int = 0,
        since: float | None = None,
        terms: RepairTerms = AS_REGISTERED,
    ) -> dict[str, Any]:
        """Return the plan of a twin as REST does; of one state of its forecast the same.

        Parameters
        ----------
        stale
            Readings that a kept plan may be old.
        since
            Slow time of the reading whose forecast it has to agree with, see
            `ForecastCache.prospect`.
        terms
            Terms of a repair other than those registered; such a plan is not kept.
        """
        twin = self._pipeline.twin(twin_id)
        if twin is None or twin.registration.decision is None:
            return refusal_of(twin_id, NO_DECISION)
        found = self._store.history(twin_id, slow_time=(None, since), limit=NEWEST, newest=True)
        if not len(found.states):
            return refusal_of(twin_id, TOO_FEW)
        if terms != AS_REGISTERED:
            prospect = self._prospects.prospect(twin_id, since)
            return self._made(twin_id, twin, found, prospect, terms)
        epoch = _Epoch(int(found.number[-1]), int(found.states["sequence"][-1]))
        with self._lock:
            kept = self._kept.get(twin_id)
        if stale and kept is not None and _holds(kept, twin.registration, epoch, stale):
            return kept.answer
        prospect = self._prospects.prospect(twin_id, since)
        if (
            kept is not None
            and kept.prospect is prospect
            and kept.registration == twin.registration
        ):
            return kept.answer
        answer = self._made(twin_id, twin, found, prospect)
        with self._lock:
            self._kept[twin_id] = _CachedPlan(twin.registration, epoch, prospect, answer)
            self._kept.move_to_end(twin_id)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return answer

    def told(self, twin_id: str) -> dict[str, Any] | None:
        """Return the plan as it was told last; computes nothing."""
        with self._lock:
            kept = self._kept.get(twin_id)
        twin = self._pipeline.twin(twin_id)
        if kept is None or twin is None or kept.registration != twin.registration:
            return None
        return kept.answer

    def _made(
        self,
        twin_id: str,
        twin: Twin,
        found: StoredHistory,
        prospect: ForecastState | None,
        terms: RepairTerms = AS_REGISTERED,
    ) -> dict[str, Any]:
        order = self._order(twin, found, prospect)
        if order is None:
            return refusal_of(twin_id, TOO_FEW, twin.registration.name)
        past = _past_states(twin, self._shown(twin_id, order)).get(
            order.decision.failure.quantity
        )
        order = dataclasses.replace(order, past=past)
        if terms != AS_REGISTERED:
            order = dataclasses.replace(order, decision=terms.changed(order.decision))
        try:
            answer: dict[str, Any] = self._workers.run(plan_answer, twin_id, order)
        except NotPlannableError as error:
            return refusal_of(twin_id, str(error), twin.registration.name)
        return answer

    def _shown(self, twin_id: str, order: PlanOrder) -> StoredHistory:
        """Read the states whose readings are told with a plan, up to the one it is made of."""
        until = order.laws.now
        return self._store.history(twin_id, slow_time=(None, until), limit=SHOWN, newest=True)

    def _order(
        self, twin: Twin, found: StoredHistory, prospect: ForecastState | None
    ) -> PlanOrder | None:
        registration = twin.registration
        costs, decision = registration.costs, registration.decision
        if costs is None or decision is None or prospect is None:
            return None
        quantity = decision.failure.quantity
        past = _past_states(twin, found).get(quantity)
        if quantity not in prospect.laws or past is None or len(past.slow_time) < 2:
            return None
        steps = np.diff(past.slow_time)
        steps = steps[steps > 0]
        if not len(steps):
            return None
        return PlanOrder(
            costs,
            decision,
            prospect.laws[quantity],
            prospect.common[quantity],
            float(np.median(past.own_sd)),
            float(np.median(steps)),
            pace_of(found),
            prospect.since - prospect.first,
            found.boots[int(found.number[-1])][1] or None,
            prospect.widening.get(quantity, 1.0),
            _calendar_ns(int(found.states["t_ns"][-1])),
            registration.name,
        )


def _calendar_ns(t_ns: int) -> int | None:
    """Return a time of the sensor's clock; None where that is no calendar."""
    return t_ns if t_ns >= FIRST_CLOCK_S * 1e9 else None


def _holds(kept: _CachedPlan, registration: Registration, epoch: _Epoch, stale: int) -> bool:
    if kept.registration != registration or kept.epoch.boot != epoch.boot:
        return False
    return 0 <= epoch.sequence - kept.epoch.sequence <= stale


def pace_of(found: StoredHistory) -> float | None:
    """Seconds of the sensor's clock in one slow time; None where they do not rise together."""
    slow = found.states["slow_time"]
    went = float(slow[-1] - slow[0])
    took = float(int(found.states["t_ns"][-1]) - int(found.states["t_ns"][0])) / 1e9
    return took / went if went > 0 and took > 0 else None


def _past_states(twin: Twin, found: StoredHistory) -> dict[str, Past]:
    elements = twin.checkpoint.elements
    if elements is None:
        return past_of(found.states, twin.checkpoint.known)
    return past_of_elements(found.states, found.bodies, elements)
