"""Twins keep their outlooks, score them, and widen where they were too sure."""

import json

import numpy as np
import pytest

from slowtime.evolution.forecasting import verification
from twin_server.estimate.forecast.statements import KEPT, is_due
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline, TwinKnowledge
from twin_server.pipeline.analysis.past_outlooks import keys_of
from twin_server.registration.thresholds import Limit
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings

TWIN, LIMIT = "lab.beam", -0.2
BEAM = Registration.model_validate(
    {
        "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
        "alarms": [{"quantity": "stiffness_change", "below": LIMIT}],
        "forecast": {"horizon": 12.0},
        "limit_states": [
            {
                "kind": "threshold",
                "name": "soft",
                "quantity": "stiffness_change",
                "below": LIMIT,
            }
        ],
    }
)


@pytest.fixture
def opened(tmp_path):
    """Open the knowledge of a server over a store, as often as asked."""
    stores = []

    def start(name="twin"):
        store = SqliteStore(tmp_path / f"{name}.sqlite")
        stores.append(store)
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.register(TWIN, BEAM)
        return TwinKnowledge(pipeline, store), pipeline, store

    yield start
    for store in stores:
        store.close()


def told(knowledge, at=None):
    return knowledge.outlook(TWIN, None, 5, [Limit("stiffness_change", LIMIT, "below")], at)


def stated(store):
    return [(row.slow_time, row.body) for row in store.outlooks(TWIN)]


def test_outlooks_are_kept_at_the_same_readings_with_the_same_bytes_however_they_come(
    opened, ageing, sample
):
    messages = [sample(message) for message in ageing(73, loss=0.3)]
    found = []
    for name, portion in (("one", 9), ("all", 73)):
        knowledge, pipeline, store = opened(name)
        for first in range(0, 73, portion):
            pipeline.ingest(messages[first : first + portion])
            if first > 10 or portion == 73:
                told(knowledge)
                knowledge.prospects.keep_outlooks(TWIN)
        found.append(stated(store))
    assert found[0] == found[1]
    assert [time for time, _ in found[0]] == [float(n) for n in range(73) if is_due(n)]
    last = json.loads(found[0][-1][1])
    # What was stated is what whoever had asked then would have been told.
    then = told(knowledge, at=type("At", (), {"t_ns": None, "slow_time": 72.0})())
    (_, life), stated_then = then.crossings[0], last["crossings"][0]
    assert (stated_then["within"], last["since"]) == (life.within, then.since)
    assert last["horizon"] == then.horizon == 84.0


def test_scores_count_what_later_readings_show(opened, ageing, sample):
    knowledge, pipeline, store = opened()
    pipeline.ingest([sample(message) for message in ageing(73, loss=0.3)])
    told(knowledge)
    knowledge.prospects.keep_outlooks(TWIN)
    record = knowledge.track_record(TWIN)
    outlooks = [json.loads(row.body) for row in store.outlooks(TWIN)]
    assert (record["kept"], record["since"]) == (len(outlooks), 72.0)
    # The ageing passes the limit for good, near the slow time that its line says.
    history = store.history(TWIN)
    line = np.polyfit(history.states["slow_time"], history.states["stiffness_change"][:, 0], 1)
    passes = (LIMIT - line[1]) / line[0]
    decided = [one for one in outlooks[:-1] if one["horizon"] <= 72.0]
    open_then = [one for one in decided if one["crossings"][0]["already"] <= 0.5]
    thresholds = record["thresholds"]
    assert thresholds["count"] == len(open_then)
    expected = sum(one["since"] < passes <= one["horizon"] for one in open_then)
    assert abs(thresholds["came_true"] - expected) <= 1
    assert 0.0 <= thresholds["brier"] < 0.25
    assert 1.0 <= thresholds["effective"] < thresholds["count"]
    coverage = {
        one["stated"]: one for one in record["quantities"]["stiffness_change"]["coverage"]
    }
    assert coverage[0.5]["held"] <= coverage[0.8]["held"] <= coverage[0.95]["held"]
    targets = [
        at
        for one in outlooks[:-1]
        for at in one["quantities"]["stiffness_change"]["instants"]
        if at <= 72.0
    ]
    assert coverage[0.95]["count"] == len(targets)
    assert knowledge.track_record("lab.none")["kept"] == 0


def test_a_twin_that_was_too_sure_widens_all_that_it_tells_and_says_so(
    opened, ageing, sample, monkeypatch
):
    monkeypatch.setattr(
        verification, "widening_of", lambda *_: verification.Widening(1.6, 0.97, 4.0)
    )
    knowledge, pipeline, store = opened()
    pipeline.ingest([sample(message) for message in ageing(60, loss=0.168)])
    before, risk_before = told(knowledge), knowledge.risk(TWIN, None)
    knowledge.prospects.keep_outlooks(TWIN)
    after, risk = told(knowledge), knowledge.risk(TWIN, None)
    assert after.widening == {"stiffness_change": 1.6}
    ratio = after.bands["stiffness_change"][:, 1] / before.bands["stiffness_change"][:, 1]
    np.testing.assert_allclose(ratio, 1.6, rtol=1e-9)
    np.testing.assert_allclose(
        after.bands["stiffness_change"][:, 0], before.bands["stiffness_change"][:, 0]
    )
    within = after.crossings[0][1].within
    assert within != before.crossings[0][1].within
    assert risk["limit_states"][0]["within"]["value"] == pytest.approx(within, abs=1e-12)
    assert risk != risk_before
    assert any("1.60 times wider" in one for one in knowledge.track_record(TWIN)["sentences"])
    # After a restart too; and a forecast of the past is as wide as it was told then.
    again = TwinKnowledge(Pipeline(TwinSettings(), store), store)
    np.testing.assert_array_equal(
        told(again).bands["stiffness_change"], after.bands["stiffness_change"]
    )
    early = told(again, at=type("At", (), {"t_ns": None, "slow_time": 14.0})())
    assert early.widening == {}


def test_a_rewritten_history_states_anew_and_no_more_than_some_are_kept(opened, ageing, sample):
    knowledge, pipeline, store = opened()
    pipeline.ingest([sample(message) for message in ageing(40)])
    told(knowledge)
    assert knowledge.prospects.keep_outlooks(TWIN, 4)
    assert len(stated(store)) == 4
    knowledge.prospects.keep_outlooks(TWIN)
    assert len(stated(store)) == sum(is_due(n) for n in range(40))
    keys = keys_of(store.history(TWIN))
    assert [row.id for row in store.outlooks(TWIN)] == [k for k in keys if is_due(k & 0xFFFF)]
    assert BEAM.nominal is not None
    changed = BEAM.model_copy(
        update={"nominal": BEAM.nominal.model_copy(update={"damping_ratio": 0.03})}
    )
    pipeline.register(TWIN, changed)
    assert stated(store) == []
    assert not knowledge.prospects.keep_outlooks(TWIN)
    told(knowledge)
    knowledge.prospects.keep_outlooks(TWIN)
    assert 0 < len(stated(store)) <= KEPT
