"""A server with a key signs what it accepts, and a recording can be held against it."""

import json

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.credentials import CredentialsError, make_key
from slowtime_services.record import Recorder
from slowtime_services.replay import read_recording, verdicts
from twin_server.persist import SqliteStore, audit_file, verify_file
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings


@pytest.fixture
def key(tmp_path):
    return tmp_path / "ledger.pem", make_key(tmp_path / "ledger.pem")


@pytest.fixture
def signing(tmp_path, key, eventually):
    """Let a server with a key accept some features and end; give the database."""

    def run(bus, messages):
        path = tmp_path / "twin.sqlite"
        settings = TwinSettings(ledger={"key": key[0], "every_s": 0.05})
        store = SqliteStore(path)
        pipeline = Pipeline(settings, store, bus=bus)
        pipeline.start()
        for message in messages:
            bus.publish(
                FEATURES.key("lab", message.asset), encode(message), encoding="application/json"
            )
        wanted = {message.twin_id for message in messages}
        assert eventually(
            lambda: sum(store.count(twin_id) for twin_id in wanted) >= len(messages)
        )
        pipeline.stop()
        store.close()
        return path

    return run


@pytest.fixture
def recorded(tmp_path, ageing, signing):
    """A recording of two assets beside a server that signs, and its database."""
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "house.mcap"):
        database = signing(bus, [*ageing(30), *ageing(20, asset="mast")])
    return tmp_path / "house.mcap", database


def test_what_a_server_signs_holds_in_its_database_and_in_a_recording(recorded, key):
    recording, database = recorded
    verify_file(database)
    found = audit_file(database, public=key[1])
    assert (found.wrong, found.waiting) == ([], 0)
    assert found.vouched > 52  # features and registrations, and the rows that follow
    told = verdicts(recording, key[1])
    assert {asset: one.vouched for asset, one in told.items()} == {
        "lab.beam": 30,
        "lab.mast": 20,
    }
    assert all(one.heads and not (one.wrong or one.waiting) for one in told.values())


def test_features_that_are_changed_in_a_recording_are_found(recorded, key, tmp_path):
    sent = list(read_recording(recorded[0]))
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "forged.mcap"):
        for message in sent:
            payload = message.payload
            told = json.loads(payload)
            if message.key == FEATURES.key("lab", "beam") and told["sequence"] == 17:
                told["modes"][0]["frequency_hz"]["value"] += 0.01
                payload = json.dumps(told).encode()
            bus.publish(message.key, payload, encoding="application/json")
    found = verdicts(tmp_path / "forged.mcap", key[1])
    assert "something is not as it was" in found["lab.beam"].wrong[0]
    assert found["lab.mast"].wrong == []


def test_a_recording_without_some_says_how_many_are_missing(recorded, key, tmp_path):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "part.mcap"):
        for message in read_recording(recorded[0]):
            told = json.loads(message.payload)
            if message.key != FEATURES.key("lab", "beam") or told["sequence"] not in (3, 4):
                bus.publish(message.key, message.payload, encoding="application/json")
    found = verdicts(tmp_path / "part.mcap", key[1])["lab.beam"]
    assert (found.wrong, found.missing) == ([], 2)


def test_heads_of_another_server_are_not_believed(recorded, tmp_path):
    other = make_key(tmp_path / "other.pem")
    found = verdicts(recorded[0], other)
    assert all("not signed with the server's key" in one.wrong[0] for one in found.values())


def test_a_server_goes_on_from_the_head_it_signed_last(tmp_path, ageing, signing, key):
    bus = MemoryBus()
    with Recorder(bus, tmp_path / "house.mcap"):
        signing(bus, ageing(25)[:10])
        database = signing(bus, ageing(25))
    found = audit_file(database, public=key[1])
    assert (found.wrong, found.waiting) == ([], 0)
    told = verdicts(tmp_path / "house.mcap", key[1])["lab.beam"]
    assert (told.wrong, told.vouched, told.waiting) == ([], 25, 0)


def test_a_key_that_others_may_read_is_refused(key, tmp_path):
    key[0].chmod(0o644)
    settings = TwinSettings(ledger={"key": key[0]})
    store = SqliteStore(tmp_path / "x.sqlite")
    with pytest.raises(CredentialsError, match="chmod 600"):
        Pipeline(settings, store)
    store.close()
