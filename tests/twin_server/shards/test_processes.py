"""Shards as processes: killed at random instants, they lose and double nothing."""

import contextlib
import logging
import os
import signal
import socket
import threading
import time

import numpy as np
import pytest

from slowtime_services.bus import ZenohBus
from slowtime_services.client import AnswerError, Client
from slowtime_services.shards import Share
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings
from twin_server.shards import run

ASSETS = tuple(f"mast-{number}" for number in range(6))
COUNT, EACH, KILLS = 2, 120, 5


@pytest.fixture
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        here = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with ZenohBus("router", listen=[here]):
        yield here


@contextlib.contextmanager
def fleet(tmp_path, endpoint):
    """A fleet of two shards; gives its client and supervisor."""
    stop, told = threading.Event(), []
    settings = TwinSettings(
        port=0,
        database=tmp_path / "twin.sqlite",
        connect=(endpoint,),
        healing={"grace_s": 0.05, "max_backoff_s": 1.0},
        shards={"count": COUNT},
        serve={"workers": 1},
    )
    thread = threading.Thread(
        target=run,
        args=(settings,),
        kwargs={"stop": stop, "ready": lambda *news: told.append(news)},
    )
    thread.start()
    try:
        while not told:
            assert thread.is_alive()
            time.sleep(0.05)
        ((url, supervisor),) = told
        yield Client(url), supervisor
    finally:
        stop.set()
        thread.join()


def expected(tmp_path, messages, sample):
    """Digests of a single server that nothing disturbed."""
    with contextlib.closing(open_store(tmp_path / "single.sqlite")) as store:
        pipeline = Pipeline(TwinSettings(), store)
        pipeline.ingest(map(sample, messages))
        return {asset: store.digest(f"lab.{asset}") for asset in ASSETS}


def found(client):
    """Digests as the front tells them; None of twins it cannot tell."""
    digests = {}
    for asset in ASSETS:
        with contextlib.suppress(AnswerError):
            told = client.digest(f"lab.{asset}")
            digests[asset] = (told.sha256, told.features)
    return digests


def kill(supervisor, index):
    pid = supervisor.pid(index)
    if pid is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.slow
def test_killed_shards_lose_and_double_nothing_and_leave_the_others_alone(
    tmp_path, endpoint, features, sample, edge, eventually, caplog
):
    caplog.set_level(logging.CRITICAL)
    rng = np.random.default_rng(20261128)
    messages = [
        features(turn, asset=asset, frequency_hz=3.0 + 0.004 * rng.standard_normal())
        for turn in range(EACH)
        for asset in ASSETS
    ]
    wanted = expected(tmp_path, messages, sample)
    assert all(count == EACH for _, count in wanted.values())
    kills = sorted(rng.choice(len(messages), KILLS, replace=False))
    with (
        fleet(tmp_path, endpoint) as (client, supervisor),
        ZenohBus("client", [endpoint]) as bus,
    ):
        assert eventually(client.ready, 120)
        edges = {asset: edge(bus, asset=asset) for asset in ASSETS}
        for place, message in enumerate(messages):
            edges[message.asset].make(message)
            if place in kills:
                kill(supervisor, place % COUNT)
            time.sleep(0.03)
        assert eventually(lambda: found(client) == wanted, 300)
        assert supervisor.restarts >= 2

        # One shard is dead: its twins are refused with a reason, the others are answered.
        kill(supervisor, 0)
        assert eventually(lambda: supervisor.url(0) is None, 10)
        of_others = {asset for asset in ASSETS if Share(1, COUNT).has(asset)}
        assert 0 < len(of_others) < len(ASSETS)
        assert set(found(client)) == of_others
        (lost, *_) = set(ASSETS) - of_others
        with pytest.raises(AnswerError, match="Shard 0 of 2 does not answer"):
            client.digest(f"lab.{lost}")
        later = [features(EACH, asset=asset) for asset in ASSETS]
        for message in later:
            edges[message.asset].make(message)
        assert eventually(lambda: client.digest(f"lab.{min(of_others)}").features == EACH + 1)
        (tmp_path / "single.sqlite").unlink()
        wanted = expected(tmp_path, messages + later, sample)
        assert eventually(lambda: found(client) == wanted, 300)
