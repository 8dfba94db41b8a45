"""Eighty callers for what takes long lock nobody out, cost no feature, leave no trace."""

import asyncio
import collections
import json
import threading

import httpx
import pytest

CALLERS = 80
ROUNDS = 2
TWIN = "/api/v1/twins/lab.beam"
WHITE = {"kind": "white", "psd": 1e-3}


def invalid(number):
    return "POST", f"{TWIN}/simulate", {"load": WHITE, "outputs": [f"nowhere{number}"]}


def heavy(number):
    order = {"load": WHITE, "duration_s": 20.0, "rate_hz": 100.0, "draws": 100}
    return "POST", f"{TWIN}/simulate", order | {"seed": number}


def of_the_past(number):
    return "GET", f"{TWIN}/forecast?at=slow:{50 + number / 4}", None


def malformed(number):
    samples = [float(number)] * 9_000 + ["x"]
    order = {"load": {"kind": "recorded", "samples": samples}, "rate_hz": 100.0}
    return "POST", f"{TWIN}/simulate", order


KINDS = {invalid: {422}, malformed: {422}, heavy: {200, 503}, of_the_past: {200, 503}}


@pytest.mark.long
def test_eighty_callers_lock_nobody_out(serving, ageing, eventually):
    server = serving()
    first = ageing(100)
    server.feed(first)
    assert eventually(lambda: server.count() == 100)
    server.client.get(f"{TWIN}/forecast")
    answered: collections.Counter[str] = collections.Counter()
    done = threading.Event()

    async def caller(client, number):
        kind, allowed = list(KINDS.items())[number % len(KINDS)]
        for turn in range(ROUNDS):
            method, path, body = kind(number + turn * CALLERS)
            content = None if body is None else json.dumps(body)
            answer = await client.request(method, path, content=content)
            answered[kind.__name__] += answer.status_code in allowed
            if answer.status_code == 503:
                assert int(answer.headers["retry-after"]) > 0
                assert "serve.max_waiting" in answer.json()["detail"]

    async def siege():
        limits = httpx.Limits(max_connections=CALLERS)
        headers = {"Content-Type": "application/json"}
        async with httpx.AsyncClient(
            base_url=server.url, timeout=600, limits=limits, headers=headers
        ) as client:
            await asyncio.gather(*(caller(client, number) for number in range(CALLERS)))
        done.set()

    besieging = threading.Thread(target=asyncio.run, args=(siege(),))
    besieging.start()
    healthy = 0
    more = ageing(60, first=100)
    while not done.is_set() or more:
        assert server.get("/healthz").json() == {"status": "ok"}
        healthy += 1
        server.feed(more[:3])
        more = more[3:]
    besieging.join()
    assert answered == {kind.__name__: CALLERS * ROUNDS // len(KINDS) for kind in KINDS}
    assert healthy >= 20
    assert eventually(lambda: server.count() == 160)
    # All is as before they came.
    assert server.get(f"{TWIN}/forecast").json()["points"]
    order = {"load": WHITE, "duration_s": 1.0, "rate_hz": 50.0, "draws": 20}
    assert server.client.post(f"{TWIN}/simulate", json=order).status_code == 200
    metrics = server.get("/metrics").text
    for name in ("waiting", "running"):
        assert f"slowtime_twin_work_{name} 0\n" in metrics


@pytest.mark.long
def test_what_callers_wait_for_who_have_left_is_not_computed(serving, ageing, eventually):
    server = serving()
    server.feed(ageing(100))
    assert eventually(lambda: server.count() == 100)

    async def leave():
        async with httpx.AsyncClient(base_url=server.url) as client:
            for number in range(40):
                method, path, body = heavy(number)
                with pytest.raises(httpx.TimeoutException):
                    await client.request(method, path, json=body, timeout=0.02)

    asyncio.run(leave())
    assert eventually(lambda: "slowtime_twin_work_waiting 0\n" in server.get("/metrics").text)
    assert eventually(lambda: "slowtime_twin_work_running 0\n" in server.get("/metrics").text)
    assert server.get(f"{TWIN}/forecast").json()["points"]
