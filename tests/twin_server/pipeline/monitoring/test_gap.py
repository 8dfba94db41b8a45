"""The thread that compares models goes on, in bounded memory, whatever fails."""

import concurrent.futures
import itertools

import numpy as np
import pytest

from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import RAW
from slowtime_services.bus import Sample
from twin_server.persist import StoreError
from twin_server.pipeline import Pipeline
from twin_server.pipeline.monitoring.gap import GapMonitor
from twin_server.registration.twin import Registration
from twin_server.settings import GapSettings, TwinSettings

RATE, SAMPLES = 100.0, 600
MODEL = {
    "slowtime_model": 1,
    "nodes": [{"id": "m1", "mass_kg": 2.0}],
    "elements": [
        {
            "id": "j1", "between": ["base", "m1"],
            "stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 2.0,
        }
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": "a1", "quantity": "acceleration", "node": "m1", "unit": "m/s^2"}
    ],
}  # fmt: skip


class Refusing(concurrent.futures.Executor):
    """Fits nothing, and notes how many records it was given each time."""

    def __init__(self):
        self.given: list[int] = []

    def submit(self, function, /, *given, **options):
        self.given.append(len(given[1]))
        refused: concurrent.futures.Future[str] = concurrent.futures.Future()
        refused.set_exception(ValueError("The model cannot be fitted."))
        return refused


@pytest.fixture
def monitoring(store, monkeypatch):
    """A monitor of a rig that sends one epoch after the other, and what fits its model."""
    pipeline, workers, epochs = Pipeline(TwinSettings(), store), Refusing(), itertools.count()
    registration = Registration.model_validate({"changes": "stiffness", "model": MODEL})
    pipeline.register("lab.rig", registration)
    monkeypatch.setattr(pipeline, "is_alive", lambda twin_id: True)

    def newest(twin_id, seconds):
        epoch = next(epochs)
        header = RawHeader(
            site="lab", asset="rig", boot="b1", sequence=epoch, t_ns=(10 * epoch + 1) * 10**9,
            time_base="simulated", rate_hz=RATE, first_index=epoch * SAMPLES, dtype="<f4",
            samples=SAMPLES, channels=("a1", "u"), units=("m/s^2", "N"), epoch=epoch,
            slow_time=float(epoch),
        )  # fmt: skip
        payload = encode_raw(header, np.ones((SAMPLES, 2), "<f4").tobytes())
        return [Sample(RAW.key("lab", "rig"), payload, None, replayed=False)]

    settings = GapSettings(every_s=0.001, seconds=6.0, tune=2)
    monitor = GapMonitor(pipeline, store, settings, newest, lambda: workers)
    yield monitor, workers
    monitor.stop()


def test_a_model_that_cannot_be_fitted_keeps_no_more_records_than_its_fit_needs(
    monitoring, eventually
):
    monitor, workers = monitoring
    monitor.start()
    assert eventually(lambda: len(workers.given) >= 5)
    assert set(workers.given) == {2}


def test_comparing_goes_on_once_the_store_is_back(monitoring, eventually, store, monkeypatch):
    monitor, workers = monitoring
    asked: list[int] = []
    twins = store.twins

    def away():
        asked.append(len(asked))
        if len(asked) < 3:
            raise StoreError("The database is away.")
        return twins()

    monkeypatch.setattr(store, "twins", away)
    monitor.start()
    assert eventually(lambda: workers.given)
    assert len(asked) > 3
