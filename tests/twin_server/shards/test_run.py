"""What a fleet of shards refuses to start with."""

import multiprocessing
import sys
import types

import pytest

from twin_server.serve.access import NotSecuredError
from twin_server.serve.access.guard import check_secured
from twin_server.settings import ShardSettings, TwinSettings
from twin_server.shards import begun, run
from twin_server.shards.process import settings_of
from twin_server.shards.ray_driver import Driver


@pytest.fixture
def ahead(monkeypatch):
    """What is begun before the settings are there."""
    module, done = sys.modules["twin_server.shards.run"], list[str]()
    ours, theirs = multiprocessing.Pipe()

    def begin_driver(engine, count, level, form):
        done.append(f"{count} by {engine}")
        return Driver(multiprocessing.Process(), ours)

    monkeypatch.setattr(module, "load_ahead", lambda: done.append("loading"))
    monkeypatch.setattr(module, "begin_driver", begin_driver)
    monkeypatch.setitem(sys.modules, "ray", types.ModuleType("ray"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    yield done, ours
    ours.close()
    theirs.close()


@pytest.mark.parametrize("count", [None, 1])
def test_a_single_server_begins_nothing_ahead(ahead, count):
    with begun(count, "ray") as driver:
        assert driver is None
    assert ahead[0] == []


def test_code_of_local_shards_is_loaded_beside_that_of_the_front(ahead):
    with begun(2, None) as driver:
        assert driver is None
    assert ahead[0] == ["loading"]


def test_a_driver_of_ray_is_begun_ahead_and_ends_with_the_command(ahead):
    done, ours = ahead
    with begun(2, "ray") as driver:
        assert driver is not None
        assert driver.pipe is ours
        assert not ours.closed
    assert done == ["2 by ray"]
    assert ours.closed


def test_an_engine_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="engine"):
        TwinSettings(port=0, shards={"count": 2, "engine": "slurm"})


def test_without_ray_its_engine_is_refused_with_how_to_install_it(caplog, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert run(TwinSettings(port=0, shards={"count": 2, "engine": "ray"})) == 2
    assert "--engine ray was given" in caplog.text
    assert "pip install 'slowtime[ray]'" in caplog.text


def test_shards_on_several_nodes_need_a_database_that_all_reach(caplog, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", types.ModuleType("ray"))
    shards = {"count": 2, "engine": "ray://head:10001"}
    assert run(TwinSettings(port=0, database="twin.sqlite", shards=shards)) == 2
    assert "--database twin.sqlite were given" in caplog.text
    assert "Allowed: a PostgreSQL" in caplog.text


def test_only_a_shard_with_the_secret_of_its_fleet_listens_beyond_its_machine():
    elsewhere = TwinSettings(host="192.0.2.1", shards={"count": 2, "index": 0})
    with pytest.raises(NotSecuredError):
        check_secured(elsewhere)
    front = TwinSettings(host="192.0.2.1", shards={"count": 2, "key": "secret"})
    with pytest.raises(NotSecuredError):
        check_secured(front)
    check_secured(
        TwinSettings(host="192.0.2.1", shards={"count": 2, "index": 0, "key": "secret"})
    )


def test_strangers_are_kept_out_as_by_a_single_server(caplog):
    assert run(TwinSettings(host="0.0.0.0", port=0, shards={"count": 2})) == 2
    assert "no authentication" in caplog.text


def test_a_shard_beyond_the_last_is_refused():
    with pytest.raises(ValueError, match=r"index 2 was given, .* Allowed: 0 to 1"):
        ShardSettings(count=2, index=2)


def test_a_shard_listens_on_loopback_with_the_access_control_of_the_fleet(tmp_path):
    fleet = TwinSettings(
        host="0.0.0.0",
        tls={"certificate": tmp_path / "c.pem", "key": tmp_path / "k.pem"},
        access={"tokens": tmp_path / "tokens.json", "published_on_loopback": True},
        serve={"workers": 6},
        shards={"count": 4},
    )
    shard = settings_of(fleet, 3)
    assert (shard.host, shard.port, shard.tls) == ("127.0.0.1", 0, None)
    assert shard.access.tokens == tmp_path / "tokens.json"
    assert shard.serve.workers == 1
    assert (shard.shards.index, shard.shards.count) == (3, 4)
