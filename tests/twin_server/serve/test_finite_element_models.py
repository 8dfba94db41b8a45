"""A finite-element model over REST: registered, estimated live, exported."""

import json

import pytest

from slowtime_schemas.streams import REGISTRATION
from tests.twin_server.towers import GROUPS, LOSS, epoch, full_model, tower
from twin_server.serve.api import LARGEST_MODEL
from twin_server.settings import AdmissionSettings

TOWER = "/api/v1/twins/lab.tower"


@pytest.fixture(scope="module")
def towered(serving, frame, eventually):
    """A server with a tower whose upper legs have been weaker since the 8th epoch.

    Models are taken although they are larger than other bodies may be.
    """
    started, made = serving(max_body_bytes=1024), frame(seed=5, asset="tower")
    model = full_model()
    body = {
        "changes": "elements",
        "model": tower(),
        "parameters": dict.fromkeys(GROUPS, 0.3),
        "learn_epochs": 6,
    }
    assert started.client.put(TOWER, json=body).status_code == 201
    started.feed([epoch(made, model, i, LOSS if i >= 8 else (0.0,) * 3) for i in range(14)])
    assert eventually(lambda: started.count("lab.tower") == 14)
    return started


def test_a_twin_of_a_frame_names_the_group_that_changed(towered):
    twin = towered.get(TOWER).json()
    assert list(twin["elements"]) == list(GROUPS)
    assert twin["suspects"] == ["upper legs"]
    found = twin["elements"]["upper legs"]
    assert found["lo"] < -0.1 < found["hi"]
    assert found["hi"] < -0.05
    kept = twin["registration"]["model"]
    assert kept["slowtime_model"] == 2
    assert {part["kind"] for part in kept["elements"]} == {"matrix"}


def test_a_registration_with_the_largest_model_travels():
    assert REGISTRATION.max_bytes > LARGEST_MODEL
    assert AdmissionSettings().max_payload_bytes >= REGISTRATION.max_bytes


def test_a_model_larger_than_other_bodies_is_taken_and_matrices_of_files_are_not(towered):
    large = tower()
    large["sensors"] = [
        {"channel": f"{node}.{c}{way}", "node": f"{node}.{c}", "direction": f"u{way}"}
        for node in (1, 2) for c in range(4) for way in "xyz"
    ]  # fmt: skip
    put = towered.client.put(
        "/api/v1/twins/lab.large",
        json={"changes": "elements", "model": large},
    )
    assert put.status_code == 201
    stored = put.json()["registration"]
    assert len(json.dumps(stored)) > 20_000
    # What was answered can be sent again as it is.
    again = towered.client.put("/api/v1/twins/lab.large", json=stored)
    assert again.status_code in (200, 201), again.text
    files = {"slowtime_model": 2, "matrices": {"stiffness": "K.mtx", "mass": "M.mtx"}}
    refused = towered.client.put(
        "/api/v1/twins/lab.files", json={"changes": "elements", "model": files}
    )
    assert refused.status_code == 422
    assert "slowtime model reduce MODEL" in refused.text


@pytest.mark.long
def test_a_load_on_a_twin_of_a_frame_is_simulated(towered):
    order = {
        "load": {"kind": "harmonic", "amplitude": 10.0, "frequency_hz": 2.0},
        "on": "2.0 ux", "duration_s": 1.0, "rate_hz": 100.0, "seed": 1,
    }  # fmt: skip
    answer = towered.client.post(f"{TOWER}/simulate", json=order)
    assert answer.status_code == 200, answer.text
    assert "2.0 ux" in answer.json()["outputs"]
