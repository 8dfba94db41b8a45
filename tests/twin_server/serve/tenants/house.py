"""One server with the tokens of two sites, in this process, on a clock that is set by hand."""

import asyncio
import contextlib
import datetime
import itertools
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import httpx

from slowtime_schemas.codec import encode
from slowtime_schemas.streams import FEATURES
from slowtime_services.bus import MemoryBus
from slowtime_services.clock import HandClock
from slowtime_services.record import RecordingWriter
from tests.twin_server.conftest import ORIGIN_NS, Edge
from tests.twin_server.serve.conftest import PRETENDS
from twin_server.fairness import Holdings
from twin_server.persist import SqliteStore
from twin_server.pipeline import (
    Alarms,
    AssetEvents,
    ChangeHistory,
    CompositeRegistry,
    Diagnoses,
    LiveUpdates,
    Pipeline,
    QuarantineDesk,
    Recordings,
    TwinKnowledge,
)
from twin_server.serve import Hub, create_app
from twin_server.serve.access import TokenFile, guarded
from twin_server.settings import TwinSettings

SITES = ("lab", "plant")
CALLERS = ("viewer", "operator", "admin")
STEP_NS = 10**9
API = "/api/v1"
PLAYED = 40
"""Features of the recording that is played."""

PATIENCE_S = 120.0


class Passing(Hub):
    """Live streams that end once they have begun, so that a request has an end."""

    def join(self, twin_id: str) -> Any:
        """Watch, and no longer."""
        client = super().join(twin_id)
        if client is not None:
            client.end()
        return client


class Answer(NamedTuple):
    """One answer of the server, and what was asked."""

    method: str
    path: str
    asked: str
    status: int
    headers: tuple[tuple[str, str], ...]
    body: bytes


class House:
    """The server, its database and its recordings in a folder."""

    def __init__(self, home: Path) -> None:
        self.home, self.stack = home, contextlib.ExitStack()
        self.tokens = TokenFile(home / "tokens.json")
        day = datetime.timedelta(days=1)
        with _numbers_in_order():
            self.words = {
                (site, scope): self.tokens.add(scope, scope, [site], day)
                for site in SITES
                for scope in CALLERS
            }
            self.words["*", "admin"] = self.tokens.add("root", "admin", ["*"], day)
        pretends = home / "pretends.py"
        pretends.write_text(PRETENDS)
        self.clock = HandClock(ORIGIN_NS)
        self.bus = MemoryBus(clock=self.clock)
        self.edges: dict[str, Any] = {}
        self.store = SqliteStore(home / "twin.sqlite")
        settings = _settings(home, self.tokens.path)
        self.pipeline = Pipeline(settings, self.store, bus=self.bus, clock=self.clock)
        hub = Passing(99, 99, 99)
        self.pipeline.listen(LiveUpdates(hub))
        knowledge = TwinKnowledge(self.pipeline, self.store, bus=self.bus)
        self.recordings = Recordings(
            settings.diagnose.recordings,
            settings.recordings,
            lambda twin_id: self.pipeline.twin(twin_id) is not None,
            self.bus,
        )
        self.orders = Diagnoses(
            self.pipeline, self.store, settings.diagnose, settings.gap,
            [sys.executable, str(pretends)], bus=self.bus, clock=self.clock,
            recordings=self.recordings.folder,
        )  # fmt: skip
        holdings = Holdings()
        for quota in (
            self.recordings.uploads.quota, self.recordings.replays, self.orders.quota,
        ):  # fmt: skip
            holdings.add(quota)
        told = AssetEvents(self.pipeline, self.store, self.clock)
        app = create_app(
            knowledge, hub, settings.serve, self.orders, self.recordings,
            largest_recording=settings.recordings.max_bytes,
            alarm_service=Alarms(self.pipeline, self.store, self.clock),
            events=told,
            changes=ChangeHistory(self.pipeline, self.store, told),
            composite_service=CompositeRegistry(self.pipeline, self.store, self.clock),
            quarantine_service=QuarantineDesk(self.pipeline, self.store, self.clock),
            holdings=holdings,
        )  # fmt: skip
        self.document: dict[str, Any] = app.openapi()
        self.guard = guarded(settings).around(app)
        self.loop = asyncio.new_event_loop()
        self.client = httpx.AsyncClient(
            transport=httpx.ASGITransport(self.guard, raise_app_exceptions=False),
            base_url="http://127.0.0.1",
        )

    def __enter__(self) -> "House":
        self.pipeline.start()
        self.orders.start()
        return self

    def __exit__(self, *_: object) -> None:
        for edge in self.edges.values():
            edge.close()
        self.recordings.stop()
        self.orders.stop()
        self.pipeline.stop()
        self.loop.run_until_complete(self.client.aclose())
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()
        self.store.close()
        self.bus.close()

    def set_step(self, number: int) -> None:
        """Set the clock, so that what is done in a step has the same time in every run."""
        self.clock.set_ns(ORIGIN_NS + 10**12 + number * STEP_NS)

    def ask(
        self, site: str, scope: str | None, method: str, path: str, **more: Any
    ) -> httpx.Response:
        """Send one request with a token of a site."""
        headers = dict(more.pop("headers", {}))
        if scope is not None:
            headers["Authorization"] = f"Bearer {self.words[site, scope]}"
        self.client.cookies.clear()  # what `POST /session` leaves would stand in for a token
        whole = (
            path if path.startswith(("/api", "/healthz", "/readyz", "/metrics")) else API + path
        )
        return self.loop.run_until_complete(
            self.client.request(method, whole, headers=headers, **more)
        )

    def feed(self, messages: list[Any]) -> None:
        """Let an edge publish features, and wait until they are durable."""
        twin_id = f"{messages[0].site}.{messages[0].asset}"
        if twin_id not in self.edges:
            self.edges[twin_id] = Edge(self.bus, messages[0].site, messages[0].asset)
        for one in messages:
            self.edges[twin_id].make(one)
        last = messages[-1].sequence + 1
        self.until(lambda: self.store.count(twin_id) == last)

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something comes to be."""
        deadline = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < deadline
            time.sleep(0.02)


@contextlib.contextmanager
def _numbers_in_order() -> Iterator[None]:
    """Let tokens have the same numbers in each house: ids of events are made of them."""
    count = itertools.count(1)
    with mock.patch("secrets.token_hex", lambda size: f"{next(count):0{2 * size}x}"):
        yield


def recording(path: Path, messages: list[Any]) -> bytes:
    """Write features as a recorder would; its bytes."""
    with RecordingWriter(path) as writer:
        for one in messages:
            writer.write(FEATURES, one.site, one.asset, encode(one), one.t_ns)
    return path.read_bytes()


def _settings(home: Path, tokens: Path) -> TwinSettings:
    hook = {"kind": "webhook", "url": "http://127.0.0.1:9/x", "secret_env": "SECRET"}
    return TwinSettings(
        database=home / "twin.sqlite",
        connect=(),
        healing={"grace_s": 0.02, "backoff_s": 0.02, "foreign_patience_s": 0.2},
        access={"tokens": tokens, "failures_burst": 10**6, "burst": 10**6},
        diagnose={"recordings": home / "kept", "ask_timeout_s": 0.05, "max_queued": 4},
        recordings={"max_bytes": 60_000},
        gap={"every_s": 0.0},
        alarms={
            "simulated": True,
            "receivers": {"ops": hook}
            | {f"{site}-ops": hook | {"sites": [site]} for site in SITES},
        },
    )


_CHANGING = (
    (rb'"changed_ns":\d+', b'"changed_ns":0'),
    (rb'"seconds":[0-9.e-]+', b'"seconds":0'),
    (rb'"id":"[0-9a-f]{16}","kind"', b'"id":"","kind"'),
    (rb'"since_ns":[0-9]+', b'"since_ns":0'),
    (rb'"until":[0-9.e+]+', b'"until":0'),
    (
        rb'"state":"(playing|stopped)","done":\d+,"total":(\d+),"sentence":"[^"]*"',
        rb'"state":"\1","done":0,"total":\2,"sentence":""',
    ),
)
"""Times by the system's clock, random ids, and how far a replay has come."""

_TOLD = frozenset(
    "content-type content-disposition retry-after allow location www-authenticate "
    "content-length cache-control content-security-policy".split()
)


def comparable(method: str, response: httpx.Response, asked: str) -> Answer:
    """Return what must be equal, to the byte, of an answer."""
    body = response.content
    for pattern, instead in _CHANGING:
        body = re.sub(pattern, instead, body)
    changed = len(body) != len(response.content)
    headers = tuple(
        (name, value)
        for name, value in sorted(response.headers.items())
        if name in _TOLD and not (changed and name == "content-length")
    )
    return Answer(method, response.url.path, asked, response.status_code, headers, body)
