"""Tables are given a few at a time, and end with who asked for them."""

import asyncio

import pytest

from twin_server.serve import ProblemError
from twin_server.serve.exports.files import Files


def scope():
    return {"type": "http", "method": "GET", "asgi": {"spec_version": "2.3"}}


def test_more_than_may_be_under_way_are_told_when_to_come_back():
    under_way, sent = Files(2), []

    async def receive():
        await asyncio.Event().wait()

    async def send(message):
        sent.append(message)

    given = [under_way.given(iter([b"a", b"b"]), "text/csv", {}) for _ in range(2)]
    with pytest.raises(ProblemError, match=r"Allowed: 2 at once") as refused:
        under_way.given(iter([b""]), "text/csv", {})
    assert (refused.value.status, refused.value.headers["Retry-After"]) == (503, "10")
    asyncio.run(given[0](scope(), receive, send))
    assert b"".join(m.get("body", b"") for m in sent) == b"ab"
    under_way.given(iter([b""]), "text/csv", {})


def test_one_whose_client_leaves_makes_room_for_another():
    under_way, made = Files(1), []

    def pieces():
        for number in range(1_000):
            made.append(number)
            yield b"x"

    async def leave():
        return {"type": "http.disconnect"}

    async def send(_):
        await asyncio.sleep(0.01)

    asyncio.run(under_way.given(pieces(), "text/csv", {})(scope(), leave, send))
    assert len(made) < 1_000
    under_way.given(iter([b""]), "text/csv", {})
