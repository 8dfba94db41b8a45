"""What a fleet of shards refuses to start with."""

import pytest

from twin_server.settings import ShardSettings, TwinSettings
from twin_server.shards import run
from twin_server.shards.process import settings_of


def test_an_engine_that_runs_no_shards_is_refused(caplog):
    assert run(TwinSettings(port=0, shards={"count": 2, "engine": "ray"})) == 2
    assert "--engine ray was given" in caplog.text
    assert "Allowed: local" in caplog.text


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
