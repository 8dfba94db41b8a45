"""The benchmark of shards divides the messages as shards do."""

from benchmarks.processes.shards import has
from benchmarks.processes.throughput import ASSETS
from slowtime_schemas.streams import FEATURES
from slowtime_services.shards import Share


def test_each_message_is_of_one_shard_and_each_shard_has_some():
    keys = [FEATURES.key("load", f"a{number}") for number in range(ASSETS)]
    owners = [[has(Share(index, 2), key) for index in range(2)] for key in keys]
    assert all(sum(one) == 1 for one in owners)
    assert 0.3 * ASSETS < sum(first for first, _ in owners) < 0.7 * ASSETS
    assert all(has(None, key) for key in keys)
