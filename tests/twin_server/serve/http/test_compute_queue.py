"""What takes long waits in a bounded line; what is asked twice is computed once."""

import asyncio
import threading

import pytest
from starlette.requests import ClientDisconnect, Request

from twin_server.fairness import Holder, acting_for
from twin_server.serve import ComputeQueue, ProblemError
from twin_server.serve.http.body_queue import LARGE, BodyQueue, release_body_slot
from twin_server.serve.http.compute_queue import abandoned

PATIENCE_S = 60.0


class Caller:
    """A request whose client may leave."""

    def __init__(self):
        self.left = asyncio.Event()
        self.request = Request({"type": "http"}, self._receive)

    async def _receive(self):
        await self.left.wait()
        return {"type": "http.disconnect"}


class Works:
    """Work that begins, and ends when told to."""

    def __init__(self):
        self.begun, self.go_on = threading.Semaphore(0), threading.Event()
        self.count, self.saw = 0, []

    def __call__(self):
        self.count += 1
        number = self.count
        self.begun.release()
        while not self.go_on.wait(0.01):
            if abandoned():
                self.saw.append(number)
                raise RuntimeError("abandoned")
        return number


async def until(holds):
    async with asyncio.timeout(PATIENCE_S):
        while not holds():
            await asyncio.sleep(0.005)


async def begun(work, count=1):
    for _ in range(count):
        assert await asyncio.to_thread(work.begun.acquire, timeout=PATIENCE_S)


def in_a_loop(test):
    def run():
        asyncio.run(test())

    run.__name__ = test.__name__
    return run


@in_a_loop
async def test_what_is_asked_by_many_at_once_is_computed_once():
    queue, work = ComputeQueue(2, 10, 10), Works()
    callers = [Caller() for _ in range(50)]
    asked = [
        asyncio.create_task(queue.run(c.request, work, group="a", share="same"))
        for c in callers
    ]
    await begun(work)
    callers[0].left.set()
    with pytest.raises(ClientDisconnect):
        await asked[0]
    work.go_on.set()
    assert [await one for one in asked[1:]] == [1] * 49
    assert queue.waiting == queue.running == 0
    queue.close()


@in_a_loop
async def test_a_full_line_is_said_to_be_at_once_and_empties():
    queue, work = ComputeQueue(1, 3, 2), Works()
    first = asyncio.create_task(queue.run(Caller().request, work, group="a"))
    await begun(work)
    waiting = [
        asyncio.create_task(queue.run(Caller().request, work, group=g)) for g in ("a", "a", "b")
    ]
    await until(lambda: queue.waiting == 3)
    for group, why in (("c", "Too many requests wait"), ("a", "of one kind 2")):
        with pytest.raises(ProblemError) as refused:
            await queue.run(Caller().request, work, group=group)
        assert refused.value.status == 503
        assert why in refused.value.detail
        assert refused.value.headers["Retry-After"] == "5"
    work.go_on.set()
    assert sorted([await first, *[await one for one in waiting]]) == [1, 2, 3, 4]
    assert queue.counts["refused"] == 2
    queue.close()


@in_a_loop
async def test_whom_nobody_waits_for_is_forgotten_or_ended():
    queue, work = ComputeQueue(1, 100, 100), Works()
    callers = [Caller() for _ in range(20)]
    asked = [
        asyncio.create_task(queue.run(c.request, work, group=n)) for n, c in enumerate(callers)
    ]
    await begun(work)
    await until(lambda: queue.waiting == 19)
    for caller in callers[:-1]:
        caller.left.set()
    for one in asked[:-1]:
        with pytest.raises(ClientDisconnect):
            await one
    await begun(work)
    work.go_on.set()
    assert await asked[-1] == 2
    assert (work.count, work.saw) == (2, [1])
    assert queue.counts["abandoned"] == 19
    queue.close()


@in_a_loop
async def test_of_one_twin_one_at_a_time_and_one_place_is_kept_for_what_is_light():
    queue, heavy, light = ComputeQueue(2, 100, 100), Works(), Works()
    slow = [
        asyncio.create_task(queue.run(Caller().request, heavy, group=g))
        for g in ("a", "b", "a")
    ]
    await begun(heavy)
    quick = [
        asyncio.create_task(queue.run(Caller().request, light, group="c", light=True))
        for _ in range(2)
    ]
    await begun(light)
    assert (queue.running, heavy.count, light.count) == (2, 1, 1)
    light.go_on.set()
    assert sorted([await one for one in quick]) == [1, 2]
    assert heavy.count == 1
    heavy.go_on.set()
    assert sorted([await one for one in slow]) == [1, 2, 3]
    queue.close()


def asked_by(queue, holder, work, number, **more):
    """Requests on behalf of a holder, each of a group of its own."""
    with acting_for(holder):
        return [
            asyncio.create_task(queue.run(Caller().request, work, group=(holder, i), **more))
            for i in range(number)
        ]


@in_a_loop
async def test_a_site_that_fills_the_line_keeps_no_other_one_waiting():
    queue, work, mine = ComputeQueue(2, 9, 99, spare=1), Works(), Works()
    greedy = asked_by(queue, Holder("greedy", "t"), work, 30, light=True)
    await begun(work, 2)
    await asyncio.sleep(0)
    refused = [one for one in greedy if one.done()]
    assert (
        len(greedy) - len(refused) == 5
    )  # four fifths of half of nine that wait and two that run
    for one in refused:
        with pytest.raises(ProblemError, match="computations of your") as over:
            await one
        assert (over.value.status, over.value.headers["Retry-After"]) == (429, "5")
    [modest] = asked_by(queue, Holder("modest", "t"), mine, 1)
    await begun(mine)  # although the other site has both threads
    assert (queue.running, work.count) == (3, 2)
    mine.go_on.set()
    work.go_on.set()
    assert await modest == 1
    await asyncio.gather(*(one for one in greedy if one not in refused))
    assert queue.quota.count == 0
    queue.close()


@in_a_loop
async def test_sites_that_wait_are_computed_by_turns():
    queue, first, order = ComputeQueue(1, 99, 99), Works(), []
    [running] = asked_by(queue, Holder("a", "t"), first, 1)
    await begun(first)

    def noted(site):
        return lambda: order.append(site)

    waiting = [
        one
        for site in ("a", "b", "c")
        for one in asked_by(queue, Holder(site, "t"), noted(site), 4)
    ]
    await until(lambda: queue.waiting == 12)
    first.go_on.set()
    await asyncio.gather(running, *waiting)
    rounds = [sorted(order[i : i + 3]) for i in range(2, 11, 3)]
    assert sorted(order[:2]) == ["b", "c"]
    assert rounds == [["a", "b", "c"]] * 3
    queue.close()


@in_a_loop
async def test_a_computation_that_is_cancelled_ends_for_all_who_wait_for_it():
    queue, work = ComputeQueue(1, 9, 9), Works()
    asked = [
        asyncio.create_task(queue.run(Caller().request, work, group="a", share="same"))
        for _ in range(3)
    ]
    await begun(work)
    [held] = queue.quota.held()
    assert held.on_cancel is not None
    held.on_cancel()
    for one in asked:
        with pytest.raises(ProblemError, match="cancelled by an admin") as ended:
            await one
        assert ended.value.status == 503
    await until(lambda: work.saw == [1] and queue.running == 0)
    assert queue.quota.count == 0
    queue.close()


@in_a_loop
async def test_what_fails_fails_for_all_who_wait_and_for_nobody_else():
    queue, work = ComputeQueue(1, 10, 10), Works()

    def fail():
        work()
        raise ProblemError(409, "not-known-yet", "Not yet.")

    asked = [
        asyncio.create_task(queue.run(Caller().request, fail, group="a", share=1))
        for _ in range(3)
    ]
    await begun(work)
    work.go_on.set()
    for one in asked:
        with pytest.raises(ProblemError, match="Not yet"):
            await one
    assert await queue.run(Caller().request, lambda: "sound", group="a", share=1) == "sound"
    queue.close()


@in_a_loop
async def test_large_bodies_are_looked_at_one_at_a_time_and_let_the_next_in():
    looking, most, waits = 0, 0, asyncio.Event()

    async def app(scope, receive, send):
        nonlocal looking, most
        looking += 1
        most = max(most, looking)
        body = (await receive())["body"]
        await asyncio.sleep(0)
        looking -= 1
        if scope["path"] == "/waits":
            release_body_slot(scope)
            await waits.wait()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": body[:1]})

    door = BodyQueue(app, "/streamed/")
    sent = []

    async def ask(path, size=2 * LARGE):
        parts = [b"x" * LARGE] * (size // LARGE) + [b"x" * (size % LARGE)]
        messages = [{"type": "http.request", "body": p, "more_body": True} for p in parts]
        messages[-1]["more_body"] = False

        async def receive():
            return messages.pop(0)

        async def send(message):
            sent.append((path, message))

        await door({"type": "http", "method": "POST", "path": path}, receive, send)

    waiting = asyncio.create_task(ask("/waits"))
    await asyncio.gather(*(ask("/") for _ in range(20)))
    assert most == 1
    assert not waiting.done()
    await ask("/", 10)
    waits.set()
    await waiting
    assert len(sent) == 2 * 22
