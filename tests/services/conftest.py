"""What the tests of the services share: a router on loopback, and patience."""

import socket
import time

import pytest

from slowtime_schemas.messages import Features, Mode, Quality
from slowtime_schemas.quantities import Quantity
from slowtime_services.bus import ZenohBus


def _free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def _eventually(condition, timeout_s=60.0):
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


@pytest.fixture(scope="session")
def features_of():
    """Features messages of one run of one edge."""

    def make(count, *, site="lab", asset="beam", boot="b1", first=0):
        return [
            Features(
                site=site,
                asset=asset,
                boot=boot,
                sequence=sequence,
                t_ns=1_700_000_000_000_000_000 + sequence * 10**9,
                start_ns=1_700_000_000_000_000_000,
                slow_time=float(sequence),
                method="ambient",
                modes=(
                    Mode(
                        frequency_hz=Quantity(value=3.0 + 1e-3 * sequence, sd=0.002),
                        damping_ratio=Quantity(value=0.02, sd=0.001),
                    ),
                ),
                quality=Quality(samples=1000),
            )
            for sequence in range(first, first + count)
        ]

    return make
