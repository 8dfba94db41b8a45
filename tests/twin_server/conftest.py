"""What the tests of the twin share: an edge that ages, with a spool that may lose things."""

import dataclasses
import json
import secrets
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from slowtime.dynamics.builders import shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from slowtime_schemas.codec import encode
from slowtime_schemas.messages import Features, Mode, Quality, Shape, Smoothed
from slowtime_schemas.quantities import Quantity
from slowtime_schemas.streams import FEATURES, alive_key, request_key
from slowtime_services.bus import Sample
from slowtime_services.models import model_file_of
from tests.postgres import schema_of, server
from twin_server.persist import SqliteStore
from twin_server.settings import TwinSettings

ORIGIN_NS = 1_767_225_600_000_000_000


def _epoch_ns(sequence, boot):
    """Sensor time of an epoch: each boot measures in days of its own."""
    days = 0 if boot == "b1" else zlib.crc32(boot.encode()) % 3_000
    return ORIGIN_NS + days * 86_400 * 10**9 + sequence * 10**9


def _features(
    sequence,
    *,
    asset="beam",
    boot="b1",
    frequency_hz=3.0,
    sd=0.002,
    damping=0.02,
    damping_sd=0.001,
    smoothed=None,
    truth=None,
    t_ns=None,
    slow_time=None,
    slow_time_unit="s",
    time_base="simulated",
    modes=None,
):
    t_ns = _epoch_ns(sequence, boot) if t_ns is None else t_ns
    mode = Mode(
        frequency_hz=Quantity(value=frequency_hz, sd=sd),
        damping_ratio=Quantity(value=damping, sd=damping_sd),
        smoothed_frequency_hz=smoothed and Smoothed(value=smoothed, sd=sd / 2, lag_epochs=2.0),
    )
    return Features(
        site="lab",
        asset=asset,
        boot=boot,
        sequence=sequence,
        t_ns=t_ns,
        start_ns=t_ns,
        slow_time=float(sequence) if slow_time is None else slow_time,
        slow_time_unit=slow_time_unit,
        time_base=time_base,
        method="ambient" if modes is None else "none",
        modes=(mode,) if modes is None else modes,
        quality=Quality(samples=1000),
        truth=truth,
    )


def _sample(message, *, sent_ns=None, replayed=False):
    key = FEATURES.key(message.site, message.asset)
    return Sample(key, encode(message), sent_ns, replayed)


@pytest.fixture(scope="session")
def features():
    """One features message of an edge."""
    return _features


@pytest.fixture(scope="session")
def sample():
    """A features message as it arrives."""
    return _sample


@pytest.fixture(scope="session")
def ageing():
    """Features of a beam that loses `loss` of its stiffness over `count` epochs."""

    def make(count, *, loss=0.2, sd=0.002, seed=0, first=0, **more):
        rng = np.random.default_rng(seed)
        noise = sd * rng.standard_normal(count)
        change = -loss * np.arange(count) / count
        return [
            _features(
                first + i,
                frequency_hz=float(3.0 * np.sqrt(1.0 + change[i]) + noise[i]),
                sd=sd,
                truth={"stiffness_change": float(change[i]), "mass_change": 0.0},
                **more,
            )
            for i in range(count)
        ]

    return make


FLOORS_KG = (1000.0, 1000.0, 800.0)
MODEL_N_PER_M = (1.2e6, 1.0e6, 0.8e6)
REAL_N_PER_M = (1.26e6, 0.95e6, 0.84e6)


class Frame:
    """A frame of three storeys whose edge identifies all modes; its model is a little wrong."""

    description: ClassVar = shear_frame(FLOORS_KG, MODEL_N_PER_M)
    model: ClassVar = model_file_of(description).model_dump(mode="json")
    channels = ("a_floor1", "a_floor2", "a_floor3")

    def __init__(self, seed=0, asset="frame", *, frequency_sd=0.001, shape_sd=0.005):
        self.rng = np.random.default_rng(seed)
        self.asset, self.frequency_sd, self.shape_sd = asset, frequency_sd, shape_sd

    def registration(self, **more):
        return {"changes": "elements", "model": self.model, **more}

    def epoch(self, sequence, changes=(0.0, 0.0, 0.0), *, masses=(0.0, 0.0, 0.0), **more):
        """Features of one epoch with the storeys' stiffness, and floors' mass, changed."""
        springs = [k * (1.0 + c) for k, c in zip(REAL_N_PER_M, changes, strict=True)]
        floors = [m * (1.0 + c) for m, c in zip(FLOORS_KG, masses, strict=True)]
        modes = undamped_modes(assemble(shear_frame(floors, springs)))
        found = [
            self.mode(f, modes.shapes[:, j], identity=j + 1)
            for j, f in enumerate(modes.frequency_hz.tolist())
        ]
        truth = {f"element.storey{i + 1}": c for i, c in enumerate(changes)}
        truth |= {f"node.floor{i + 1}.mass": c for i, c in enumerate(masses)}
        return self.message(sequence, found, truth=truth, **more)

    def mode(self, frequency_hz, shape, *, identity=None, noise=True, **more):
        """One mode as an edge would identify it."""
        own = self.rng.standard_normal(1 + 2 * len(shape)) * noise
        clean = shape / np.linalg.norm(shape)
        drawn = clean + self.shape_sd * (own[1::2] + 1j * own[2::2]) / np.sqrt(2.0)
        drawn = drawn / np.linalg.norm(drawn)
        largest = drawn[np.argmax(np.abs(drawn))]
        drawn = drawn * largest.conjugate() / abs(largest)
        value = frequency_hz * (1.0 + self.frequency_sd * own[0])
        return Mode(
            frequency_hz=Quantity(value=value, sd=self.frequency_sd * frequency_hz),
            damping_ratio=Quantity(value=0.02, sd=0.002),
            identity=identity,
            shape=Shape(
                re=tuple(drawn.real.tolist()),
                im=tuple(drawn.imag.tolist()),
                sd=(self.shape_sd,) * len(shape),
            ),
            **more,
        )

    def message(self, sequence, modes, *, boot="b1", channels=channels, truth=None):
        t_ns = _epoch_ns(sequence, boot)
        return Features(
            site="lab",
            asset=self.asset,
            boot=boot,
            sequence=sequence,
            t_ns=t_ns,
            start_ns=t_ns,
            slow_time=float(sequence),
            time_base="simulated",
            method="ssi",
            channels=channels,
            modes=tuple(sorted(modes, key=lambda mode: mode.frequency_hz.value)),
            quality=Quality(samples=1000),
            truth=truth,
        )


@pytest.fixture(scope="session")
def frame():
    """The class of frames."""
    return Frame


class Edge:
    """An edge agent on a bus: it keeps what it makes, and answers for it."""

    def __init__(self, bus, site="lab", asset="beam", *, account=True):
        self.bus, self.site, self.asset = bus, site, asset
        self.spool: dict[str, dict[int, bytes]] = {}
        self.handles = []
        if account:
            self.handles = [
                bus.answer(request_key(site, asset, "account"), self._account),
                bus.answer(request_key(site, asset, "features"), self._again),
                bus.announce(alive_key(site, asset)),
            ]

    def make(self, message, *, send=True):
        payload = encode(message)
        self.spool.setdefault(message.boot, {})[message.sequence] = payload
        if send:
            self.send(payload)

    def send(self, payload):
        self.bus.publish(
            FEATURES.key(self.site, self.asset), payload, encoding="application/json"
        )

    def forget(self, boot, *sequences):
        for sequence in sequences:
            del self.spool[boot][sequence]

    def conceal(self):
        """Answer still, but no longer announce that the edge is alive."""
        self.handles.pop().close()

    def close(self):
        for handle in self.handles:
            handle.close()

    def _account(self, query):
        return [
            (
                query.key,
                json.dumps({"boot": boot, "first": min(kept), "last": max(kept)}).encode(),
            )
            for boot, kept in self.spool.items()
            if kept
        ]

    def _again(self, query):
        first, last = int(query.parameters["first"]), int(query.parameters["last"])
        kept = self.spool.get(query.parameters["boot"], {})
        for sequence in sorted(kept):
            if first <= sequence <= last:
                yield FEATURES.key(self.site, self.asset), kept[sequence]


@pytest.fixture(scope="session")
def edge():
    """The class of edges."""
    return Edge


@pytest.fixture(scope="session")
def postgres():
    """URL of a PostgreSQL server that lives as long as the tests."""
    with tempfile.TemporaryDirectory(prefix="slowtime-pg-") as folder:
        with server(Path(folder) / "pg") as url:
            yield url


@pytest.fixture(params=["sqlite", "postgres"])
def database(request, tmp_path):
    """Name databases, each of its own, in one kind of store after the other."""
    urls: dict[str, str] = {}

    def named(name="twin"):
        if request.param == "sqlite":
            return tmp_path / f"{name}.sqlite"
        if name not in urls:
            url = request.getfixturevalue("postgres")
            urls[name] = schema_of(url, f"s{secrets.token_hex(6)}")
        return urls[name]

    return named


@pytest.fixture
def store(tmp_path):
    """A database of its own."""
    made = SqliteStore(tmp_path / "twin.sqlite")
    yield made
    made.close()


@pytest.fixture(scope="session")
def settings():
    """Settings with little patience."""
    return TwinSettings(
        port=0,
        healing={
            "grace_s": 0.02,
            "backoff_s": 0.02,
            "max_backoff_s": 0.1,
            "tries": 2,
            "foreign_patience_s": 0.2,
            "absent_patience_s": 30.0,
        },
    )


@pytest.fixture(scope="session")
def eventually():
    """Whether a condition becomes true in good time."""

    def wait(condition, timeout_s=60.0):
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    return wait


@dataclasses.dataclass
class Heard:
    """A listener that keeps what it is told."""

    news: list[Any] = dataclasses.field(default_factory=list)
    resets: list[str] = dataclasses.field(default_factory=list)

    def tell(self, news):
        self.news.append(news)

    def reset(self, twin_id):
        self.resets.append(twin_id)


@pytest.fixture
def heard():
    """A listener that keeps what it is told."""
    return Heard()
