"""A thousand crossings, a receiver that fails half the time, and a server that is killed."""

import contextlib
import hashlib
import hmac
import json
import random
import tempfile
import time
from pathlib import Path

import pytest

from edge_agent.publish import Publisher, Spool
from edge_agent.settings import Origin, PublishSettings
from slowtime_services.bus import ZenohBus
from slowtime_services.clock import SystemClock
from tests import postgres
from tests.system.test_nothing_lost import features
from tests.twin_server.notify.conftest import Hook
from twin_server.persist import open_store

pytestmark = [pytest.mark.system, pytest.mark.long]

CROSSINGS = 1_000
SECRET = "a secret that is long enough"
REGISTRATION = {
    "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
    "alarms": [{"quantity": "stiffness_change", "below": -0.1}],
    "alarm_routes": [{"receiver": "ops"}],
    "confirm_readings": 1,
}


@pytest.fixture
def half():
    """A receiver that fails half the time, by chance."""
    chance = random.Random(7)
    made = Hook(lambda n: 204 if chance.random() < 0.5 else 503)
    yield made
    made.close()


def settings(house, hook):
    (house.home / "secret").write_text(SECRET)
    receiver = {"kind": "webhook", "url": hook.url, "secret_file": str(house.home / "secret")}
    path = house.home / "twin.json"
    path.write_text(
        json.dumps(
            {
                "alarms": {
                    "receivers": {"ops": receiver}, "backoff_s": 0.05, "max_backoff_s": 1.0,
                },
                "healing": {"grace_s": 0.02, "backoff_s": 0.05},
            }
        )
    )  # fmt: skip
    return path


@pytest.fixture(params=["sqlite", "postgres"])
def where(request, tmp_path):
    """Database of the house: a file, or a schema of a PostgreSQL."""
    if request.param == "sqlite":
        yield str(tmp_path / "history.sqlite")
        return
    with tempfile.TemporaryDirectory(prefix="slowtime-pg-") as folder:
        with postgres.server(Path(folder) / "pg") as url:
            yield postgres.schema_of(url, "alarms")


@contextlib.contextmanager
def agent(house):
    """An edge agent that keeps what is not acknowledged."""
    with ZenohBus("client", connect=(house.endpoint,)) as bus:
        publisher = Publisher(
            Origin(site="lab", asset="beam", boot="b1"), Spool(house.home / "spool", "b1"), bus,
            SystemClock(), PublishSettings(), software="slowtime 0", about={"processing": {}},
        )  # fmt: skip
        publisher.open()
        yield publisher
        publisher.close()


@pytest.mark.parametrize("seed", [1])
def test_each_of_a_thousand_crossings_is_delivered_over_a_kill_of_the_server(
    house, half, where, seed
):
    config = settings(house, half)
    more = ("--config", str(config), "--database", where)
    house.router()
    house.twin(*more)
    house.put("/api/v1/twins/lab.beam", REGISTRATION)
    kills = sorted(random.Random(seed).sample(range(200, 2 * CROSSINGS - 200), 2))
    began_ns = time.time_ns() - 10 * 10**9
    with agent(house) as publisher:
        for n in range(2 * CROSSINGS):
            message = features(
                n, t_ns=began_ns + n * 10**6, frequency_hz=3.0 if n % 2 == 0 else 2.0
            )
            publisher.features(message)
            if n in kills:
                wanted = min(n // 4, len(half.accepted) + 20)
                house.until(
                    lambda wanted=wanted: len(half.accepted) >= wanted,
                    "some alarms to be delivered",
                )
                house.kill("twin")
                house.twin(*more)
        route: dict[str, int] = {}

        def done():
            told = house.get("/api/v1/twins/lab.beam/alarms/deliveries?limit=1")
            route.update(told["routes"][0] if told else {})
            return route.get("delivered") == CROSSINGS

        house.until(done, "all alarms to be delivered")
    assert house.end("twin") == 0
    with contextlib.closing(open_store(where)) as store:
        rows = [json.loads(row.body) for row in store.events("lab.beam", limit=100_000)]
        kept = store.deliveries(twin="lab.beam", limit=100_000)
    alarms = [row for row in rows if row["kind"] == "alarm"]
    assert len(alarms) == CROSSINGS
    assert half.accepted.keys() == {row.event for row in kept}
    assert len(kept) == CROSSINGS
    sequences = {told["sequence"] for told in half.told}
    assert sequences == {row["sequence"] for row in alarms}
    # What was sent when the server died may come again, under the same identity.
    doubles = sum(half.accepted.values()) - CROSSINGS
    assert 0 <= doubles <= 32 * len(kills)
    failures = sum(status == 503 for *_, status in half.requests)
    assert 0.4 < failures / len(half.requests) < 0.6
    for _, headers, payload, _ in half.requests:
        signed = f"{headers['X-Slowtime-Timestamp']}.".encode() + payload
        right = hmac.new(SECRET.encode(), signed, hashlib.sha256).hexdigest()
        assert headers["X-Slowtime-Signature"] == f"v1={right}"
