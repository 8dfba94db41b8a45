"""Assets that nobody has registered: as many of a site as the settings allow."""

import contextlib
import json

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Health
from slowtime_schemas.streams import HEALTH
from slowtime_services.bus import MemoryBus, Sample
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.registration.twin import Registration
from twin_server.settings import TwinSettings


@contextlib.contextmanager
def listening(tmp_path, **more):
    with (
        contextlib.closing(SqliteStore(tmp_path / "twin.sqlite")) as store,
        MemoryBus() as bus,
    ):
        yield Pipeline(TwinSettings(**more), store, bus=bus), store


def test_assets_that_nobody_registered_are_limited_for_each_site(tmp_path, ageing, sample):
    limit = {"max_assets_of_site": 3}
    with listening(tmp_path, admission=limit) as (pipeline, _):
        pipeline.register("lab.known", Registration())
        messages = [ageing(1, asset=f"a{n}")[0] for n in range(10)]
        pipeline.ingest(map(sample, [*messages, ageing(1, asset="known")[0]]))
        assert pipeline.refusals.counts["too_many_assets"] == 7
        assert pipeline.gauges()["boots"] == 4
        elsewhere = [message.model_copy(update={"site": "hall"}) for message in messages[:2]]
        pipeline.ingest(map(sample, elsewhere))
        assert pipeline.gauges()["boots"] == 6


def test_health_of_assets_that_nobody_registered_is_limited_too(tmp_path):
    def health(asset):
        message = Health(
            site="lab", asset=asset, boot="b1", sequence=0, t_ns=1, last_sequence=5,
            first_held=0, uptime_s=1.0,
        )  # fmt: skip
        return Sample(HEALTH.key("lab", asset), encode(message), None, False)

    with listening(tmp_path, admission={"max_assets_of_site": 3}) as (pipeline, _):
        pipeline.ingest([health(f"a{n}") for n in range(10)])
        assert pipeline.refusals.counts["too_many_assets"] == 7
        assert pipeline.gauges()["boots"] == 3


def test_a_sensor_that_flaps_in_one_batch_takes_one_transaction(tmp_path, monkeypatch):
    def health(silent_s):
        message = Health(
            site="lab", asset="beam", boot="b1", sequence=0, t_ns=1, last_sequence=-1,
            first_held=-1, uptime_s=1.0, counters={"sensor_silent_s": silent_s},
        )  # fmt: skip
        return Sample(HEALTH.key("lab", "beam"), encode(message), None, False)

    with listening(tmp_path) as (pipeline, store):
        pipeline.register("lab.beam", Registration())
        written, write = [], store.write

        def noted(cut):
            written.append(cut)
            return write(cut)

        monkeypatch.setattr(store, "write", noted)
        pipeline.ingest([health(n % 2) for n in range(20)])
        assert len(written) == 1
        kinds = [json.loads(row.body)["kind"] for row in store.events("lab.beam")]
        assert kinds.count("sensor_silent") == kinds.count("sensor_back") + 1 == 10
