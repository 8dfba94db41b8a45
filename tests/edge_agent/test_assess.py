"""Fatigue and virtual quantities at the edge: cut anywhere, told once, kept over restarts."""

import dataclasses
import itertools
import json
import threading

import numpy as np
import pytest
from pydantic import ValidationError

from edge_agent.__main__ import run
from edge_agent.assess import Assess
from edge_agent.assess.fatigue import CycleCount, Point
from edge_agent.publish.fatigue_store import FatigueStore
from edge_agent.settings import EdgeSettings, Origin, PointSettings
from slowtime.fatigue.counter import Count, Counter
from slowtime.fatigue.curves import SNCurve
from slowtime.signals.block import Block
from slowtime_schemas.codec import decode
from slowtime_schemas.messages import Fatigue, Virtual
from slowtime_schemas.streams import FATIGUE, VIRTUAL, request_key
from slowtime_services.bus import MemoryBus

RATE = 50.0
ORIGIN = Origin(site="lab", asset="beam", boot="b1", time_base="recorded")
MODEL = """\
slowtime_model: 1
nodes: [{id: m, mass_kg: 100}]
elements: [{id: k, between: [base, m], stiffness_n_per_m: 1e5, damping_n_s_per_m: 60}]
sensors: [{channel: a, quantity: acceleration, node: m, unit: m/s^2, noise_sd: 0.01}]
tolerance: {stiffness: 0.05}
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "one.yaml"
    path.write_text(MODEL)
    return path


def block(count=6000, seed=1, first=0, **other):
    rng = np.random.default_rng(seed)
    ringing = np.exp(-0.3 * np.arange(1000) / RATE) * np.sin(31.6 * np.arange(1000) / RATE)
    sway = np.convolve(rng.standard_normal(count), ringing)[:count]
    given = {
        "samples": np.stack([sway, 40 * sway], axis=1),
        "rate_hz": RATE,
        "first_index": first,
        "start_ns": 10**18 + round(first / RATE * 1e9),
        "channels": ("a", "s"),
        "units": ("m/s^2", "MPa"),
    }
    return Block(**{**given, **other})


def cut(whole, where):
    edges = [0, *sorted(where), len(whole.samples)]
    return [
        dataclasses.replace(
            whole,
            samples=whole.samples[a:b],
            first_index=whole.first_index + a,
            start_ns=whole.start_ns + round(a / RATE * 1e9),
        )
        for a, b in itertools.pairwise(edges)
    ]


def settings_of(model, **other):
    stress = {"name": "k.stress", "quantity": "force", "element": "k", "factor": 1e-2}
    given = {
        "virtual": {"model": model, "outputs": [stress | {"unit": "MPa"}], "tell_hz": 5.0},
        "fatigue": {
            "points": [
                {"at": "k.stress", "constant": 1e12, "slope": 3.0},
                {"at": "s", "detail_category": 71.0},
            ],
            "every_s": 60.0,
        },
    }
    return EdgeSettings(**(given | other))


def told(settings, blocks):
    assess = Assess(settings, ORIGIN)
    state = assess.start()
    messages: list[Fatigue | Virtual] = []
    for one in blocks:
        state, some = assess.step(state, one)
        messages += some
    return messages + list(assess.finish(state)[1])


def test_where_blocks_are_cut_changes_no_final_sum_and_no_virtual_value(model):
    whole = block()
    one = told(settings_of(model), [whole])
    other = told(settings_of(model), cut(whole, [1, 77, 1200, 1201, 3333, 5990]))
    ends = [[m for m in messages if isinstance(m, Fatigue)][-1] for messages in (one, other)]
    for mine, theirs in zip(*(end.points for end in ends), strict=True):
        assert (mine.bins, mine.half_cycles) == (theirs.bins, theirs.half_cycles)
        assert mine.damage == pytest.approx(theirs.damage, rel=1e-9)
    virtual = [[m for m in messages if isinstance(m, Virtual)] for messages in (one, other)]
    assert virtual[0] == virtual[1] != []


def test_a_channel_of_stress_is_counted_as_the_library_counts_it(model):
    whole = block()
    point = next(p for p in told(settings_of(model), [whole])[-1].points if p.name == "s")
    counter = Counter(curve=SNCurve.of_detail_category(71.0))
    total = counter.miner(counter.step(Count(), whole.samples[:, 1]))
    assert (point.source, point.unit, point.seconds) == ("channel", "MPa", 120.0)
    assert point.damage == pytest.approx(total.median)
    assert point.ln_sd == pytest.approx(total.ln_sd)


def test_a_virtual_stress_that_lacks_variance_adds_as_much_to_closed_cycles_as_to_all():
    """Damage goes with the power of the slope of whatever the stress lacks."""
    point = Point(PointSettings.model_validate({"at": "s", "detail_category": 71.0}))
    stress = 60.0 * np.random.default_rng(6).standard_normal(4000)
    counted = point.step(CycleCount(), stress, 100.0, "MPa", missing=0.2 * 60.0**2)
    plain, virtual = (point.told(counted, virtual=known) for known in (False, True))
    assert virtual.damage > 1.1 * plain.damage > 0.0
    assert plain.closed_damage > 0.0
    assert virtual.closed_damage / plain.closed_damage == pytest.approx(
        virtual.damage / plain.damage
    )
    lacking = 0.2 * 60.0**2 / np.mean(stress**2)
    assert virtual.damage / plain.damage == pytest.approx(
        (1.0 + lacking) ** (plain.slope / 2.0)
    )


def test_sums_only_grow_and_sequences_count(model):
    blocks = cut(block(9_000), range(500, 9_000, 500))
    messages = [m for m in told(settings_of(model), blocks) if isinstance(m, Fatigue)]
    assert [m.sequence for m in messages] == list(range(len(messages)))
    for at in ("k.stress", "s"):
        sums = [p.closed_damage for m in messages for p in m.points if p.name == at]
        assert sums == sorted(sums)
        assert sums[-1] > 0


def test_a_gap_begins_the_virtual_sensor_anew_and_goes_on_counting(model):
    first = block(3000)
    second = block(3000, seed=2, first=4000)
    messages = told(settings_of(model), [first, second])
    virtual = [m for m in messages if isinstance(m, Virtual)]
    assert virtual[-1].start_ns >= second.start_ns
    assert [m.sequence for m in virtual] == list(range(len(virtual)))
    s = next(p for p in messages[-1].points if p.name == "s")
    assert s.seconds == pytest.approx(6000 / RATE)


def test_values_are_told_at_the_rate_that_was_asked_for(model):
    virtual = [m for m in told(settings_of(model), [block()]) if isinstance(m, Virtual)]
    assert {m.rate_hz for m in virtual} == {5.0}
    whole = sum(len(m.quantities[0].values) for m in virtual)
    assert whole <= 6000 / RATE * 5 + len(virtual)
    assert virtual[0].reasons == ("settling",)
    assert virtual[-1].valid


def test_a_point_that_is_nowhere_is_said_once_and_costs_no_other(model, caplog):
    points = [{"at": at, "detail_category": 71.0} for at in ("s", "x", "k.stress")]
    blocks = list(cut(block(), {2000, 4000}))
    typo = told(settings_of(model, fatigue={"points": points}), blocks)
    said = [record.getMessage() for record in caplog.records if "'x'" in record.getMessage()]
    assert len(said) == 1
    assert "is no channel and no virtual output" in said[0]
    assert "a, s, k.stress" in said[0]
    del points[1]
    assert typo == told(settings_of(model, fatigue={"points": points}), blocks)


@pytest.mark.parametrize(
    ("point", "says"),
    [
        ({"at": "s"}, "either a detail category, or constant and slope"),
        ({"at": "s", "slope": 3.0}, "either a detail category"),
        ({"at": "s", "detail_category": 71.0, "mean_stress": "goodman"}, "tensile strength"),
    ],
)
def test_half_a_curve_is_refused(point, says):
    with pytest.raises(ValidationError, match=says):
        EdgeSettings(fatigue={"points": [point]})


@pytest.mark.parametrize(
    ("output", "says"),
    [
        ({"name": "d", "quantity": "drift"}, "needs `between`"),
        ({"name": "f", "quantity": "force", "element": "k", "factor": 2.0}, "belong together"),
    ],
)
def test_half_a_quantity_is_refused(model, output, says):
    with pytest.raises(ValidationError, match=says):
        EdgeSettings(virtual={"model": model, "outputs": [output]})


class Told(MemoryBus):
    def __init__(self):
        super().__init__()
        self.sent = {}

    def publish(self, key, payload, **named):
        self.sent.setdefault(key.split("/")[3], []).append(payload)
        return super().publish(key, payload, **named)


def test_an_agent_tells_and_keeps_the_newest_of_each_boot(model, tmp_path):
    np.save(tmp_path / "a.npy", block(2500).samples)
    bus = Told()
    for boot in ("b1", "b2"):
        settings = settings_of(
            model,
            boot=boot,
            input={
                "kind": "file", "path": tmp_path / "a.npy", "rate_hz": RATE,
                "start_ns": 10**18, "columns": ("a", "s"), "units": ("a=m/s^2", "s=MPa"),
            },
            spool={"folder": tmp_path / "spool"},
            extract={"method": "peak", "window_s": 25.0},
            publish={"linger_s": 0.0},
        )  # fmt: skip
        assert run(settings, bus=bus, stop=threading.Event()) == 0
    fatigue = [decode(FATIGUE, payload) for payload in bus.sent["fatigue"]]
    newest = {one.boot: one for one in fatigue if isinstance(one, Fatigue)}
    assert [p.damage for p in newest["b1"].points] == [p.damage for p in newest["b2"].points]
    assert all(isinstance(decode(VIRTUAL, p), Virtual) for p in bus.sent["virtual"])
    kept = list(FatigueStore(tmp_path / "spool" / "demo.tower", "b3").all())
    assert {json.loads(payload)["boot"] for payload in kept} == {"b1", "b2"}
    assert "/request/fatigue/" in request_key("demo", "tower", "fatigue")


def test_each_boot_is_told_again_in_its_turn(tmp_path):
    for boot in ("b1", "b2", "b3"):
        FatigueStore(tmp_path, boot).put(boot.encode())
    kept = FatigueStore(tmp_path, "b4")
    assert {kept.turn() for _ in range(3)} == {b"b1", b"b2", b"b3"}
    assert FatigueStore(tmp_path / "nothing", "b").turn() is None


def test_a_message_of_a_boot_that_cannot_be_read_hides_no_other(tmp_path, caplog):
    for boot in ("b1", "b3"):
        FatigueStore(tmp_path, boot).put(boot.encode())
    (tmp_path / "b2.fatigue").mkdir()  # what raises OSError when it is read
    kept = FatigueStore(tmp_path, "b4")
    assert set(kept.all()) == {b"b1", b"b3"}
    assert {kept.turn() for _ in range(4)} == {b"b1", b"b3"}
    assert "b2.fatigue cannot be read" in caplog.text
