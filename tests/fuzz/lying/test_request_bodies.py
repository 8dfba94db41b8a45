"""Bodies of requests that lie, at each value of each route that takes one."""

import json
import resource
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.slowtime_cli.broken_inputs import INTERNALS
from tests.twin_server.serve.tenants.house import House

MOST_S, MOST_MIB = 2.0, 100.0
"""Processor time and memory that a body may take beyond an honest one."""

HONEST: dict[tuple[str, str], Any] = {
    ("put", "/twins/{twin_id}"): {
        "name": "Beam",
        "changes": "stiffness",
        "nominal": {"frequency_hz": 2.0, "damping_ratio": 0.01},
    },
    ("post", "/twins/{twin_id}/changes"): {
        "before": {"name": "Beam"}, "after": {"name": "Girder"}, "person": "Ann",
        "text": "as in the plans",
    },
    ("post", "/twins/{twin_id}/events"): {
        "event": "r1", "kind": "repair", "slow_time": 4.0, "person": "Ann", "text": "new bolt",
    },
    ("post", "/twins/{twin_id}/simulate"): {
        "load": {"kind": "step", "amplitude": 0.1}, "duration_s": 2.0, "rate_hz": 50.0,
        "draws": 20,
    },
    ("post", "/twins/{twin_id}/diagnoses"): {
        "recordings": {"files": ["monday.mcap"]}, "holdout_s": 1.0, "quick": True,
    },
    ("post", "/twins/{twin_id}/alarms/test"): {"receiver": "lab-ops"},
    ("post", "/twins/{twin_id}/alarms/{event_id}/acknowledge"): {"by": "Ann", "note": "seen"},
    ("put", "/composites/{composite_id}"): {
        "name": "Line", "kind": "line", "members": ["lab.beam"],
    },
    ("post", "/recordings/{name}/replay"): {"speed": 1.0},
}  # fmt: skip
"""A body that is read, for each route that the OpenAPI document gives one."""

PLACES = {
    "twin_id": "lab.beam", "event_id": "0" * 32, "composite_id": "lab.line", "name": "m.mcap",
}  # fmt: skip

LIES: dict[str, tuple[bytes, str]] = {
    "digits": (b"9" * 5000, "5,000 digits"),
    "some digits": (b"9" * 401, "401 digits"),
    "large digits": (b"9" * 330, "larger than 1.8e308"),
    "infinity": (b"1e400", "larger than 1.8e308"),
    "lists": (b"[" * 100_000, ""),  # of routes that allow less, as too large
    "closed lists": (b"[" * 20_000 + b"]" * 20_000, "levels deep. Allowed: 64"),
    "tables": (b'{"a":' * 10_000 + b"1" + b"}" * 10_000, "levels deep. Allowed: 64"),
    "other bytes": (b'"\xff\xfe"', "not text"),
    "key twice": (b'{"a": 1, "b": 2, "a": 3}', "`a` stands twice"),
    "half a letter": (b'"\\ud800"', ""),
    "open text": (b'"', "not JSON"),
    "values": (b"[" + b"1," * 30_000 + b"1]", ""),
    "NaN": (b"NaN", ""),
    "a wrong type": (b'[{"a": null}]', ""),
}
"""What is written in the place of a value, and what the answer says of it."""


@pytest.fixture(scope="module")
def house(tmp_path_factory) -> Iterator[House]:
    with House(tmp_path_factory.mktemp("house")) as made:
        assert made.ask("lab", "operator", "PUT", "/twins/lab.beam", json={}).status_code == 201
        yield made


def _operations(document: dict[str, Any]) -> set[tuple[str, str]]:
    return {
        (method, path.removeprefix("/api/v1"))
        for path, item in document["paths"].items()
        for method, operation in item.items()
        if "application/json" in operation.get("requestBody", {}).get("content", ())
    }


def _leaves(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of each value within a body, and that of the whole."""
    yield at
    if isinstance(value, dict | list):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(one, (*at, key))


def _with(body: Any, at: tuple[Any, ...], lie: bytes) -> bytes:
    if not at:
        return lie
    copy = json.loads(json.dumps(body))
    holder = copy
    for key in at[:-1]:
        holder = holder[key]
    holder[at[-1]] = "@lie@"
    return json.dumps(copy).encode().replace(b'"@lie@"', lie)


def _ask(house: House, operation: tuple[str, str], body: bytes) -> Any:
    method, path = operation
    headers = {"Content-Type": "application/json"}
    return house.ask(
        "*", "admin", method.upper(), path.format(**PLACES), content=body, headers=headers
    )


def test_each_route_that_takes_a_document_is_tried(house):
    assert _operations(house.document) == set(HONEST)


@pytest.mark.parametrize("operation", HONEST, ids=lambda one: " ".join(one))
def test_an_honest_body_is_read(house, operation):
    answer = _ask(house, operation, json.dumps(HONEST[operation]).encode())
    assert answer.status_code not in (400, 413, 422), answer.text


@pytest.mark.long
@pytest.mark.parametrize("name", LIES)
@pytest.mark.parametrize("operation", HONEST, ids=lambda one: " ".join(one))
def test_a_lying_body_is_refused_with_a_reason(house, operation, name):
    body, (lie, why) = HONEST[operation], LIES[name]
    for at in _leaves(body):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        began = time.process_time()
        answer = _ask(house, operation, _with(body, at, lie))
        took = time.process_time() - began
        swelled = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) / 1024
        assert 400 <= answer.status_code < 500, (at, answer.text)
        assert answer.headers["content-type"] == "application/problem+json"
        assert why in answer.json()["detail"], (at, answer.text)
        assert not INTERNALS.search(answer.text), (at, answer.text)
        assert len(answer.content) < 8_000
        assert took < MOST_S
        assert swelled < MOST_MIB


@pytest.mark.parametrize(
    ("item", "count"), [("1", 480_000), ("{}", 240_000), ('{"id": 1}', 120_000)]
)
def test_a_large_body_of_faults_is_left_at_the_first(house, item, count):
    """Each fault would take 25 µs and 2 kB."""
    nodes = ",".join([item] * count)
    body = f'{{"model": {{"slowtime_model": 1, "name": "rig", "nodes": [{nodes}]}}}}'
    began = time.process_time()
    answer = _ask(house, ("put", "/twins/{twin_id}"), body.encode())
    assert time.process_time() - began < MOST_S
    assert answer.status_code == 422
    assert "nodes.0" in answer.json()["detail"]


@pytest.mark.parametrize("operation", HONEST, ids=lambda one: " ".join(one))
def test_a_key_that_stands_twice_is_not_read_as_the_last(house, operation):
    body = json.dumps(HONEST[operation])
    key, value = next(iter(HONEST[operation].items()))
    twice = f"{body[:-1]}, {json.dumps(key)}: {json.dumps(value)}}}"
    answer = _ask(house, operation, twice.encode())
    assert answer.status_code == 422
    assert f"`{key}` stands twice" in answer.json()["detail"]
