"""Processors: who has used least goes on, none is idle, and nobody is paused for ever."""

import time
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_server.fairness import DecayedUsage, Holder, Processors
from twin_server.fairness.processors import HERE_AT_ONCE, QUANTUM_S, Turn, chosen_of

SITES = ["a", "b", "c", "d"]


def turn(site, *, here=False, token="t", idle=False):
    return Turn(Holder(site, token), lambda: None, lambda: None, here, idle)


TURNS = st.lists(
    st.builds(turn, st.sampled_from(SITES), here=st.booleans(), idle=st.booleans()),
    max_size=20,
)


@given(turns=TURNS, count=st.integers(1, 6), used=st.lists(st.floats(0, 100), min_size=4))
def test_no_processor_is_idle_while_work_waits_and_each_site_comes_before_seconds(
    turns, count, used
):
    usage = DecayedUsage(1e9, now=lambda: 0.0)
    for site, seconds in zip(SITES, used, strict=False):
        usage.add(Holder(site, "t"), seconds)
    chosen = chosen_of(turns, count, usage)
    busy = [one for one in turns if not one.idle]
    sites = {one.holder.site for one in busy}
    assert all(one in chosen for one in turns if one.idle)
    goes_on = [one for one in chosen if not one.idle]
    if len(sites) <= 1:
        assert len(goes_on) == len(busy)
        return
    here = sum(one.here for one in busy)
    others = len(busy) - here
    assert len(goes_on) == min(count, others + min(here, HERE_AT_ONCE))
    assert sum(one.here for one in goes_on) <= HERE_AT_ONCE
    if not here:
        with_one = {one.holder.site for one in goes_on}
        assert len(with_one) == min(count, len(sites))


def simulated(seconds_of, count, total_s, tick_s=0.05):
    """Run `chosen_of` over simulated time; seconds of each site."""
    moment = 0.0
    usage = DecayedUsage(300.0, now=lambda: moment)
    turns = [turn(site) for site, number in seconds_of.items() for _ in range(number)]
    worked: Counter[str] = Counter()
    while moment < total_s:
        chosen = chosen_of(turns, count, usage)
        for one in turns:
            one.switch(one not in chosen)
            if not one.paused:
                worked[one.holder.site] += tick_s
                usage.add(one.holder, tick_s)
        moment += tick_s
    return worked, turns


@pytest.mark.parametrize("count", [1, 2])
def test_sites_that_never_stop_get_equal_shares_however_much_each_asks_for(count):
    worked, _ = simulated({"a": 10, "b": 1, "c": 2}, count, 120.0)
    share = count * 120.0 / 3
    for site in "abc":
        assert worked[site] == pytest.approx(share, abs=2 * QUANTUM_S + 0.1)


@pytest.mark.parametrize("greedy", [1, 2, 4])
def test_one_that_comes_now_and_then_is_served_as_if_alone(greedy):
    moment = 0.0
    usage = DecayedUsage(300.0, now=lambda: moment)
    turns = [turn(site) for site in SITES[:greedy] for _ in range(5)]
    took = 0.0
    while moment < 200.0:
        if moment > 100.0 and len(turns) == 5 * greedy:
            turns.append(turn("me"))
        chosen = chosen_of(turns, 2, usage)
        for one in turns:
            one.switch(one not in chosen)
            if not one.paused:
                usage.add(one.holder, 0.05)
        moment += 0.05
        mine = [one for one in turns if one.holder.site == "me"]
        if mine and not mine[0].paused:
            took += 0.05
            if took >= 10.0:
                break
    assert moment == pytest.approx(110.0, abs=0.2)


def test_work_is_paused_resumed_and_its_time_counted_without_the_pauses():
    calls: list[str] = []

    def work(site):
        return processors.turn(
            Holder(site, "t"), lambda: calls.append(f"pause {site}"),
            lambda: calls.append(f"resume {site}"),
        )  # fmt: skip

    processors = Processors(1)
    processors.usage.add(Holder("greedy", "t"), 1_000.0)
    with work("greedy") as first:
        with work("modest") as second:
            assert calls == ["pause greedy"]
            assert processors.paused() == {"greedy": 1}
            before_s = first.running_s()
            time.sleep(0.2)
            assert first.running_s() == pytest.approx(before_s, abs=0.01)
            assert second.running_s() >= 0.2
        assert calls == ["pause greedy", "resume greedy"]
    assert not processors.paused()


def test_work_of_one_site_is_left_alone():
    processors = Processors(1)
    calls: list[int] = []
    with (
        processors.turn(Holder("a", "t"), lambda: calls.append(1), lambda: None),
        processors.turn(Holder("a", "u"), lambda: calls.append(1), lambda: None),
    ):
        time.sleep(0.12)
    assert calls == []


def test_one_whose_pause_fails_stops_nobody_else(caplog):
    def gone():
        raise OSError("gone")

    processors = Processors(1)
    processors.usage.add(Holder("a", "t"), 9.0)
    with (
        processors.turn(Holder("a", "t"), gone, gone),
        processors.turn(Holder("b", "t"), lambda: None, lambda: None) as other,
    ):
        assert not other.paused
    assert "could not be paused" in caplog.text
