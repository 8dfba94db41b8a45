"""A server with twelve beams that lose stiffness at rates of their own, and their yard."""

from typing import Any

import pytest

BEAMS = [f"beam-{i}" for i in range(12)]
IDS = [f"lab.{name}" for name in BEAMS]
YARD: dict[str, Any] = {
    "name": "Yard",
    "kind": "site",
    "members": ["lab.line", *IDS[3:]],
    "tree": {
        "series": [
            "lab.line",
            {"parallel": IDS[3:6]},
            {"k": 2, "of": [*IDS[6:9], IDS[3]]},
            {"parallel": [{"series": [IDS[9], IDS[10]]}, IDS[11]]},
        ]
    },
    "dependence": [
        {"members": IDS[6:9], "rho": 0.5},
        {"members": [IDS[3], IDS[4]], "beta": 0.2},
    ],
    "horizon": 30.0,
}
LINE: dict[str, Any] = {
    "kind": "line",
    "members": IDS[:3],
    "tree": {"k": 2, "of": IDS[:3]},
    "failing": {IDS[0]: {"quantity": "stiffness_change", "at": -0.3}},
}


@pytest.fixture(scope="module")
def yard(serving, ageing, eventually):
    server = serving()
    for number, (name, twin) in enumerate(zip(BEAMS, IDS, strict=True)):
        body = {
            "nominal": {"frequency_hz": 3.0, "damping_ratio": 0.02},
            "forecast": {"thresholds": [{"quantity": "stiffness_change", "at": -0.2}]},
        }
        assert server.client.put(f"/api/v1/twins/{twin}", json=body).status_code == 201
        # The last has been here for three epochs only.
        count = 3 if number == 11 else 60
        loss = 0.10 + 0.012 * number
        server.feed(ageing(count, loss=loss, sd=0.01, seed=number, asset=name))
    assert eventually(lambda: [server.count(twin) for twin in IDS] == [60] * 11 + [3])
    for name, body in (("line", LINE), ("yard", YARD)):
        answer = server.client.put(f"/api/v1/composites/lab.{name}", json=body)
        assert answer.status_code == 201, answer.text
    return server


@pytest.fixture(scope="module")
def idle(serving):
    """The same yard before any reading."""
    server = serving()
    for twin in IDS:
        assert server.client.put(f"/api/v1/twins/{twin}", json={}).status_code == 201
    for name, body in (("line", LINE), ("yard", YARD)):
        answer = server.client.put(f"/api/v1/composites/lab.{name}", json=body)
        assert answer.status_code == 201, answer.text
    return server
