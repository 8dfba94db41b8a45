"""The account: whatever the transport does, one order, nothing missing, nothing twice."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.twin_server.collect.world import HEALING, World
from twin_server.collect import DAMAGED, Holding, StoreChange


@pytest.fixture
def world(features):
    return World(features)


boots = st.lists(st.integers(1, 12), min_size=1, max_size=3)


@settings(max_examples=150, deadline=None)
@given(lengths=boots, data=st.data())
def test_any_order_of_arrival_with_doubles_and_drops_gives_one_order(features, lengths, data):
    world = World(features)
    sent = [(f"b{b}", s) for b, length in enumerate(lengths) for s in range(length)]
    for boot, sequence in sent:
        world.spool.setdefault(boot, set()).add(sequence)
    world.alive()
    copies = data.draw(st.lists(st.integers(0, 2), min_size=len(sent), max_size=len(sent)))
    arriving = [one for one, count in zip(sent, copies, strict=True) for _ in range(count)]
    arriving = data.draw(st.permutations(arriving))
    while arriving:
        some = data.draw(st.integers(1, len(arriving)))
        world.arrive(*arriving[:some])
        arriving = arriving[some:]
        world.heal(data.draw(st.integers(0, 3)))
    world.heal()
    assert world.order == sent
    assert not world.changes.lost
    assert set(world.reasons) <= {"duplicate"}


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_what_the_edge_no_longer_holds_is_lost_and_the_rest_goes_on(features, data):
    world = World(features)
    count = data.draw(st.integers(2, 20))
    gone = data.draw(st.sets(st.integers(0, count - 2)))
    kept = [s for s in range(count) if s not in gone]
    world.spool["b1"] = set(kept)
    world.alive()
    world.arrive(*(("b1", s) for s in data.draw(st.permutations(kept))))
    world.heal(80)
    assert world.order == [("b1", s) for s in kept]
    lost = [s for _, first, last in world.lost for s in range(first, last + 1)]
    assert sorted(lost) == sorted(gone)
    assert len(lost) == len(set(lost))


def test_in_order_nothing_is_asked_but_the_account_once(world):
    world.alive()
    for sequence in range(5):
        world.spool.setdefault("b1", set()).add(sequence)
        world.arrive(("b1", sequence))
        world.heal(2)
    assert [s for _, s in world.order] == list(range(5))
    assert world.asked == 1


def test_a_lost_tail_is_noticed_from_health(world):
    world.alive()
    world.spool["b1"] = set(range(4))
    world.arrive(("b1", 0), ("b1", 1))
    world.heal(2)
    assert len(world.order) == 4
    world.spool["b1"] |= {4, 5}
    world.health("b1", last=5)
    world.heal()
    assert [s for _, s in world.order] == list(range(6))


@pytest.mark.parametrize("noticed", ["by what came after it", "by what the edge tells"])
def test_a_hole_is_asked_for_when_its_grace_period_ends_and_not_before(world, noticed):
    """What is only late comes by itself within that time, and is asked for in vain."""
    world.spool["b1"] = {0}
    world.alive()
    world.arrive(("b1", 0))
    world.heal(5)
    if noticed == "by what came after it":
        world.arrive(("b1", 2))
    else:
        world.health("b1", last=2)
    ends_s = world.now_s + HEALING.grace_s
    assert world.account.wants(world.now_s) == []
    assert world.account.wants(ends_s - 0.01) == []
    (want,) = world.account.wants(ends_s)
    assert (want.boot, want.first) == ("b1", 1)


def test_a_tail_that_is_promised_in_vain_keeps_nothing_up(world):
    world.alive()
    world.spool["b1"] = {0, 1}
    world.arrive(("b1", 0), ("b1", 1))
    world.health("b1", last=10**9)
    world.heal()
    asked = world.asked
    world.health("b1", last=10**9)
    world.heal(3)
    assert world.asked == asked
    world.spool["b1"].add(2)
    world.arrive(("b1", 2))
    assert [s for _, s in world.order] == [0, 1, 2]
    assert not world.lost


def test_a_boot_in_the_spool_comes_before_the_one_that_showed_it(world):
    world.spool = {"old": {3, 4}, "new": {0}}
    world.alive()
    world.arrive(("new", 0))
    assert not world.order
    world.heal()
    assert world.order == [("old", 3), ("old", 4), ("new", 0)]
    assert world.lost == [("old", 0, 2)]


def test_a_restarted_edge_is_first_asked_for_the_rest_of_its_last_run(world):
    world.spool["b1"] = set(range(6))
    world.alive()
    world.arrive(*(("b1", s) for s in range(3)))
    world.reachable = False
    world.spool["b2"] = {0, 1}
    world.arrive(("b2", 0), ("b2", 1))
    world.heal(5)
    assert ("b2", 0) not in world.order
    world.reachable = True
    world.heal()
    assert world.order == [("b1", s) for s in range(6)] + [("b2", 0), ("b2", 1)]


def test_a_boot_whose_spool_is_gone_with_its_disk_is_closed_at_once(world):
    world.spool["b1"] = {0, 1, 2}
    world.alive()
    world.arrive(("b1", 0))
    world.arrive(("b1", 2))
    world.reachable = False
    world.heal(3)
    world.spool = {"b2": {0}}
    world.reachable = True
    world.arrive(("b2", 0))
    world.heal()
    assert world.order[-1] == ("b2", 0)
    assert all(boot == "b1" for boot, _, _ in world.lost)
    world.arrive(("b1", 7))
    assert world.reasons[-1] == "closed_boot"


def test_an_edge_that_is_away_is_waited_for(world):
    world.spool["b1"] = set(range(3))
    world.alive()
    world.arrive(("b1", 0))
    world.heal(2)
    world.spool["b1"] = set(range(6))
    world.alive(False)
    world.reachable = False
    world.arrive(("b1", 5))
    world.heal(60)
    assert [s for _, s in world.order] == [0, 1, 2]
    world.reachable = True
    world.alive()
    world.heal()
    assert [s for _, s in world.order] == list(range(6))
    assert not world.lost


def test_a_sender_without_an_account_is_waited_for_a_little(world):
    world.reachable = False
    world.arrive(("b1", 0))
    world.heal(10)
    world.arrive(("b1", 2))
    world.heal(4)
    assert len(world.order) == 1
    world.heal(10)
    assert [s for _, s in world.order] == [0, 2]
    assert world.lost == [("b1", 1, 1)]
    assert "nobody could be asked" in world.changes.lost[0].why


def test_what_comes_after_it_was_given_up_is_too_late(world):
    world.spool["b1"] = {0, 2}
    world.alive()
    world.arrive(("b1", 0), ("b1", 2))
    world.heal()
    world.arrive(("b1", 1), ("b1", 2), ("b1", 0))
    assert world.reasons == ["too_late", "duplicate", "duplicate"]
    assert [s for _, s in world.order] == [0, 2]


def test_sensor_time_that_does_not_increase_is_refused_and_passed(world):
    world.alive()
    world.spool["b1"] = {0}
    world.arrive(("b1", 0))
    world.heal(2)
    change = StoreChange()
    arrivals = [
        world.arrival("b1", 1),
        world.arrival("b1", 2, t_ns=1_767_225_600_000_000_000),
        world.arrival("b1", 3),
    ]
    world.account.take(arrivals, world.now_s, change)
    assert [o.features.sequence for o in change.ordered] == [1, 3]
    assert change.ordered[1].missing_before == 1
    assert change.refused[0][0] == "clock_not_increasing"


def test_a_leap_of_the_sequence_is_refused_and_poisons_nothing(world):
    world.alive()
    world.spool["b1"] = {0, 1}
    world.arrive(("b1", 0))
    world.heal(2)
    world.arrive(("b1", 10**9), ("b1", 2**32), ("b1", 1))
    world.heal()
    assert world.reasons[:2] == ["sequence_jump", "sequence_jump"]
    assert [s for _, s in world.order] == [0, 1]
    assert not world.lost


def test_more_than_can_be_held_is_asked_for_again(world):
    world.alive()
    world.spool["b1"] = set(range(200))
    world.arrive(("b1", 0))
    world.reachable = False
    world.arrive(*(("b1", s) for s in range(2, 200)))
    assert "held_full" in world.reasons
    assert world.account.held <= HEALING.max_held
    world.reachable = True
    world.heal(200)
    assert [s for _, s in world.order] == list(range(200))


def test_alone_boots_are_let_in_as_they_come_and_holes_given_up_at_the_end(features):
    world = World(features, alone=True)
    world.arrive(("b1", 0), ("b1", 2), ("b2", 0))
    assert world.order == [("b1", 0)]
    change = StoreChange()
    world.account.give_up(change)
    world.note(change)
    assert world.order == [("b1", 0), ("b1", 2), ("b2", 0)]
    assert world.lost == [("b1", 1, 1)]


def test_an_edge_that_did_not_hear_the_acknowledgement_is_told_again(world):
    world.alive()
    world.spool["b1"] = {0, 1}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal(2)
    world.changes = StoreChange()
    world.health("b1", last=1, first_held=0)
    assert [run.next for run in world.changes.touched] == [2]


def test_what_is_forgotten_may_come_again(world):
    world.alive()
    world.spool["b1"] = {0, 1}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal(2)
    world.account.forget("lab", "beam")
    world.heal()
    assert world.order == [("b1", 0), ("b1", 1)] * 2


def test_a_boot_that_the_edge_has_dropped_whole_is_reported_lost_from_first_to_last(world):
    world.alive()
    world.spool = {"b2": {0, 1, 2}}
    world.listing = lambda: [Holding("b1", 7, 6), Holding("b2", 0, 2)]
    world.arrive(("b2", 0))
    world.heal()
    assert world.lost == [("b1", 0, 6)]
    assert world.order == [("b2", 0), ("b2", 1), ("b2", 2)]
    told = {run.boot: run.next - 1 for run in world.changes.touched}
    assert told["b1"] == 6


@pytest.mark.parametrize("arrives_first", [True, False])
@pytest.mark.parametrize("version", [1, 2])
def test_a_boot_is_acknowledged_as_its_agent_reads_from_the_first_time(
    world, arrives_first, version
):
    """Also where the answer to a question names the boot before any of its messages is read."""
    world.alive()
    world.spool = {"b1": {0}}
    world.listing = lambda: [Holding("b1", 0, 0, ack_version=version)]
    if arrives_first:
        world.arrive(("b1", 0))
    world.heal()
    assert world.order == [("b1", 0)]
    assert {run.ack_version for run in world.changes.touched} == {version}


def test_what_is_left_of_a_known_boot_and_was_dropped_is_reported(world):
    world.alive()
    world.spool = {"b1": {0, 1, 2}}
    world.arrive(("b1", 0))
    world.heal()
    world.spool = {"b2": {0}}
    world.listing = lambda: [Holding("b1", 9, 8), Holding("b2", 0, 0)]
    world.arrive(("b2", 0))
    world.heal()
    assert world.lost == [("b1", 3, 8)]
    assert world.order[-1] == ("b2", 0)


def test_a_tail_that_was_promised_in_vain_is_reported_once_another_boot_has_begun(world):
    world.alive()
    world.spool = {"b1": {0, 1}}
    world.arrive(("b1", 0), ("b1", 1))
    world.health("b1", 5)
    world.heal()
    assert world.lost == []
    world.spool = {"b2": {0}}
    world.arrive(("b2", 0))
    world.heal()
    assert world.lost == [("b1", 2, 5)]


def test_what_an_edge_keeps_although_it_is_durable_is_acknowledged_again(world):
    world.alive()
    world.spool = {"b1": {0, 1}}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal()
    world.changes.touched.clear()
    world.alive(False)
    world.alive()
    world.heal()
    assert [(run.boot, run.next) for run in world.changes.touched] == [("b1", 2)]


def test_sensor_time_that_runs_back_is_reported_as_one_range(world):
    world.alive()
    world.spool = {"b1": set(range(6))}
    now = world.make(0).t_ns
    arrivals = [world.arrival("b1", 0)]
    arrivals += [world.arrival("b1", s, t_ns=now - 10**12 + s) for s in (1, 2, 3)]
    arrivals += [world.arrival("b1", s) for s in (4, 5)]
    change = StoreChange()
    world.account.take(arrivals, 0.0, change)
    world.note(change)
    world.heal()
    assert world.lost == [("b1", 1, 3)]
    assert world.order == [("b1", s) for s in (0, 4, 5)]


def test_every_hole_is_given_up_where_nobody_can_be_asked(features):
    world = World(features, alone=True)
    world.arrive(*(("b1", s) for s in (0, 3, 4, 7, 9)), ("b2", 0), ("b2", 2))
    change = StoreChange()
    world.account.give_up(change)
    world.note(change)
    assert world.order == [("b1", s) for s in (0, 3, 4, 7, 9)] + [("b2", 0), ("b2", 2)]
    assert world.lost == [("b1", 1, 2), ("b1", 5, 6), ("b1", 8, 8), ("b2", 1, 1)]


def test_how_far_a_boot_got_is_durable_together_with_the_boot_after_it(world):
    world.alive()
    world.spool = {"b1": {0, 1}}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal()
    world.spool = {"b1": set(range(9)), "b2": {0}}
    world.arrive(("b2", 0))
    world.changes.touched.clear()
    (want,) = world.account.wants(world.now_s + 100.0)
    change = StoreChange()
    world.account.settle(want, world.listing(), world.now_s, change)
    assert {run.boot: run.told for run in change.touched} == {"b1": 8, "b2": 0}


def test_an_agent_that_is_alive_and_whose_answers_are_not_back_yet_loses_nothing(world):
    world.alive()
    world.spool = {"b1": {0, 1}}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal()
    world.spool = {}  # nobody answers, and nothing says that anything failed
    world.arrive(("b1", 9))
    world.heal(20)
    assert world.asked > HEALING.tries
    assert world.lost == []
    world.spool = {"b1": set(range(10))}
    world.heal(20)
    assert world.order == [("b1", sequence) for sequence in range(10)]


def test_what_an_edge_still_has_of_a_boot_that_was_closed_without_it_is_reported(world):
    world.spool = {"b1": {0, 1}}
    world.arrive(("b1", 0), ("b1", 1))
    world.heal()
    world.spool = {}
    world.alive()
    world.arrive(("b2", 0))
    world.heal()
    world.spool = {"b1": set(range(7)), "b2": {0}}
    world.alive(False)
    world.alive()
    world.heal()
    assert world.lost == [("b1", 2, 6)]
    run = next(run for run in world.changes.touched if run.boot == "b1")
    assert run.next == 2  # acknowledged up to there and no further: the edge keeps the rest
    world.alive(False)
    world.alive()
    world.heal()
    assert world.lost == [("b1", 2, 6)]


def test_what_is_damaged_in_the_spool_is_lost_at_once_even_at_the_end(world):
    world.damaged = ((1, 2), (4, 4), (6, 7))
    world.spool = {"b1": {0, 3, 5}}
    world.alive()
    world.arrive(("b1", 0))
    world.health("b1", 7)
    world.heal(rounds=4)
    assert world.order == [("b1", 0), ("b1", 3), ("b1", 5)]
    assert world.lost == [("b1", 1, 2), ("b1", 4, 4), ("b1", 6, 7)]
    assert {lost.why for lost in world.changes.lost} == {DAMAGED}


def test_a_closed_boot_that_goes_on_is_another_agent_and_told_once(world):
    world.spool = {"b1": {0}, "b2": {0}}
    world.arrive(("b1", 0))
    world.heal()
    world.arrive(("b2", 0))
    world.heal()
    for sequence in range(1, 5):
        world.spool["b1"].add(sequence)
        world.arrive(("b1", sequence))
    world.alive(False)
    world.alive()
    world.heal()
    assert world.reasons.count("closed_boot") == 4
    ((run, other, first, _),) = world.changes.rivals
    assert (run.boot, other, first, run.next) == ("b1", "b2", 1, 1)
    assert world.lost == []


def test_an_agent_of_a_closed_boot_that_still_tells_of_itself_is_another_one(world):
    world.spool = {"b1": {0}, "b2": {0}}
    world.arrive(("b1", 0))
    world.heal()
    world.arrive(("b2", 0))
    world.heal()
    world.health("b2", 0, t_s=1000)
    world.health("b1", 0, t_s=999, uptime_s=500.0)
    world.health("b1", 0, t_s=1005, uptime_s=506.0)
    assert not world.changes.rivals
    world.health("b1", 0, t_s=1006, uptime_s=507.0)
    world.health("b1", 0, t_s=1007, uptime_s=508.0)
    ((run, other, first, _),) = world.changes.rivals
    assert (run.boot, other, first) == ("b1", "b2", 1)


def test_agents_of_one_boot_are_told_apart_by_when_they_began_and_by_what_waits(world):
    world.arrive(("b1", 0))
    world.heal()
    world.health("b1", 0)
    world.health("b1", 0)
    assert not world.changes.rivals
    world.health("b1", 0, uptime_s=60.0)
    world.health("b1", 0, uptime_s=600.0)
    ((run, other, _, how),) = world.changes.rivals
    assert (run.boot, other, run.contested) == ("b1", "b1", True)
    assert "began at" in how
    changes = StoreChange()
    world.arrive(("b2", 0))
    world.heal()
    for frequency_hz in (3.0, 3.1):
        one = world.arrival("b2", 7, frequency_hz=frequency_hz)
        world.account.take([one], world.now_s, changes)
    ((run, other, _, how),) = changes.rivals
    assert (run.boot, other) == ("b2", "b2")
    assert how == "reading 7 came twice, with different content"


def test_what_is_being_asked_is_not_looked_at_again_but_still_counts(world):
    world.alive()
    world.spool = {"b1": {0}}
    world.arrive(("b1", 0))
    world.heal()
    world.arrive(("b1", 2))
    wants = world.account.wants(world.now_s) + world.account.wants(world.now_s + 100.0)
    assert len(wants) == 1
    assert world.account._uneasy == {}
    assert (world.account.holes, world.account.held) == (1, 1)
    assert world.account.wants(world.now_s + 200.0) == []
    world.account.settle(wants[0], None, world.now_s, StoreChange(), sound=False)
    assert world.account.wants(world.now_s + 300.0) == wants


def test_a_hole_of_a_boot_that_waits_and_is_full_is_not_given_up(world):
    last = HEALING.max_held + 10
    world.spool |= {"b1": {0, 9}, "b2": set(range(last))}
    world.alive()
    world.arrive(("b1", 0), ("b1", 9), *(("b2", s) for s in range(10, last)))
    for number in range(1, 9):  # what is missing before comes one by one
        world.heal(3, step_s=0.5)
        world.spool["b1"].add(number)
    world.heal(60)
    assert world.order == [(b, s) for b, kept in world.spool.items() for s in sorted(kept)]
    assert not world.changes.lost
