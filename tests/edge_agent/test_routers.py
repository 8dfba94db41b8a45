"""An agent of a site with several routers: it uses one, and another when that one dies."""

import socket
import subprocess
import sys
import time

import pytest

from edge_agent.__main__ import _bus, own_order
from edge_agent.settings import EdgeSettings
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import ZenohBus
from slowtime_services.clock import SystemClock

KEY = FEATURES.key("demo", "tower")


@pytest.fixture
def free_port():
    """Ports that nobody has."""

    def port():
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            return taken.getsockname()[1]

    return port


def eventually(condition, timeout_s=60.0):
    """Whether a condition becomes true in good time."""
    deadline = time.monotonic() + timeout_s
    while not (holds := condition()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return holds


def start_router(own, *others):
    """A router in a process of its own, which listens."""
    script = (
        "import sys, threading\n"
        "from slowtime_services import router\n"
        "router.run([sys.argv[1]], sys.argv[2:], ready=lambda where: print('up', flush=True))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, own, *others], stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"up\n"
    return process


@pytest.fixture
def routers(free_port):
    """Two routers that are joined: processes by endpoint."""
    first, second = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    running = {first: start_router(first)}
    running[second] = start_router(second, first)
    yield running
    for process in running.values():
        process.kill()
        process.wait(30)
        process.stdout.close()


@pytest.mark.long
def test_an_agent_sends_once_and_goes_on_by_the_other_router_when_its_own_is_killed(
    routers,
):
    settings = EdgeSettings(connect=tuple(routers))
    own, other = own_order(settings.connect, settings.asset)
    heard: list[bytes] = []
    with (
        ZenohBus("client", [other], open_timeout_s=30.0) as server,
        _bus(settings, {}, SystemClock()) as agent,
    ):
        server.subscribe(KEY, lambda sample: heard.append(sample.payload))

        def arrives(payload):
            agent.publish(KEY, payload, encoding=FEATURES.encoding)
            return payload in heard

        assert eventually(lambda: arrives(b"first"))
        heard.clear()
        for number in range(100):
            agent.publish(KEY, b"%d" % number, encoding=FEATURES.encoding)
        assert eventually(lambda: b"99" in heard)
        assert [one for one in heard if one != b"first"] == [b"%d" % i for i in range(100)]
        routers[own].kill()
        routers[own].wait(30)
        assert eventually(lambda: arrives(b"after"))


def test_an_agent_without_any_router_listens_all_the_same(free_port):
    nobody = tuple(f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with _bus(EdgeSettings(connect=nobody), {}, SystemClock()) as agent:
        agent.publish(KEY, b"", encoding=FEATURES.encoding)
        assert not agent.connected


def test_assets_of_all_partitions_share_the_routers_evenly():
    routers = ("a", "b", "c")
    first = [own_order(routers, f"asset-{number}")[0] for number in range(900)]
    assert all(250 < first.count(router) < 350 for router in routers)
    assert set(own_order(routers, "x")) == set(routers)
