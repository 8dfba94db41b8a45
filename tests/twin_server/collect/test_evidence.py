"""Stated sequences: near ones are believed, far ones where an edge lists and delivers them."""

import json

import pytest

from slowtime_schemas.codec import Refused, decode, encode
from slowtime_schemas.messages import Features
from slowtime_schemas.quantities import SEQUENCES
from slowtime_schemas.streams import FEATURES, HEALTH
from tests.twin_server.collect.world import HEALING, World
from twin_server.collect import Holding, Run, StoreChange
from twin_server.collect.evidence import MOST_AHEAD
from twin_server.collect.intervals import Reasons

FAR = SEQUENCES - 1


@pytest.fixture
def world(features):
    return World(features)


@pytest.fixture
def started(world):
    """A boot of which two readings were taken in."""
    world.alive()
    world.spool["b1"] = {0, 1}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal(3)
    assert world.order == [("b1", 0), ("b1", 1)]
    return world


def goes_on(world, boot="b1", first=2):
    """Whether the next readings of a boot are taken in at once, and nothing is lost."""
    for sequence in range(first, first + 3):
        world.spool.setdefault(boot, set()).add(sequence)
        before = len(world.order)
        world.arrive((boot, sequence))
        assert world.order[before:] == [(boot, sequence)]
    assert world.lost == []
    return True


@pytest.mark.parametrize("last", [2_000, 10**9, MOST_AHEAD, FAR])
def test_a_newest_sequence_that_is_only_stated_is_neither_waited_for_nor_lost(started, last):
    started.health("b1", last=last)
    assert goes_on(started)
    started.heal()
    assert goes_on(started, first=5)
    (doubted,) = started.changes.doubted
    assert (doubted.stated, doubted.corrected) == (last, False)
    assert started.reasons.count("stated_sequence") == 1
    started.health("b1", last=last)
    asked = started.asked
    started.heal(5)
    assert (started.asked, len(started.changes.doubted)) == (asked, 1)


def test_it_is_not_counted_as_lost_once_another_boot_has_begun(started):
    started.health("b1", last=FAR)
    started.spool = {"b2": {0}}
    started.arrive(("b2", 0))
    started.heal()
    assert started.order[-1] == ("b2", 0)
    assert started.lost == []
    assert len(started.changes.doubted) == 1


@pytest.mark.parametrize(
    "holding",
    [
        Holding("b1", 0, FAR),
        Holding("b1", FAR, FAR),
        Holding("b1", 2**31, 2**31 + 9),
        Holding("b1", 0, FAR, ((2, FAR),)),
        Holding("b1", FAR, 5),
    ],
    ids=["all", "the last", "some ahead", "all damaged", "upside down"],
)
def test_an_account_that_lists_what_the_edge_does_not_give_loses_nothing(
    started, holding, monkeypatch
):
    monkeypatch.setattr(started, "listing", lambda: [holding])
    started.health("b1", last=FAR)
    started.heal()
    started.alive(False)
    started.alive()
    started.heal()
    assert goes_on(started)
    assert len(started.changes.doubted) <= 1


def test_what_is_far_ahead_and_not_listed_is_refused_and_the_boot_goes_on(started):
    started.arrive(("b1", 10**9), ("b1", FAR))
    assert started.reasons[-2:] == ["sequence_jump"] * 2
    assert goes_on(started)
    started.heal()
    assert goes_on(started, first=5)


def test_an_edge_that_lists_all_and_gives_only_what_is_far_is_not_believed(
    started, monkeypatch
):
    started.health("b1", last=2**31)
    monkeypatch.setattr(started, "listing", lambda: [Holding("b1", 0, 2**31)])
    for _ in range(40):
        started.heal(1)
        started.arrive(("b1", 2**31))
    assert goes_on(started)


@pytest.mark.parametrize("begins", [5_000, 10**9, MOST_AHEAD + 1, FAR])
@pytest.mark.parametrize("answers", [True, False], ids=["answered", "unanswered"])
def test_a_boot_that_begins_far_ahead_is_not_believed_and_its_true_readings_are(
    world, begins, answers
):
    world.alive(answers)
    world.reachable = answers
    world.arrive(("b1", begins))
    world.heal()
    assert world.order == []
    assert "sequence_jump" in world.reasons
    assert goes_on(world, first=0)
    world.heal()
    assert goes_on(world, first=3)


@pytest.mark.parametrize("ahead", [10**7, 4 * 10**9])
@pytest.mark.parametrize("live", [True, False], ids=["that goes on", "that is silent"])
def test_an_honest_edge_far_ahead_of_a_restored_server_is_taken_in(started, ahead, live):
    first = ahead - 60
    started.spool["b1"] = set(range(first, ahead))
    started.health("b1", last=ahead - 1, first_held=first)
    if live:
        started.spool["b1"].add(ahead)
        started.arrive(("b1", ahead))
    started.heal(60)
    expected = [("b1", s) for s in range(first, ahead + live)]
    assert started.order[2:] == expected
    assert started.lost == [("b1", 2, first - 1)]
    assert started.changes.doubted == []


def test_an_honest_edge_is_taken_in_by_a_server_that_never_knew_it(world):
    first = 10**7
    world.alive()
    world.spool = {"old": {5_000, 5_001}, "b1": set(range(first, first + 20))}
    world.arrive(("b1", first + 19))
    world.heal(60)
    expected = [("old", 5_000), ("old", 5_001)]
    assert world.order == expected + [("b1", s) for s in range(first, first + 20)]
    assert world.lost == [("old", 0, 4_999), ("b1", 0, first - 1)]


def test_a_recording_may_begin_far_ahead_and_miss_much(features):
    world = World(features, alone=True)
    world.arrive(("b1", 10**7), ("b1", 10**7 + 5 * 10**6))
    change = StoreChange()
    world.account.give_up(change)
    world.note(change)
    assert world.order == [("b1", 10**7), ("b1", 10**7 + 5 * 10**6)]
    assert len(world.lost) == 2


def test_boots_are_limited_and_the_limit_is_told_once(features):
    world = World(features, max_boots=5)
    for number in range(20):
        world.arrive((f"b{number}", 0))
    world.heal()
    assert len(world.order) == 5
    assert world.account.boots == 5
    assert world.reasons.count("too_many_boots") == 15
    ((_, _, boot, setting, allowed),) = world.changes.limits
    assert (boot, setting, allowed) == ("b5", "admission.max_boots", 5)
    assert goes_on(world, "b4", first=1)


def test_a_listing_of_many_boots_is_limited_too(features, monkeypatch):
    world = World(features, max_boots=5)
    world.alive()
    monkeypatch.setattr(
        world, "listing", lambda: [Holding(f"l{n}", 0, 3) for n in range(1_000)]
    )
    world.heal(3)
    assert world.account.boots == 5


def test_a_long_account_is_let_in_by_and_by_in_its_order(features, monkeypatch):
    world = World(features, max_boots=1_000)
    world.alive()
    listing = [Holding(f"l{n}", 5, 4) for n in range(700)]
    monkeypatch.setattr(world, "listing", lambda: listing)
    world.heal(1)
    assert world.account.boots == 200
    world.heal(10)
    assert [boot for boot, _, _ in world.lost] == [f"l{n}" for n in range(700)]


def test_an_edge_that_gives_nothing_it_lists_is_asked_more_and_more_rarely(
    started, monkeypatch
):
    monkeypatch.setattr(started, "listing", lambda: [Holding("b1", 0, 50 + started.asked)])
    started.health("b1", last=50)
    started.heal(400, step_s=0.1)
    assert started.asked < 30


def test_held_bytes_of_all_boots_of_an_asset_are_limited(features):
    world = World(features)
    size = len(world.arrival("b1", 1).payload)
    world.account._settings = HEALING.model_copy(update={"max_held_bytes": 10 * size + 50})
    for sequence in range(1, 9):
        world.arrive(("b1", sequence), ("b2", sequence))
    assert world.account.held == 10
    assert world.account.held_bytes <= 10 * size + 50
    assert world.reasons == ["held_full"] * 6
    world.heal()
    assert world.account.held_bytes == 0


def test_ranges_that_were_lost_are_told_each_and_the_newest_remembered(started):
    started.alive(False)
    for sequence in range(3, 1_003, 2):
        started.arrive(("b1", sequence))
    change = StoreChange()
    started.account.give_up(change)
    assert len(change.lost) == 50  # as many as may be held
    for _ in range(12):
        run = next(iter(change.touched))
        for sequence in range(run.next + 1, run.next + 99, 2):
            started.arrive(("b1", sequence))
        started.account.give_up(change)
    assert len(run.lost) == 256
    assert len(change.lost) > 500
    started.arrive(("b1", run.lost[-1][0]))
    assert started.reasons[-1] == "too_late"


def poisoned(**more):
    """A boot as an earlier server has kept it."""
    return Run(
        "lab", "beam", "b1", **{"number": 1, "next": 2, "last": 1, "last_t_ns": 1, **more}
    )


@pytest.mark.parametrize(
    ("run", "stated"),
    [
        (poisoned(told=2**62), 2**62),
        (poisoned(told=2**62, next=2**62 + 1, lost=[(2, 2**62)]), 2**62),
        (poisoned(told=FAR), FAR),
    ],
    ids=["stated", "counted as lost", "the largest"],
)
def test_an_account_that_an_earlier_server_was_made_to_believe_is_corrected(
    started, features, run, stated
):
    again = World(features)
    again.account.restore([run], 2)
    (corrected,) = again.account.corrections.doubted
    assert (corrected.stated, corrected.expected, corrected.corrected) == (stated, 2, True)
    assert (run.next, run.told, run.lost) == (2, 1, [])
    again.alive()
    again.spool["b1"] = {0, 1}
    assert goes_on(again)
    again.heal()
    assert again.lost == []


def test_what_was_held_far_ahead_by_an_earlier_server_is_let_go(features):
    again = World(features)
    run = poisoned(next=0, last=-1, last_t_ns=-1)
    for sequence in (1, FAR):
        run.held[sequence] = again.arrival("b1", sequence)
    again.account.restore([run], 2)
    assert list(run.held) == [1]
    assert [s for _, s in again.account.corrections.released] == [FAR]
    again.spool["b1"] = {0, 1}
    again.alive()
    again.heal()
    assert again.order == [("b1", 0), ("b1", 1)]


def test_a_sound_account_is_restored_as_it_is(features):
    again = World(features)
    run = poisoned(told=500, lost=[(0, 0)])
    again.account.restore([run], 2)
    assert again.account.corrections.is_empty
    assert (run.told, run.lost) == (500, [(0, 0)])


@pytest.mark.parametrize("field", ["last_sequence", "first_held", "sequence"])
def test_no_message_states_a_sequence_that_a_store_cannot_keep(field):
    content = {
        "version": 1, "site": "lab", "asset": "beam", "boot": "b1", "sequence": 0, "t_ns": 1,
        "last_sequence": 0, "first_held": 0, "uptime_s": 1.0,
    }  # fmt: skip
    decode(HEALTH, json.dumps(content | {field: FAR}).encode())
    with pytest.raises(Refused, match=r"Allowed: below 2\^40"):
        decode(HEALTH, json.dumps(content | {field: FAR + 1}).encode())


@pytest.mark.parametrize(
    ("change", "allowed"),
    [
        ({"uptime_s": 1e12}, "Allowed: up to 9.22337e\\+09 s"),
        ({"counters": {f"k{n}": 0 for n in range(257)}}, "Allowed: up to 256"),
        ({"counters": {"k" * 101: 0}}, "Allowed: up to 100"),
    ],
)
def test_times_and_counters_are_bounded(change, allowed):
    content = {
        "version": 1, "site": "lab", "asset": "beam", "boot": "b1", "sequence": 0, "t_ns": 1,
        "last_sequence": 0, "first_held": 0, "uptime_s": 1.0,
    }  # fmt: skip
    with pytest.raises(Refused, match=allowed):
        decode(HEALTH, json.dumps(content | change).encode())


def test_features_of_the_largest_sequence_are_read(features):
    message = decode(FEATURES, encode(features(FAR, t_ns=10**18)))
    assert isinstance(message, Features)


def test_reasons_are_kept_as_ranges_and_split_a_hole():
    reasons = Reasons()
    for sequence in (5, 7, 6, 20):
        reasons.add(sequence, "future_clock")
    reasons.add(8, "unset_clock")
    assert len(reasons) == 3
    hole = (0, 2**40)
    parts = []
    while hole[0] <= 25:
        part, reason = reasons.first_part(hole)
        parts.append((*part, reason))
        hole = (part[1] + 1, hole[1])
    assert parts == [
        (0, 4, None), (5, 7, "future_clock"), (8, 8, "unset_clock"), (9, 19, None),
        (20, 20, "future_clock"), (21, 2**40, None),
    ]  # fmt: skip
    reasons.forget(before=8)
    assert len(reasons) == 2


@pytest.mark.parametrize("told_by", ["health", "account"])
def test_the_true_end_counts_again_after_a_false_one(world, told_by):
    world.alive()
    world.spool["b1"] = {0}
    world.arrive(("b1", 0))
    world.heal(4)
    world.health("b1", last=2**31)
    world.heal(20)
    world.spool["b1"] |= {1, 2}
    if told_by == "health":
        world.health("b1", last=2)
    else:
        world.alive()  # the edge comes back with another boot, of which there is nothing yet
    world.heal(20)
    assert [s for _, s in world.order] == [0, 1, 2]
    assert not world.changes.lost


def test_of_a_boot_known_by_its_edges_account_no_more_is_believed_than_of_others(world):
    world.alive()
    world.spool["b1"] = {0}
    world.heal(4)  # it is let in by the account alone
    world.health("b1", last=5_000)
    world.spool["b2"] = {0}
    world.arrive(("b2", 0))
    world.heal(40)
    assert world.order == [("b1", 0), ("b2", 0)]
    assert not world.lost
