"""A diagnosis in slow time: the history says what it follows, and the twin takes it in."""

import json
import subprocess
import sys

import numpy as np
import pytest

from slowtime_services.clock import HandClock
from twin_server.identity.principals import EVERYBODY
from twin_server.orders import DiagnosisOrder
from twin_server.persist import SqliteStore
from twin_server.pipeline import Diagnoses, Pipeline, TwinKnowledge
from twin_server.registration.twin import Registration
from twin_server.serve import ProblemError
from twin_server.settings import DiagnoseSettings, GapSettings, TwinSettings

COUNT, PER_K = 240, -0.002
ID = "lab.beam"


@pytest.fixture
def twin(tmp_path, features, sample):
    """A twin of a beam in the weather, whose weather it was not told of."""
    rng = np.random.default_rng(4)
    day = np.arange(COUNT)
    warmth = 10.0 * np.sin(day / 12.0) + rng.normal(0.0, 3.0, COUNT)
    frequency = 3.0 * np.sqrt(1.0 + PER_K * warmth) + 0.002 * rng.standard_normal(COUNT)
    messages = [
        features(i, frequency_hz=float(frequency[i])).model_copy(
            update={"covariates": {"temperature_c": float(warmth[i])}, "slow_time_unit": "d"}
        )
        for i in range(COUNT)
    ]
    store = SqliteStore(tmp_path / "twin.sqlite")
    pipeline = Pipeline(TwinSettings(connect=()), store, clock=HandClock(10**18))
    pipeline.start()
    pipeline.register(ID, Registration(nominal={"frequency_hz": 3.0, "damping_ratio": 0.02}))
    pipeline.ingest([sample(message, replayed=True) for message in messages])
    command = (sys.executable, "-m", "twin_server.diagnose")
    orders = Diagnoses(pipeline, store, DiagnoseSettings(), GapSettings(every_s=0.0), command)
    orders.start()
    yield pipeline, store, orders
    orders.stop()
    pipeline.stop()
    store.close()


@pytest.mark.slow
def test_what_the_history_follows_is_named_adopted_and_undone(twin, eventually):
    pipeline, store, orders = twin
    knowledge = TwinKnowledge(pipeline, store)
    registration = pipeline.twin(ID).registration
    number = orders.order(ID, registration, DiagnosisOrder(clock="slow"), EVERYBODY)
    assert eventually(lambda: orders.one(ID, number)["ended_ns"] is not None, 120.0)
    found = orders.one(ID, number)
    assert found["state"] == "done", found["error"]
    report = found["report"]
    (effect,) = report["effects"]
    assert effect["family"] == "temperature"
    assert effect["covariate"] == "temperature_c"
    assert "%/K" in report["sentence"]
    assert report["gap"]["augmented"] < 0.4 * report["gap"]["nominal"]
    assert b"temperature_c" in orders.file(number, "report.html")
    assert orders.file(number, "augmented.yaml") is None

    history, before = store.digest(ID), knowledge.outlook(ID, 20.0, 5)
    orders.adopt(ID, registration, number)
    adopted = pipeline.twin(ID).registration
    assert adopted.covariates.names == ("temperature_c",)
    assert 60 <= adopted.covariates.train_epochs < COUNT
    states = store.history(ID).states[adopted.covariates.train_epochs :]
    assert (states["reasons"] == 0).mean() > 0.95
    assert np.std(states["stiffness_change"][:, 0]) < 0.3 * 10.0 * abs(PER_K)
    after = knowledge.outlook(ID, 20.0, 5)
    assert before is not None
    assert after is not None
    band = [one.bands["stiffness_change"][:, 1].mean() for one in (before, after)]
    assert band[1] < 0.5 * band[0]

    orders.undo(ID, adopted, number)
    assert pipeline.twin(ID).registration == registration
    assert store.digest(ID) == history
    said = [json.loads(row.body)["kind"] for row in store.events(ID)]
    assert [kind for kind in said if kind in ("adopted", "undone")] == ["adopted", "undone"]


@pytest.mark.slow
def test_the_command_says_the_same_of_the_database_while_the_server_has_it(twin, tmp_path):
    _, store, _ = twin
    words = ["--history", str(store.path), "--twin", ID, "--out", str(tmp_path / "found")]
    done = subprocess.run(
        [sys.executable, "-m", "slowtime_cli", "diagnose", *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "found/report.json").read_text())
    assert (report["of"], report["clock"], report["slow_time_unit"]) == (ID, "slow", "d")
    (effect,) = report["effects"]
    assert (effect["family"], effect["covariate"]) == ("temperature", "temperature_c")


def test_what_follows_no_covariate_is_not_adopted(twin):
    pipeline, _, orders = twin
    registration = pipeline.twin(ID).registration
    with pytest.raises(ProblemError, match="found no effect"):
        orders.adopt(ID, registration, 1)
