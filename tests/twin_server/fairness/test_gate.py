"""Turns: each site has its share to within one, nobody waits for ever, and none is lost."""

import asyncio
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from twin_server.fairness import (
    ALONE,
    DecayedUsage,
    FairGate,
    Holder,
    acting_for,
)


class Turns:
    """A gate whose turns take a second of a clock that moves by hand."""

    def __init__(self, count):
        self.moment, self.order = 0.0, []
        self.gate = FairGate(count, DecayedUsage(1e9, now=lambda: self.moment))
        self.most = 0

    async def work(self, holder, turns=1):
        for _ in range(turns):
            with acting_for(holder):
                async with self.gate:
                    self.order.append(holder)
                    self.gate._usage.add(holder, 1.0)
                    self.most = max(self.most, self.gate._total)
                    await asyncio.sleep(0)


@given(
    waiting=st.lists(st.integers(1, 30), min_size=2, max_size=5),
    tokens=st.integers(1, 3),
    count=st.integers(1, 4),
)
def test_sites_that_wait_get_turns_to_within_one_of_each_other(waiting, tokens, count):
    turns = Turns(count)

    async def all_of_them():
        tasks = [
            turns.work(Holder(f"site-{site}", f"token-{i % tokens}"))
            for site, number in enumerate(waiting)
            for i in range(number)
        ]
        await asyncio.gather(*tasks)

    asyncio.run(all_of_them())
    assert Counter(one.site for one in turns.order) == {
        f"site-{site}": number for site, number in enumerate(waiting)
    }
    assert turns.most <= count
    # Until the first site has none left, the counts of all differ by one at most, beside those
    # that were let in before anybody waited.
    fewest = min(waiting)
    done: Counter[str] = Counter()
    for one in turns.order:
        if min(done[f"site-{site}"] for site in range(len(waiting))) >= fewest - 1:
            break
        done[one.site] += 1
        counts = [done[f"site-{site}"] for site in range(len(waiting))]
        assert max(counts) - min(counts) <= 1 + count


def test_one_site_that_asks_for_a_thousand_delays_another_by_one_turn():
    turns = Turns(1)

    async def both():
        greedy = [asyncio.ensure_future(turns.work(Holder("a", "t"))) for _ in range(1_000)]
        await asyncio.sleep(0)
        await turns.work(Holder("b", "t"))
        seen = len(turns.order)
        await asyncio.gather(*greedy)
        return seen

    assert asyncio.run(both()) <= 3
    assert len(turns.order) == 1_001


def test_who_leaves_while_it_waits_or_works_frees_its_turn():
    turns = Turns(1)

    async def leave():
        first, second, third = (
            asyncio.ensure_future(turns.work(Holder(site, "t"))) for site in "abc"
        )
        await asyncio.sleep(0)
        second.cancel()
        first.cancel()
        await asyncio.gather(first, second, return_exceptions=True)
        await asyncio.wait_for(third, 10)

    asyncio.run(leave())
    assert [one.site for one in turns.order] == ["a", "c"]
    assert (turns.gate._total, turns.gate._waiting, turns.gate._turns) == (0, {}, {})


def test_a_site_keeps_one_turn_of_four_free_and_everybody_alone_none():
    async def begun(holder):
        gate = FairGate(4)
        waiting = [asyncio.ensure_future(gate.acquire(holder)) for _ in range(9)]
        await asyncio.sleep(0)
        number = sum(one.done() for one in waiting)
        for one in waiting:
            one.cancel()
        return number

    assert asyncio.run(begun(Holder("a", "t"))) == 3
    assert asyncio.run(begun(ALONE)) == 4


def test_a_gate_serves_one_event_loop_after_another():
    turns = Turns(1)
    for _ in range(2):
        asyncio.run(turns.work(Holder("a", "t"), 2))
    assert len(turns.order) == 4
