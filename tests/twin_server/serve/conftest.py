"""A running server on loopback, with a bus to feed it."""

import dataclasses
import sys
import threading
import time
from typing import Any

import httpx
import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.raw import RawHeader, encode_raw
from slowtime_schemas.streams import FEATURES, RAW, alive_key, request_key
from slowtime_services.bus import MemoryBus
from slowtime_services.simulate import SimulatedModel
from twin_server.__main__ import run
from twin_server.settings import DiagnoseSettings, GapSettings


@dataclasses.dataclass
class Running:
    """A server, its bus and a client of it."""

    url: str
    bus: MemoryBus
    client: httpx.Client
    stop: threading.Event
    thread: threading.Thread
    result: list[Any]

    def feed(self, messages):
        for message in messages:
            key = FEATURES.key(message.site, message.asset)
            self.bus.publish(key, encode(message), encoding=FEATURES.encoding, replayed=True)

    def get(self, path, **parameters):
        return self.client.get(path, params=parameters)

    def count(self, twin_id="lab.beam"):
        return self.get(f"/api/v1/twins/{twin_id}/history/hash").json().get("features", 0)


@pytest.fixture(scope="module")
def serving(tmp_path_factory, settings):
    """Start servers, and end them."""
    running = []

    def start(database=None, diagnosis=None, **changes):
        path = database or tmp_path_factory.mktemp("server") / "twin.sqlite"
        own = settings.model_copy(update={"database": path, **changes})
        bus, stop, ready = MemoryBus(), threading.Event(), threading.Event()
        urls, result = [], []

        def told(url):
            urls.append(url)
            ready.set()

        def serve():
            more = {} if diagnosis is None else {"diagnosis": diagnosis}
            result.append(run(own, bus=bus, stop=stop, ready=told, **more))
            ready.set()

        thread = threading.Thread(target=serve)
        thread.start()
        assert ready.wait(60)
        # What effects do is compiled where nothing has compiled it yet.
        client = httpx.Client(base_url=urls[0], timeout=300)
        server = Running(urls[0], bus, client, stop, thread, result)
        running.append(server)
        return server

    yield start
    for server in running:
        server.client.close()
        server.stop.set()
        server.thread.join(60)
        server.bus.close()


@pytest.fixture(scope="module")
def server(serving, ageing, eventually):
    """One server with a twin that has aged for 300 epochs, shared by tests that only look."""
    started = serving()
    body = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "name": "Beam"}
    assert started.client.put("/api/v1/twins/lab.beam", json=body).status_code == 201
    started.feed(ageing(300))
    assert eventually(lambda: started.count() == 300)
    return started


RIG = {
    "slowtime_model": 1,
    "nodes": [{"id": "m1", "mass_kg": 2.0}, {"id": "m2", "mass_kg": 1.0}],
    "elements": [
        {
            "id": f"j{i}", "between": between,
            "stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 2.0,
        }
        for i, between in ((1, ["base", "m1"]), (2, ["m1", "m2"]))
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": f"a{i}", "quantity": "acceleration", "node": f"m{i}", "unit": "m/s^2"}
        for i in (1, 2)
    ],
    "tolerance": {"stiffness": 0.02, "damping": 0.1},
}  # fmt: skip
FRICTION = {"effect": "coulomb", "element": "j2", "friction_n": 0.5}
ENTERS, LEAVES = 1_000, 2_000

PRETENDS = """
import json, pathlib, sys, time
from slowtime_services.reports import Chart, Section, write_page
here = pathlib.Path(sys.argv[1])
task = json.loads((here / "task.json").read_text())
print(json.dumps({"stage": "refitting coulomb at element j2", "share": 0.4}), flush=True)
if task["order"]["quick"]:
    sys.stdin.read()
model = task["model"]
joined = model.get("name") == "open"
place = "base-m2" if joined else "j2"
words = "Drag beside m2." if joined else "Dry friction in j2, 0.5 N."
model["effects"] = [{"effect": "coulomb", "element": place, "friction_n": 0.5}]
if joined:
    model["elements"].append({"id": place, "between": ["base", "m2"]})
gap = {"nominal": 0.4, "refitted_nominal": 0.2, "augmented": 0.02, "noise_floor": 0.02,
       "steps": [{"effect": "coulomb", "nrmse": 0.02}]}
effect = {"effect": "coulomb", "family": "friction", "where": {"kind": "element", "id": place},
          "parameters": {"friction_n": {"value": 0.5, "sd": 0.01, "unit": "N"}},
          "probability": 0.98, "sentence": "Dry friction.", "alternatives": [
              {"effect": "stick_slip", "where": {"kind": "element", "id": "j2"},
               "probability": 0.02}]}
where = [{"kind": "element", "id": "j2", "score": 40.0, "p_value": 1e-9, "share": 0.9},
         {"kind": "element", "id": "j1", "score": 2.0, "p_value": 0.4, "share": 0.1},
         {"kind": "base", "id": "base", "score": 1.0, "p_value": 0.6, "share": 0.05}]
when = {"times_s": [[0.05, 0.15]], "bands_hz": [[2.0, 4.0]], "amplitude": "More when it moves "
        "slowly.", "linear": False, "steady": True}
none = task["order"]["holdout_s"] is not None
report = {"verdict": "nothing_missing" if none else "missing_effect",
          "sentence": "Nothing is missing." if none else words,
          "effects": [] if none else [effect], "experiment": None, "gap": gap,
          "where": where, "when": when, "undecided": []}
(here / "report.json").write_text(json.dumps(report))
line = lambda name, y: {"name": name, "x": [0.0, 0.1, 0.2], "y": y, "mode": "lines"}
axes = {"xaxis": {"title": {"text": "campaign time [s]"}},
        "yaxis": {"title": {"text": "a1 [m/s^2]"}}}
runs = Chart([line("measured", [0.0, 1.0, 0.5]), line("original model", [0.0, 0.6, 0.1]),
              line("augmented", [0.0, 1.0, 0.4])], axes, "Acceleration of m1 (a1) <loud>")
write_page(here / "report.html", "Dry friction", report["sentence"],
           [Section("Measured, and what the models say", (), [runs])])
(here / "augmented.yaml").write_text(json.dumps(model))
"""
"""A diagnosis that has its answer ready; a quick one waits until it is told to stop."""


class Rig:
    """An edge that keeps epochs of a rig, with friction from `ENTERS` to `LEAVES`."""

    def __init__(self, bus):
        self.structure = SimulatedModel(
            model=RIG, effects=[FRICTION], enters=ENTERS, leaves=LEAVES, seconds=6.0,
            rate_hz=100.0, interval_s=6.0, input_rms=3.0, band_hz=(0.5, 20.0),
            sensor={"noise": 0.02},
        )  # fmt: skip
        self.kept: list[bytes] = []
        self.handles = [
            bus.answer(request_key("lab", "rig", "raw"), self._raw),
            bus.announce(alive_key("lab", "rig")),
        ]

    def hear(self, epoch):
        (block,) = self.structure.epoch(epoch)
        header = RawHeader(
            site="lab", asset="rig", boot="b1", sequence=len(self.kept), t_ns=block.start_ns,
            time_base="simulated", rate_hz=block.rate_hz, first_index=block.first_index,
            dtype="<f4", samples=len(block.samples), channels=block.channels,
            units=block.units, epoch=block.epoch, slow_time=block.slow_time,
        )  # fmt: skip
        self.kept.append(encode_raw(header, block.samples.astype("<f4").tobytes()))

    def close(self):
        for handle in self.handles:
            handle.close()

    def _raw(self, query):
        count = max(1, round(float(query.parameters["seconds"]) / 6.0))
        return [(RAW.key("lab", "rig"), payload) for payload in self.kept[-count:]]


class Diagnosing:
    """A server with a rig, whose gap was learnt, and whose diagnoses are pretended."""

    twin = "/api/v1/twins/lab.rig"

    def __init__(self, server, eventually):
        self.server, self.eventually, self.epoch = server, eventually, 0
        body = {"changes": "stiffness", "model": RIG}
        assert server.client.put(self.twin, json=body).status_code == 201
        self.edge = Rig(server.bus)

    def hear(self, count, first=None):
        """Let epochs be heard one by one, each until it has been compared."""
        self.epoch = self.epoch if first is None else first
        for _ in range(count):
            before = self._seen()
            self.edge.hear(self.epoch)
            self.epoch += 1
            assert self.until(lambda before=before: self._seen() != before)

    def learn(self):
        """Let epochs be heard until what is usual has been learnt."""
        for _ in range(20):
            self.hear(1)
            if self.gap()["expected"] is not None:
                return
        raise AssertionError(self.gap())

    def until(self, holds):
        """Whether something comes to be; asked less often, for each time is a request."""
        deadline = time.monotonic() + 300
        while not holds():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.1)
        return True

    def _seen(self):
        told = self.gap()
        return told["state"] == "waiting", told["readings"][-1:]

    def gap(self):
        return self.server.get(f"{self.twin}/gap").json()

    def post(self, path, body=None):
        return self.server.client.post(f"{self.twin}{path}", json=body)

    def one(self, number):
        return self.server.get(f"{self.twin}/diagnoses/{number}").json()

    def ended(self, number):
        assert self.until(lambda: self.one(number)["ended_ns"] is not None)
        return self.one(number)

    def kinds(self):
        found = self.server.get(f"{self.twin}/events", limit=1000).json()["events"]
        return [event["kind"] for event in found]


@pytest.fixture(scope="module")
def pretender(tmp_path_factory):
    """Command of a diagnosis that has its answer ready."""
    path = tmp_path_factory.mktemp("diagnosis") / "pretends.py"
    path.write_text(PRETENDS)
    return [sys.executable, str(path)]


@pytest.fixture(scope="module")
def diagnosing(serving, pretender, eventually):
    """One server for all tests of a module, which leave it as they found it."""
    server = serving(
        diagnosis=pretender,
        gap=GapSettings(every_s=0.05, seconds=6.0, learn=6, tune=2),
        diagnose=DiagnoseSettings(max_queued=1, max_kept=30, max_raw_s=100.0),
    )
    made = Diagnosing(server, eventually)
    yield made
    made.edge.close()


@pytest.fixture(scope="module")
def resting(serving, pretender, eventually):
    """One server with a rig whose gap nobody minds, for what is quick."""
    made = Diagnosing(serving(diagnosis=pretender, gap=GapSettings(every_s=0.0)), eventually)
    for epoch in range(2):
        made.edge.hear(epoch)
    yield made
    made.edge.close()


@pytest.fixture(scope="module")
def beam_and_frame(serving, ageing, frame, eventually):
    """Start a server with a twin of one mode, registered as asked, and one of many elements."""

    def start(**registration):
        own, framed = serving(), frame()
        own.client.put("/api/v1/twins/lab.beam", json=registration)
        own.client.put("/api/v1/twins/lab.frame", json=framed.registration(learn_epochs=2))
        own.feed(ageing(60))
        own.feed(framed.epoch(i) for i in range(4))
        assert eventually(lambda: (own.count(), own.count("lab.frame")) == (60, 4))
        return own

    return start
