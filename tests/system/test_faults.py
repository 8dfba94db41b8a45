"""What dies, comes back, and has lost nothing."""

import time

import pytest

pytestmark = pytest.mark.system

RATE = 50
FEATURES = 1500
LISTENED_TO = {
    "site": "lab",
    "asset": "beam",
    "extract": {"method": "peak"},
    "publish": {"linger_s": 60.0},
    "input": {
        "kind": "simulated",
        "every_s": 1 / RATE,
        "structure": {
            "epochs": FEATURES,
            "seconds": 2.0,
            "interval_s": 2.0,
            "rate_hz": 64.0,
            "seed": 5,
        },
    },
}


@pytest.mark.long
def test_a_dead_router_and_a_killed_twin_lose_and_double_nothing(house, capsys):
    house.router()
    house.twin()
    house.edge(LISTENED_TO)
    house.until(lambda: len(house.history("lab.beam")) > 100, "the first features")
    house.kill("router")
    time.sleep(10.0)
    house.router()
    house.until(lambda: len(house.history("lab.beam")) > 700, "what the outage held back")
    house.kill("twin")
    time.sleep(1.0)
    house.twin()
    assert house.wait("edge", 120.0) == 0
    house.until(lambda: len(house.history("lab.beam")) >= FEATURES, "the rest")
    points = house.history("lab.beam")
    with capsys.disabled():
        print(
            f"\n{len(points)} of {FEATURES} features in history at {RATE}/s after 10 s without "
            "router and a SIGKILL of the twin server"
        )
    assert [point["sequence"] for point in points] == list(range(FEATURES))
    assert len({point["boot"] for point in points}) == 1
    assert house.end("twin") == 0
    assert house.end("router") == 0
