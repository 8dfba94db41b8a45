"""A server with a beam that ages, and a frame whose middle storey does."""

import pytest
from pydantic_core import from_json


@pytest.fixture(scope="module")
def house(serving, ageing, frame, eventually):
    server = serving()
    beam = {"nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02}, "name": "Beam"}
    framed = frame(seed=3)
    for twin, body in (("lab.beam", beam), ("lab.frame", framed.registration())):
        assert server.client.put(f"/api/v1/twins/{twin}", json=body).status_code == 201
    server.feed(ageing(300))
    server.feed(framed.epoch(i, (0.0, -0.2 if i > 25 else 0.0, 0.0)) for i in range(40))
    assert eventually(lambda: (server.count(), server.count("lab.frame")) == (300, 40))
    return server


@pytest.fixture(scope="module")
def points(house):
    """States of a twin as the history gives them."""

    def of(twin_id):
        answer = house.get(f"/api/v1/twins/{twin_id}/history")
        return from_json(answer.content)["points"]

    return of
