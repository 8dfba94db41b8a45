"""A plan that cannot be made is refused with what is missing, and made once it is there."""

import dataclasses

import pytest

from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.pipeline.analysis.forecast_cache import ForecastCache
from twin_server.pipeline.analysis.plans import NO_DECISION, TOO_FEW, PlanCache
from twin_server.pipeline.workers.processes import CallerThread
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

TWIN = "lab.beam"
BEAM = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}}
DECISION = {"failure": {"quantity": "stiffness_change", "below": -0.4}, "horizon": 60.0}


@pytest.fixture
def planned(tmp_path, sample):
    """Register a twin, let it read, and give its plan."""
    stores: list[SqliteStore] = []

    def made(messages, workers, **registration):
        store = SqliteStore(tmp_path / f"{len(stores)}.sqlite")
        stores.append(store)
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.register(TWIN, Registration.model_validate(BEAM | registration))
        pipeline.ingest(sample(message) for message in messages)
        prospects = ForecastCache(pipeline, store)
        return PlanCache(pipeline, store, prospects, workers).plan(TWIN)

    yield made
    for store in stores:
        store.close()


def costs(unit):
    """Costs by the day, or by another unit of time."""
    return {"currency": "EUR", "time_unit": unit, "failure": 900.0, "repair": 40.0}


class WithoutPace(CallerThread):
    """Computes as if clock and slow time did not rise together."""

    def run(self, function, /, twin_id, order, *more):
        return function(twin_id, dataclasses.replace(order, pace=None), *more)


def test_times_in_days_are_refused_while_no_calendar_is_known(planned, ageing):
    told = planned(ageing(30), WithoutPace(), costs=costs("d"), decision=DECISION)
    assert not told["valid"]
    assert told["reasons"] == [told["sentence"]]
    assert "costs.time_unit is 'd'" in told["sentence"]
    assert "give costs.time_unit='slow_time'" in told["sentence"]
    assert (told["id"], told["options"], told["action"]) == (TWIN, [], None)


def test_without_a_decision_or_readings_the_plan_says_what_is_needed(planned, ageing):
    assert planned(ageing(3), CallerThread())["sentence"] == NO_DECISION
    told = planned([], CallerThread(), costs=costs("d"), decision=DECISION)
    assert told["sentence"] == TOO_FEW
    assert not told["valid"]


def test_a_plan_tells_its_readings_and_the_forecast_that_it_is_made_of(planned, ageing):
    told = planned(ageing(300), CallerThread(), costs=costs("slow_time"), decision=DECISION)
    assert told["valid"]
    history, outlook, failure = told["history"], told["outlook"], told["failure"]
    assert 100 < len(history) <= 200
    assert history[-1]["ahead"] == 0.0
    assert history[-1]["ahead"] - history[0]["ahead"] > 100
    assert len(outlook) == len(told["times"])
    now = failure["estimate"]
    assert outlook[0]["value"] == pytest.approx(now["value"], abs=now["sd"])
    # A path has failed by the end where it is below the limit there.
    below = outlook[-1]["lo"] < failure["threshold"]
    assert below == (told["failure_probability"][-1] > 0.05)
    assert all(one["lo"] <= one["value"] <= one["hi"] for one in outlook)
