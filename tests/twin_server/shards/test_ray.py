"""Shards as actors of Ray: killed, or with their node, they lose and double nothing."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from slowtime_services.bus import ZenohBus
from slowtime_services.client import AnswerError, Client
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings
from twin_server.shards import run

ray = pytest.importorskip("ray", reason="no Ray: pip install 'slowtime[ray]'")
pytestmark = [
    pytest.mark.slow,
    # Ray leaves sockets and processes to the end of the interpreter.
    pytest.mark.filterwarnings("default"),
]

ASSETS = tuple(f"mast-{number}" for number in range(6))
COUNT, EACH = 2, 40


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def endpoint():
    here = f"tcp/127.0.0.1:{free_port()}"
    with ZenohBus("router", listen=[here]):
        yield here


@contextlib.contextmanager
def fleet(database, endpoint, engine):
    """A fleet of two actors; gives its client and what runs them."""
    stop, told = threading.Event(), []
    settings = TwinSettings(
        port=0,
        database=database,
        connect=(endpoint,),
        healing={"grace_s": 0.05, "max_backoff_s": 1.0},
        shards={"count": COUNT, "engine": engine},
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
        ((url, shards),) = told
        yield Client(url), shards
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def messages(features):
    rng = np.random.default_rng(20261128)
    return [
        features(turn, asset=asset, frequency_hz=3.0 + 0.004 * rng.standard_normal())
        for turn in range(EACH)
        for asset in ASSETS
    ]


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


def published(endpoint, edge, messages, harm):
    """Publish all messages, and do harm in the middle; give the edges, which keep them."""
    bus = ZenohBus("client", [endpoint])
    edges = {asset: edge(bus, asset=asset) for asset in ASSETS}
    for place, message in enumerate(messages):
        edges[message.asset].make(message)
        if place == len(messages) // 2:
            harm()
        time.sleep(0.02)
    return bus


def recovery_s(shards, index, before, eventually):
    """Time from now until a shard answers elsewhere or anew [s]."""
    begun = time.monotonic()
    assert eventually(lambda: shards.place(index) not in (None, before), 300)
    return time.monotonic() - begun


def test_a_killed_actor_is_started_again_and_continues(
    tmp_path, endpoint, messages, sample, edge, eventually, capsys
):
    wanted = expected(tmp_path, messages, sample)
    with fleet(tmp_path / "twin.sqlite", endpoint, "ray") as (client, shards):
        assert eventually(client.ready, 300)
        places = [shards.place(index) for index in range(COUNT)]
        assert len({place.pid for place in places}) == COUNT

        def kill():
            os.kill(places[0].pid, signal.SIGKILL)

        with published(endpoint, edge, messages, kill):
            took_s = recovery_s(shards, 0, places[0], eventually)
            assert eventually(lambda: found(client) == wanted, 300)
        assert shards.restarts == 1
        assert shards.place(1) == places[1]
        with capsys.disabled():
            print(
                f"\nactor killed: answered again at most {took_s:.1f} s after the last message"
            )


@pytest.fixture
def cluster(monkeypatch):
    """A cluster of a head without cores and two nodes, each a raylet of this machine."""
    from ray.cluster_utils import Cluster

    port = free_port()
    head = {"num_cpus": 0, "ray_client_server_port": port}
    made = Cluster(initialize_head=True, head_node_args=head)
    nodes = {}
    for _ in range(2):
        node = made.add_node(num_cpus=COUNT)
        nodes[node.node_id] = node
    made.wait_for_nodes()
    monkeypatch.setenv("RAY_ADDRESS", made.address)
    yield made, nodes, f"ray://127.0.0.1:{port}"
    made.shutdown()


def test_a_shard_of_a_lost_node_is_started_on_another_and_continues(
    tmp_path, postgres, cluster, endpoint, messages, sample, edge, eventually, capsys
):
    made, nodes, _ = cluster
    wanted = expected(tmp_path, messages, sample)
    with fleet(postgres, endpoint, "ray:auto") as (client, shards):
        assert eventually(client.ready, 300)
        places = [shards.place(index) for index in range(COUNT)]
        assert {place.node for place in places} == set(nodes)  # spread over both

        def lose():
            made.remove_node(nodes[places[0].node], allow_graceful=False)
            with contextlib.suppress(ProcessLookupError):
                os.kill(places[0].pid, signal.SIGKILL)  # as the node's power goes

        with published(endpoint, edge, messages, lose):
            took_s = recovery_s(shards, 0, places[0], eventually)
            assert eventually(lambda: found(client) == wanted, 300)
        assert shards.place(0).node == places[1].node
        with capsys.disabled():
            print(f"\nnode lost: answered again at most {took_s:.1f} s after the last message")


def test_a_killed_actor_is_started_again_where_the_cluster_is_reached_by_its_client_port(
    tmp_path, postgres, cluster, endpoint, messages, sample, edge, eventually
):
    pytest.importorskip("grpc", reason="no grpcio: pip install 'slowtime[ray]'")
    *_, address = cluster
    wanted = expected(tmp_path, messages, sample)
    with fleet(postgres, endpoint, address) as (client, shards):
        assert eventually(client.ready, 300)
        places = [shards.place(index) for index in range(COUNT)]
        with published(
            endpoint, edge, messages, lambda: os.kill(places[1].pid, signal.SIGKILL)
        ):
            recovery_s(shards, 1, places[1], eventually)
            assert eventually(lambda: found(client) == wanted, 300)
        assert shards.place(0) == places[0]


@pytest.fixture
def restartable(monkeypatch):
    """A cluster with fixed ports, that a supervisor starts again: gives it, and a new one."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_gcs_rpc_server_reconnect_timeout_s", "5")
    ports = {"gcs_server_port": free_port(), "ray_client_server_port": free_port()}
    clusters = []

    def begin():
        made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, **ports})
        made.add_node(num_cpus=COUNT)
        clusters.append(made)
        monkeypatch.setenv("RAY_ADDRESS", made.address)
        return made

    yield begin, f"ray://127.0.0.1:{ports['ray_client_server_port']}"
    for made in clusters:
        made.shutdown()


def kill_processes(node):
    """Kill all processes that Ray runs for a node, as the loss of its machine does."""
    for infos in node.all_processes.values():
        for info in infos:
            info.process.kill()


@pytest.mark.parametrize("by", ["ray:auto", "client port"])
def test_a_cluster_whose_head_was_killed_is_joined_again_and_shards_continue(
    tmp_path, postgres, restartable, endpoint, messages, sample, edge, eventually, capsys, by
):
    begin, address = restartable
    first = begin()
    wanted = expected(tmp_path, messages, sample)
    with fleet(postgres, endpoint, address if by != "ray:auto" else by) as (client, shards):
        assert eventually(client.ready, 300)
        places = [shards.place(index) for index in range(COUNT)]

        def lose():
            kill_processes(first.head_node)
            time.sleep(1.0)
            begin()  # as the supervisor of the cluster does

        with published(endpoint, edge, messages, lose):
            begun = time.monotonic()
            assert eventually(lambda: shards.rejoined > 0, 300)
            for index, before in enumerate(places):
                recovery_s(shards, index, before, eventually)
            took_s = time.monotonic() - begun
            assert eventually(lambda: found(client) == wanted, 300)
            assert eventually(client.ready, 60)
        with capsys.disabled():
            print(
                f"\nhead killed ({by}): shards answered from the new cluster at most "
                f"{took_s:.1f} s after the last message"
            )


def test_a_signal_ends_the_command_cleanly_after_ray_has_taken_it(tmp_path, eventually):
    port = free_port()
    words = ["twin", "--shards", "2", "--engine", "ray", "--port", str(port)]
    words += ["--database", str(tmp_path / "twin.sqlite"), "--connect", "tcp/127.0.0.1:1"]
    with subprocess.Popen([sys.executable, "-m", "slowtime_cli", *words]) as command:
        client = Client(f"http://127.0.0.1:{port}")

        def lists_twins():
            with contextlib.suppress(AnswerError, OSError):
                return client.twins() == []
            return False

        assert eventually(lists_twins, 300)
        command.terminate()
        assert command.wait(60) == 0
