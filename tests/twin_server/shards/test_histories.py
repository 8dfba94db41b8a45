"""A recording gives the same histories, whatever the number of shards."""

import contextlib
import math

import numpy as np
import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus, PartialBus
from slowtime_services.record import Recorder
from slowtime_services.replay import replay
from slowtime_services.shards import Share
from twin_server.persist import WrongStoreError, open_store
from twin_server.pipeline import Pipeline

ASSETS = tuple(f"mast-{number}" for number in range(12))
EACH = 40


@pytest.fixture
def recording(tmp_path, features):
    """Features of twelve assets, of two boots, some early, late or twice.

    None comes after the next boot of its asset has begun: it would be refused, or not, by
    whether a server had concluded the former boot yet.
    """
    rng = np.random.default_rng(36)
    messages, first_boot = [], 25
    for turn in range(EACH):
        for number, asset in enumerate(ASSETS):
            messages.append(
                features(
                    turn % first_boot, asset=asset, boot="b1" if turn < first_boot else "b2",
                    frequency_hz=3.0 + 0.1 * number + 0.004 * rng.standard_normal(),
                )
            )  # fmt: skip
    for place in rng.choice(len(messages) - 40, 60, replace=False):
        other = place + rng.integers(1, 40)
        if messages[place].boot == messages[other].boot:
            messages[place], messages[other] = messages[other], messages[place]
    for place in rng.choice(len(messages), 30, replace=False):
        messages.insert(place, messages[place])
    path = tmp_path / "fleet.mcap"
    with MemoryBus() as bus, Recorder(bus, path):
        for message in messages:
            key = FEATURES.key(message.site, message.asset)
            bus.publish(key, encode(message), encoding=FEATURES.encoding)
    return path


def settings_of(settings, share):
    shards = {} if share is None else {"count": share.count, "index": share.index}
    return settings.model_copy(
        update={"shards": type(settings.shards)(**shards), "auto_register": True}
    )


@contextlib.contextmanager
def running(database, settings, bus, shares):
    with contextlib.ExitStack() as stack:
        found = []
        for share in shares:
            store = stack.enter_context(contextlib.closing(open_store(database, share=share)))
            part = bus if share is None else PartialBus(bus, share.has)
            pipeline = Pipeline(settings_of(settings, share), store, bus=part)
            pipeline.start()
            stack.callback(pipeline.stop)
            found.append((pipeline, store))
        yield found


def digests(stores):
    """Digest of each asset, of the one store that has it."""
    found = {}
    for asset in ASSETS:
        (found[asset],) = (d for s in stores if (d := s.digest(f"lab.{asset}"))[1])
    return found


def replayed(recording, database, settings, count, eventually):
    shares = [None] if count == 1 else [Share(index, count) for index in range(count)]
    with MemoryBus() as bus, running(database, settings, bus, shares) as found:
        assert eventually(lambda: all(p._election.acknowledges for p, _ in found))
        played = replay(recording, bus, speed=math.inf)
        assert eventually(
            lambda: sum(p.counts["accepted"] for p, _ in found) == EACH * len(ASSETS)
        )
        assert played.acknowledged == played.features
        return digests([store for _, store in found])


def test_one_two_and_eight_shards_give_the_same_histories(
    recording, database, settings, eventually
):
    one = replayed(recording, database("one"), settings, 1, eventually)
    assert all(count == EACH for _, count in one.values())
    for count in (2, 8):
        found = replayed(recording, database(f"n{count}"), settings, count, eventually)
        assert found == one


def test_a_database_of_another_number_of_shards_is_not_opened(database):
    named = database("fleet")
    open_store(named, share=Share(0, 2)).close()
    with pytest.raises(WrongStoreError, match="history of 2 shards, and 3 shards were asked"):
        open_store(named, share=Share(0, 3))
    open_store(named, share=Share(1, 2)).close()


def test_a_database_of_a_single_server_is_not_divided(database):
    named = database("fleet")
    open_store(named).close()
    with pytest.raises(WrongStoreError, match="history of a single server"):
        open_store(named, share=Share(0, 2))


def test_a_single_server_does_not_begin_anew_beside_shards(tmp_path):
    open_store(tmp_path / "twin.sqlite", share=Share(0, 2)).close()
    with pytest.raises(WrongStoreError, match="--shards 2"):
        open_store(tmp_path / "twin.sqlite")


def test_shards_and_a_single_server_do_not_both_acknowledge(settings, tmp_path, eventually):
    shares = [Share(0, 2), Share(1, 2)]
    with (
        MemoryBus() as bus,
        running(tmp_path / "a.sqlite", settings, bus, shares) as both,
    ):
        assert eventually(lambda: all(p._election.acknowledges for p, _ in both))
        with running(tmp_path / "b.sqlite", settings, bus, [None]) as ((single, _),):
            assert eventually(lambda: single.trouble)
            assert not single._election.acknowledges
            assert all(p._election.acknowledges for p, _ in both)
