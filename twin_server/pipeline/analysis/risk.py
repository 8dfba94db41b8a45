"""Computes the risk of twins on request, and keeps it until their next reading."""

import collections
import threading
from typing import Any, NamedTuple

from twin_server.estimate import (
    ForecastState,
    RiskOrder,
    Twin,
    past_of,
    past_of_elements,
    risk_answer,
)
from twin_server.persist import Store, StoredHistory
from twin_server.pipeline.analysis.learning_input import LOOK_BACK
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.pipeline.workers.processes import WorkerPool
from twin_server.registration.twin import Registration

from .forecast_cache import ForecastCache

MOST_KEPT = 500
"""Answers that are kept, those asked for last: some 60 kB each."""

NO_STATES = (
    "There is nothing to assess: the registration has no `limit_states`. Register the twin "
    "with some; docs/risk.md describes them."
)
TOO_FEW = (
    "There are too few valid readings for a risk assessment. Wait for more, or see the "
    "reasons given with the latest states."
)


class _Key(NamedTuple):
    twin_id: str
    horizon: float | None


class _CachedRisk(NamedTuple):
    registration: Registration
    prospect: ForecastState
    answer: dict[str, Any]


class RiskCache:
    """Risk of twins, computed where workers compute.

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
        self._kept: collections.OrderedDict[_Key, _CachedRisk] = collections.OrderedDict()
        self._lock = threading.Lock()

    def risk(
        self, twin_id: str, horizon: float | None, since: float | None = None
    ) -> dict[str, Any]:
        """Return the risk of a twin as REST does; of one state of its forecast the same.

        Parameters
        ----------
        horizon
            How far ahead, in slow time; None for that of the twin's forecast.
        since
            Slow time of the reading whose forecast it has to agree with, see
            `ForecastCache.prospect`.
        """
        twin = self._pipeline.twin(twin_id)
        if twin is None or not twin.registration.limit_states:
            return _nothing(twin_id, NO_STATES)
        prospect = self._prospects.prospect(twin_id, since)
        if prospect is None:
            return _nothing(twin_id, TOO_FEW)
        key = _Key(twin_id, horizon)
        with self._lock:
            kept = self._kept.get(key)
        if (
            kept is not None
            and kept.prospect is prospect
            and kept.registration == twin.registration
        ):
            return kept.answer
        found = self._store.history(
            twin_id, slow_time=(None, prospect.since), limit=LOOK_BACK, newest=True
        )
        if not len(found.states):
            return _nothing(twin_id, TOO_FEW)
        answer = self._made(twin_id, twin, found, prospect, horizon)
        with self._lock:
            self._kept[key] = _CachedRisk(twin.registration, prospect, answer)
            self._kept.move_to_end(key)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return answer

    def told(self, twin_id: str) -> dict[str, Any] | None:
        """Return the risk up to the default horizon as it was told last; computes nothing."""
        with self._lock:
            kept = self._kept.get(_Key(twin_id, None))
        twin = self._pipeline.twin(twin_id)
        if kept is None or twin is None or kept.registration != twin.registration:
            return None
        return kept.answer

    def _made(
        self,
        twin_id: str,
        twin: Twin,
        found: StoredHistory,
        prospect: ForecastState,
        horizon: float | None,
    ) -> dict[str, Any]:
        elements = twin.checkpoint.elements
        past = (
            past_of(found.states, twin.checkpoint.known)
            if elements is None
            else past_of_elements(found.states, found.bodies, elements)
        )
        if not set(prospect.laws) <= set(past):
            return _nothing(twin_id, TOO_FEW)
        span = prospect.since - prospect.first
        order = RiskOrder(
            registration=twin.registration,
            checkpoint=twin.checkpoint,
            laws=prospect.laws,
            common=prospect.common,
            past=past,
            since=prospect.since,
            horizon=prospect.since + (horizon or twin.registration.outlook_horizon or span),
            unit=found.boots[found.number[-1]][1],
            widening=prospect.widening,
        )
        answer: dict[str, Any] = self._workers.run(risk_answer, twin_id, order)
        return answer


def _nothing(twin_id: str, reason: str) -> dict[str, Any]:
    none = dict.fromkeys(("since", "horizon", "slow_time_unit"))
    return {"id": twin_id, **none, "limit_states": [], "valid": False, "reasons": [reason]}
