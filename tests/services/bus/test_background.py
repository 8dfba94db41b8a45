"""A bus that is opened in the background: silent until then, and like any other afterwards."""

import math
import threading

import pytest

from slowtime_services.bus import BackgroundBus, BusClosedError, BusUnreachableError, MemoryBus


class Router:
    """Gives a bus once it is there."""

    def __init__(self):
        self.bus = MemoryBus()
        self.there, self.asked = threading.Event(), threading.Semaphore(0)

    def opened(self):
        self.asked.release()
        if not self.there.is_set():
            raise BusUnreachableError("No router answers.")
        return self.bus


def connected(bus: BackgroundBus) -> bool:
    return bus.connected


def test_what_was_declared_before_there_was_a_bus_holds_once_there_is_one(caplog):
    router, heard, seen = Router(), [], []
    with BackgroundBus(router.opened, say_every_s=0.0) as late:
        late.subscribe("a/*", lambda sample: heard.append(sample.payload))
        closed = late.subscribe("a/*", lambda sample: heard.append(b"closed"))
        late.answer("q", lambda query: [(query.key, b"answer")])
        late.watch("alive/*", lambda key, alive: seen.append((key, alive)))
        handle = late.announce("alive/late")
        late.publish("a/b", b"nobody hears it", encoding="x")
        assert late.ask("q") == []
        assert not connected(late)
        assert late.watch_delay_s == math.inf, "who is there is not known without a bus"
        closed.close()
        assert router.asked.acquire(timeout=60)
        router.there.set()
        assert late.wait(60)
        assert connected(late)
        assert late.watch_delay_s == router.bus.watch_delay_s
        assert [one.payload for one in router.bus.ask("q")] == [b"answer"]
        router.bus.publish("a/b", b"heard", encoding="x")
        late.publish("a/c", b"sent", encoding="x")
        assert heard == [b"heard", b"sent"]
        router.bus.announce("alive/other")
        assert ("alive/other", True) in seen
        handle.close()
        assert ("alive/late", False) in seen
    assert "No router answers" in caplog.text
    with pytest.raises(BusClosedError):
        late.publish("a/b", b"x", encoding="x")


def test_one_that_never_opens_can_be_closed():
    router = Router()
    late = BackgroundBus(router.opened)
    assert router.asked.acquire(timeout=60)
    assert not late.wait(0.0)
    late.close()
