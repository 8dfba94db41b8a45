"""What the tests of the services share: a router on loopback, and patience."""

import socket
import time

import pytest

from slowtime_services.bus import ZenohBus


def _free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def _eventually(condition, timeout_s=10.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


@pytest.fixture(scope="session")
def free_port():
    """A TCP port nobody uses, a new one at each call."""
    return _free_port


@pytest.fixture(scope="session")
def eventually():
    """Whether a condition becomes true in good time."""
    return _eventually


@pytest.fixture(scope="session")
def endpoint():
    """A router for the session, on loopback."""
    here = f"tcp/127.0.0.1:{_free_port()}"
    with ZenohBus("router", listen=[here]):
        yield here
