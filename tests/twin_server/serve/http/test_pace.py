"""A sender must keep its rate to the end: a fast beginning buys no slow one."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_server.fairness import ALONE, Quota
from twin_server.identity.principals import EVERYBODY
from twin_server.pipeline.uploads import Upload
from twin_server.serve import ProblemError
from twin_server.serve.http.pace import Pace
from twin_server.settings import RecordingSettings

RATE, PATIENCE_S = 1_000.0, 30.0


@given(fast=st.integers(0, 10**9), each=st.integers(0, 100))
def test_whatever_came_before_a_slow_end_is_noticed_within_its_patience(fast, each):
    pace = Pace(RATE, PATIENCE_S)
    assert pace.take(fast, 0.1)
    seconds = 0
    while pace.take(each, 1.0):
        seconds += 1
        assert seconds <= PATIENCE_S / (1 - each / RATE)


@given(st.lists(st.floats(0.0, PATIENCE_S - 1.0), max_size=50))
def test_who_keeps_the_rate_is_never_cut_off_however_unevenly_it_sends(pauses):
    pace = Pace(RATE, PATIENCE_S)
    for pause_s in pauses:
        assert pace.take(0, pause_s)
        assert pace.take(int(RATE * pause_s) + 1, 0.0)


def test_an_upload_that_begins_fast_and_goes_on_slowly_is_ended():
    settings = RecordingSettings(patience_s=0.2, slowest_bytes_per_s=10_000.0)
    quota = Quota("uploads", 1, setting="s")

    async def body():
        yield bytes(10**6)
        while True:
            await asyncio.sleep(0.05)
            yield b"x"

    async def read():
        upload = Upload("a.mcap", EVERYBODY, quota.take(ALONE, "it"), settings)
        return [chunk async for chunk in upload.chunks(body())]

    with pytest.raises(ProblemError, match=r"1,000,00\d bytes came, .*too slowly") as ended:
        asyncio.run(asyncio.wait_for(read(), 30))
    assert ended.value.status == 408
