"""An edge with a certificate for its own asset means harm: other assets' readings go on.

Over TLS, with the keys of a site. The hostile edge sends what the schemas allow, each number at
its bounds and each list at its longest, and answers the server's questions with more of it.
"""

import contextlib
import itertools
import json
import threading
import time

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES, HEALTH, alive_key, request_key
from slowtime_services.bus import ZenohBus
from slowtime_services.credentials import Authority, Credentials
from tests.fuzz.extremes import KINDS, base, let_in
from tests.system.conftest import free_port
from twin_server.persist import SqliteStore
from twin_server.pipeline import Pipeline
from twin_server.settings import TwinSettings

pytestmark = [pytest.mark.system]

WITHIN_S = 2.0
"""Within which a reading of another asset is durable, whatever a hostile edge has sent [s]."""
BESIDE_ALONE = 4.0
"""The same over the longest time of a reading before, where a machine is slow by itself [1]."""
FAR = 2**40 - 1


def eventually(condition, timeout_s=120.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


class Site:
    """A twin server behind a router that lets each edge speak for its own asset alone."""

    def __init__(self, home, stack):
        self._stack, self._authority = stack, Authority.open(home / "keys", "lab")
        for role in ("router", "server"):
            self._authority.issue(role, hosts=["127.0.0.1"])
        for asset in ("honest", "hostile"):  # before the router, which reads who may what
            self._authority.issue("edge", asset)
        self._here = f"tls/127.0.0.1:{free_port()}"
        options = Credentials.read(self._authority.home / "router").router_options()
        self._keep(ZenohBus("router", listen=[self._here], options=options))
        self.store = SqliteStore(home / "twin.sqlite", synchronous="NORMAL")
        stack.callback(self.store.close)
        healing = {"grace_s": 0.05, "backoff_s": 0.05, "max_backoff_s": 0.5, "tries": 2}
        self.pipeline = Pipeline(
            TwinSettings(healing=healing), self.store, bus=self._join("server")
        )
        self.pipeline.start()
        stack.callback(self.pipeline.stop)

    def edge(self, asset):
        bus = self._join(f"edge-{asset}")
        assert eventually(lambda: bus.connected)
        return bus

    def _join(self, folder):
        options = Credentials.read(self._authority.home / folder).client_options()
        return self._keep(
            ZenohBus("client", [self._here], options=options, open_timeout_s=60.0)
        )

    def _keep(self, bus):
        self._stack.callback(bus.close)
        return bus


class Honest:
    """An edge that sends a reading whenever it is told to, and keeps an account."""

    def __init__(self, site, asset="honest"):
        self._site, self._asset, self._bus = site, asset, site.edge(asset)
        self._kept: dict[int, bytes] = {}
        self._bus.answer(request_key("lab", asset, "account"), self._account)
        self._bus.answer(request_key("lab", asset, "features"), self._again)
        self._bus.announce(alive_key("lab", asset))
        self.alone_s = self.longest_s = 0.0

    @property
    def is_held_up(self):
        return self.longest_s > max(WITHIN_S, BESIDE_ALONE * self.alone_s)

    def measure_alone(self):
        """Send readings before anything hostile is sent."""
        for _ in range(30):
            self.goes_on()
        self.alone_s, self.longest_s = self.longest_s, 0.0

    def goes_on(self, timeout_s=120.0):
        """Send a reading; note how long it takes until it is durable."""
        sequence, now_ns = len(self._kept), time.time_ns()
        message = Features(
            site="lab", asset=self._asset, boot="b1", sequence=sequence, t_ns=now_ns,
            start_ns=now_ns, slow_time=float(sequence), method="ambient",
            modes=(
                Mode(
                    frequency_hz=Quantity(value=3.0, sd=0.002),
                    damping_ratio=Quantity(value=0.02, sd=0.001),
                ),
            ),
            quality=Quality(samples=1000),
        )  # fmt: skip
        self._kept[sequence] = payload = encode(message)
        began_s = time.monotonic()
        self._bus.publish(FEATURES.key("lab", self._asset), payload, encoding=FEATURES.encoding)
        due = f"lab.{self._asset}"
        assert eventually(lambda: self._site.store.count(due) > sequence, timeout_s)
        took_s = time.monotonic() - began_s
        self.longest_s = max(self.longest_s, took_s)
        return took_s

    def _account(self, query):
        yield (
            query.key,
            json.dumps({"boot": "b1", "first": 0, "last": len(self._kept) - 1}).encode(),
        )

    def _again(self, query):
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        for sequence, payload in list(self._kept.items()):
            if first <= sequence <= last:
                yield FEATURES.key("lab", self._asset), payload


class Hostile:
    """An edge that sends and answers what its schema allows and nobody means."""

    def __init__(self, site, asset="hostile"):
        self._asset, self._bus = asset, site.edge(asset)
        self.key = {stream.name: stream.key("lab", asset) for stream in KINDS}
        self.asked = 0
        answers = itertools.cycle(
            [
                {"boot": "b1", "first": 0, "last": FAR},
                {"boot": "b1", "first": FAR, "last": FAR},
                {"boot": "b1", "first": 2**31, "last": 2**32},
                {"boot": "b1", "first": -1, "last": 2**70},
                {"boot": "b1", "first": 0, "last": FAR, "damaged": [[0, FAR]] * 20_000},
                {"boot": "x" * 500_000, "first": 0, "last": 1},
            ]
        )
        self._answers = answers
        self._bus.answer(request_key("lab", asset, "account"), self._account)
        self._bus.answer(request_key("lab", asset, "features"), self._again)
        self._bus.announce(alive_key("lab", asset))
        self.given: list[bytes] = []

    def say(self, stream, payload):
        self.given = [*self.given[-20:], payload]
        self._bus.publish(self.key[stream.name], payload, encoding=stream.encoding)

    def ordinary(self, stream, sequence=0, **more):
        content = base(stream, time.time_ns(), asset=self._asset, boot="b1", sequence=sequence)
        return json.dumps(content | more).encode()

    def _account(self, query):
        self.asked += 1
        yield query.key, json.dumps(next(self._answers)).encode()
        for number in range(2_000):
            entry = {"boot": f"l{number}", "first": FAR - number, "last": FAR}
            yield query.key, json.dumps(entry).encode()

    def _again(self, query):
        for payload in self.given * 10:
            yield self.key["features"], payload


@pytest.fixture
def site(tmp_path):
    with contextlib.ExitStack() as stack:
        yield Site(tmp_path, stack)


@pytest.mark.parametrize("last", [2**62, FAR, 10**6 + 1], ids=["2^62", "2^40 - 1", "a million"])
def test_a_stated_end_far_ahead_stops_no_other_asset(site, last):
    honest, hostile = Honest(site), Hostile(site)
    hostile.say(FEATURES, hostile.ordinary(FEATURES))
    assert eventually(lambda: site.store.count("lab.hostile"))
    honest.measure_alone()
    hostile.say(HEALTH, hostile.ordinary(HEALTH, last_sequence=last))
    hostile.say(FEATURES, hostile.ordinary(FEATURES, FAR, boot="b2"))
    ends_s = time.monotonic() + 5.0
    while time.monotonic() < ends_s:
        honest.goes_on(timeout_s=20.0)
    print(f"at most {honest.longest_s:.3f} s, alone {honest.alone_s:.3f} s")
    assert not honest.is_held_up
    lost = [e for e in site.store.events("lab.hostile") if "features_lost" in e.body]
    assert all(json.loads(e.body)["details"]["last"] <= 10**6 + 1 for e in lost)
    began_s = time.monotonic()
    site.pipeline.stop()
    assert time.monotonic() - began_s < 10.0


@pytest.mark.long
@pytest.mark.parametrize("stream", KINDS, ids=lambda stream: stream.name)
def test_two_hundred_valid_messages_of_a_kind_stop_no_other_asset(site, stream):
    honest, hostile = Honest(site), Hostile(site)
    hostile.say(FEATURES, hostile.ordinary(FEATURES))
    assert eventually(lambda: site.store.count("lab.hostile"))
    honest.measure_alone()

    def ordinary(number):
        return base(stream, time.time_ns(), asset="hostile", boot="b1", sequence=number + 1)

    messages = let_in(stream, ordinary, 200)
    assert len(messages) == 200
    pause = threading.Event()
    sending = threading.Thread(
        target=lambda: [hostile.say(stream, m) for m in messages if not pause.wait(0.01)]
    )
    sending.start()
    while sending.is_alive():
        honest.goes_on()
    for _ in range(20):
        honest.goes_on()
    sending.join()
    print(
        f"{stream.name}: a reading of another asset took {honest.longest_s:.3f} s at most, "
        f"{honest.alone_s:.3f} s before"
    )
    assert not honest.is_held_up
    assert site.pipeline.counts["failed_batches"] == 0
