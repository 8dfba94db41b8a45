"""Gathers what is known of a twin, for the answer whether anything is wrong with it."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from slowtime.degradation import RemainingLife
from twin_server.collect.sensors import SILENT
from twin_server.estimate import Twin, normal_of
from twin_server.pipeline.alarms import raised_of
from twin_server.pipeline.ingestion.pipeline import Pipeline
from twin_server.registration.thresholds import Limit, shown, signed
from twin_server.serve.conclusion import Evidence, FailureProspect, LimitProspect

from .forecast_cache import ForecastCache
from .plans import PlanCache
from .risk import RiskCache


class EvidenceDesk:
    """Gathers evidence without computing anything.

    Parameters
    ----------
    disagrees
        Whether the model of a twin disagrees with raw samples.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        prospects: ForecastCache,
        risks: RiskCache,
        plans: PlanCache,
        disagrees: Callable[[str], bool],
    ) -> None:
        self._pipeline, self._prospects = pipeline, prospects
        self._risks, self._plans, self._disagrees = risks, plans, disagrees

    def evidence(
        self, twin_id: str, reasons: int | None, suspects: Sequence[str] = ()
    ) -> Evidence:
        """Return what is known of a twin now.

        Parameters
        ----------
        reasons
            Bits of its latest state; None where it has none.
        suspects
            Changed elements in it.
        """
        pipeline, twin = self._pipeline, self._pipeline.twin(twin_id)
        sensor = pipeline.sensor(twin_id) or {}
        return Evidence(
            reasons=reasons,
            alive=pipeline.is_alive(twin_id),
            silent_s=sensor.get(SILENT, 0),
            late_s=pipeline.late_s(twin_id),
            raised=[_raised_words(one) for one in raised_of(twin)],
            suspects=suspects,
            unexplained=_has_entered(twin),
            disagrees=self._disagrees(twin_id),
            set_aside=pipeline.setting_aside.quarantine.count(twin_id),
            limits=list(_limits(self._prospects.crossings(twin_id))),
            failures=list(_failures(self._risks.told(twin_id))),
            plan=_plan(self._plans.told(twin_id)),
        )


def _raised_words(raised: dict[str, Any]) -> str:
    words, unit, times = shown(raised["quantity"])
    return f"{words} is {raised['side']} {signed(times * raised['limit'])} {unit}."


def _has_entered(twin: Twin | None) -> bool:
    if twin is None:
        return False
    elements = twin.checkpoint.elements
    if elements is not None and elements.assessed is not None:
        if elements.assessed["verdict"] == "undecided":
            return True
    normal = normal_of(twin.checkpoint.conditions(), twin.registration)
    return any(one["entered"] is not None for one in normal)


def _limits(crossings: Sequence[tuple[Limit, RemainingLife]]) -> Iterator[LimitProspect]:
    for limit, life in crossings:
        if limit.toward is None:  # a question, not an alarm
            continue
        words, unit, times = shown(limit.quantity)
        what = f"{words} {limit.toward} {signed(times * limit.at)} {unit}"
        yield LimitProspect(life.within, life.already, f"{what}: {life.words()}")


def _failures(risk: dict[str, Any] | None) -> Iterator[FailureProspect]:
    for state in risk["limit_states"] if risk else ():
        if state["now"] is not None:
            yield FailureProspect(
                now=state["now"]["probability"]["value"],
                within=state["within"]["value"],
                accepted=state["accepted"],
                reached=state["until"] is not None,
                sentence=state["sentence"],
            )


def _plan(plan: dict[str, Any] | None) -> tuple[str, str] | None:
    return None if not plan or plan["action"] is None else (plan["action"], plan["sentence"])
