"""A router starts, says so, carries, and ends at once when it is told to."""

import signal
import subprocess
import sys
import textwrap
import threading

import pytest

from slowtime_services import router
from slowtime_services.bus import BusUnreachableError, ZenohBus


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_router_process_ends_cleanly_on_a_signal(free_port, eventually, number):
    there = f"tcp/127.0.0.1:{free_port()}"
    script = f"""
        from slowtime_services import router
        router.run([{there!r}], ready=lambda listen: print(*listen, flush=True))
        print("ended")
    """
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"{there}\n"
        assert router.check(there)
        got: list[bytes] = []
        with ZenohBus("client", connect=[there]) as one, ZenohBus("peer", [there]) as edge:
            one.subscribe("a", lambda sample: got.append(sample.payload))

            def heard():
                edge.publish("a", b"x", encoding="x")
                return bool(got)

            assert eventually(heard)
            process.send_signal(number)
            assert process.wait(60) == 0
        assert process.stdout.read() == "ended\n"
    assert not router.check(there, timeout_s=0.2)


def test_a_router_in_a_thread_ends_by_its_event(free_port):
    there, stop, ready = f"tcp/127.0.0.1:{free_port()}", threading.Event(), threading.Event()
    thread = threading.Thread(
        target=lambda: router.run([there], stop=stop, ready=lambda _: ready.set())
    )
    thread.start()
    assert ready.wait(60)
    assert router.check(there)
    stop.set()
    thread.join(60)
    assert not thread.is_alive()


def test_the_signals_are_given_back(free_port):
    before = signal.getsignal(signal.SIGTERM)
    stop = threading.Event()
    stop.set()
    router.run([f"tcp/127.0.0.1:{free_port()}"], stop=stop)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_port_that_is_taken_ends_it_with_its_reason(endpoint):
    with pytest.raises(BusUnreachableError, match="may have the port"):
        router.run([endpoint])


def test_a_check_of_nobody_takes_no_longer_than_it_may(monkeypatch):
    asked = []

    def nobody(mode, connect, *, open_timeout_s):
        asked.append(open_timeout_s)
        raise BusUnreachableError("nobody there")

    monkeypatch.setattr(router, "ZenohBus", nobody)
    assert not router.check("tcp/127.0.0.1:1", timeout_s=0.3)
    assert asked == [0.3]
