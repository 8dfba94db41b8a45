"""Damage at the twin: boots add up, repeats change nothing, gaps are told, restarts go on."""

import random

import pytest

from slowtime_schemas.codec import encode
from slowtime_schemas.messages import (
    CurveOfMessage,
    Fatigue,
    FatiguePoint,
    Virtual,
    VirtualQuantity,
)
from slowtime_schemas.streams import FATIGUE, VIRTUAL
from slowtime_services.bus import Sample
from twin_server.persist import open_store
from twin_server.pipeline import Pipeline
from twin_server.pipeline.analysis.fatigue import fatigue_of
from twin_server.pipeline.knowledge import TwinKnowledge
from twin_server.registration.twin import Registration

T0, HOUR = 1_790_000_000_000_000_000, 3_600


def message(boot="b1", sequence=0, *, hours=1, damage=None, since=0, cycles=100):
    """Sums of a boot after so many hours."""
    damage = 1e-4 * hours if damage is None else damage
    return Fatigue(
        site="lab", asset="beam", boot=boot, sequence=sequence, time_base="recorded",
        start_ns=T0 + since * HOUR * 10**9, t_ns=T0 + (since + hours) * HOUR * 10**9,
        points=(
            FatiguePoint(
                name="k.stress", unit="MPa", bins=(60,), half_cycles=(cycles * hours,),
                damage=damage, closed_damage=damage, ln_sd=0.5, slope=3.0,
                curve=CurveOfMessage(constant=1e12, slope=3.0), seconds=float(hours * HOUR),
            ),
        ),
    )  # fmt: skip


def of(*messages):
    return fatigue_of(sorted(messages, key=lambda m: (m.t_ns, m.sequence)))[0]


def sample(one):
    stream = FATIGUE if isinstance(one, Fatigue) else VIRTUAL
    return Sample(stream.key(one.site, one.asset), encode(one), None, replayed=True)


@pytest.fixture
def course():
    first = [message("b1", n, hours=n + 1) for n in range(5)]
    return first + [message("b2", n, hours=n + 1, since=7) for n in range(3)]


def test_boots_add_up_and_the_time_between_them_is_not_counted(course):
    found = of(*course)
    assert found["damage"]["value"] == pytest.approx(8e-4)
    assert (found["boots"], found["counted_s"], found["uncounted_s"]) == (2, 8 * HOUR, 2 * HOUR)
    assert sum(found["cycles"]) == 400
    assert found["damage_per_year"] == pytest.approx(1e-4 / HOUR * 365.25 * 86_400)


def test_messages_that_are_lost_repeated_or_late_change_no_sum(course, database, settings):
    seen = []
    for seed in range(2):
        rng = random.Random(seed)
        given = [*rng.choices(course, k=12), course[4], course[7]]
        rng.shuffle(given)
        store = open_store(database(f"t{seed}"))
        pipeline = Pipeline(settings, store)
        pipeline.register("lab.beam", Registration())
        pipeline.ingest(map(sample, given))
        found = TwinKnowledge(pipeline, store).fatigue("lab.beam")[0]
        seen.append((found["damage"], found["counted_s"], found["cycles"]))
        store.close()
    assert all(one == seen[0] for one in seen)
    assert seen[0][1] == 8 * HOUR


def test_damage_lasts_over_a_restart_and_goes_with_the_twin(course, database, settings):
    for turn in range(2):
        store = open_store(database("twin"))
        pipeline = Pipeline(settings, store)
        if turn == 0:
            pipeline.register("lab.beam", Registration())
            pipeline.ingest(map(sample, course))
        knowledge = TwinKnowledge(pipeline, store)
        assert knowledge.fatigue("lab.beam")[0]["damage"]["value"] == pytest.approx(8e-4)
        if turn == 1:
            pipeline.delete("lab.beam")
            assert knowledge.fatigue("lab.beam") == []
        store.close()


def test_the_newest_message_of_an_hour_is_kept(store, settings):
    pipeline = Pipeline(settings, store)
    pipeline.register("lab.beam", Registration())
    early = message("b1", 0, hours=1, damage=1e-4)
    late = message("b1", 1, hours=1, damage=2e-4)
    pipeline.ingest(map(sample, [late, early]))
    assert [row.sequence for row in store.fatigue("lab.beam")] == [1]


def test_the_course_of_damage_never_falls_and_time_to_failure_is_ordered(course):
    found = of(*course)
    damages = [moment["damage"] for moment in found["course"]]
    assert damages == sorted(damages)
    times = list(found["time_to_failure_s"].values())
    assert times == sorted(times)
    assert found["damage"]["lo"] < found["damage"]["value"] < found["damage"]["hi"]
    assert 0 <= found["failed_probability"] < 1e-6


def test_a_steady_rate_is_known_better_than_one_that_wanders():
    steady = of(*(message("b", n, hours=n + 1) for n in range(20)))
    rng, total, wander = random.Random(1), 0.0, []
    for n in range(20):
        total += rng.expovariate(1e4)
        wander.append(message("b", n, hours=n + 1, damage=total))
    assert steady["rate_variation"] == pytest.approx(0.0, abs=1e-6)
    assert of(*wander)["rate_variation"] > 0.1
    assert of(message())["rate_variation"] == 1.0


def test_another_curve_is_a_reason():
    other = message("b2", since=3)
    point = other.points[0].model_copy(
        update={"curve": CurveOfMessage(constant=2e12, slope=3.0)}
    )
    assert (
        "curve_changed"
        in of(message(), other.model_copy(update={"points": (point,)}))["reasons"]
    )


def test_virtual_quantities_are_remembered_in_their_latest_windows(store, settings):
    pipeline = Pipeline(settings, store)
    pipeline.register("lab.beam", Registration())
    windows = [
        Virtual(
            site="lab", asset="beam", boot="b1", sequence=n, time_base="recorded",
            start_ns=T0 + n, t_ns=T0 + n + 1, rate_hz=5.0, lowest_hz=0.5, valid=True,
            quantities=(VirtualQuantity(name="d", unit="m", values=(0.1,), sd=(0.01,)),),
        )
        for n in range(20)
    ]  # fmt: skip
    pipeline.ingest(map(sample, windows))
    found = TwinKnowledge(pipeline, store).virtual("lab.beam")
    assert [one["start_ns"] for one in found] == [T0 + n for n in range(8, 20)]
    assert found[-1]["quantities"] == [
        {"name": "d", "unit": "m", "values": (0.1,), "sd": (0.01,)}
    ]


def test_what_is_told_of_no_twin_is_not_kept(store, settings):
    pipeline = Pipeline(settings, store)
    pipeline.ingest([sample(message())])
    assert store.fatigue("lab.beam") == []
