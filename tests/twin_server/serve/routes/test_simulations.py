"""What-if over REST: today's twin under a load, with bands that are those of its doubt."""

from typing import Any

import numpy as np
import pytest

from slowtime.dynamics.builders import shear_frame
from slowtime.dynamics.description import assemble
from slowtime.dynamics.modes import undamped_modes
from twin_server.orders import SIMULATION_EXAMPLES, SimulationOrder
from twin_server.serve.routes import simulations

TWIN, FRAME = "/api/v1/twins/lab.beam", "/api/v1/twins/lab.frame"
SHAKEN: dict[str, Any] = {
    "load": {"kind": "harmonic", "amplitude": 0.5, "frequency_hz": 2.6},
    "draws": 60,
}
PUSHED = {"load": {"kind": "step", "amplitude": 1000.0}, "on": "floor3"}


def asked(server, order, twin=TWIN):
    answer = server.client.post(f"{twin}/simulate", json=order)
    assert answer.status_code == 200, answer.text
    body = answer.json()
    simulations.SimulationModel.model_validate(body)
    return body


def refused(server, order, twin=TWIN):
    answer = server.client.post(f"{twin}/simulate", json=order)
    assert answer.headers["content-type"] == "application/problem+json", answer.text[:500]
    return answer.status_code, answer.json()["detail"]


@pytest.fixture(scope="module")
def framed(serving, frame, eventually):
    """A server with a frame whose second storey has been weaker since its 22nd epoch."""
    started, made = serving(), frame(seed=1)
    assert started.client.put(FRAME, json=made.registration()).status_code == 201
    started.feed([made.epoch(i, (0.0, -0.08 * (i >= 22), 0.0)) for i in range(36)])
    assert eventually(lambda: started.count("lab.frame") == 36)
    return started


@pytest.mark.long
def test_the_twin_that_is_run_is_that_of_today(server):
    body = asked(server, SHAKEN)
    assert body["slow_time"] == 299.0
    assert body["today"]["changes"]["stiffness_change"]["value"] == pytest.approx(
        -0.2, abs=0.02
    )
    (frequency,) = body["today"]["frequencies_hz"]
    assert frequency["value"] == pytest.approx(3.0 * np.sqrt(0.8), rel=0.003)
    assert frequency["lo"] < 3.0 * np.sqrt(0.8) < frequency["hi"]
    assert body["unit"] == "m/s^2"
    assert body["frame"] == "absolute"
    assert list(body["outputs"]) == ["mass"]
    assert {"mass_change is none", "the structure is linear"} <= set(body["assumed"])
    assert body["valid"] is True


@pytest.mark.long
def test_bands_hold_the_truth_and_are_the_wider_the_nearer_to_resonance(server):
    order = SHAKEN | {"quantity": "displacement", "duration_s": 10.0, "rate_hz": 60.0}
    near = asked(server, order)
    out = near["outputs"]["mass"]
    assert len(near["t_s"]) == len(out["value"]) == len(out["lo"]) == 600
    omega, pushed = 2 * np.pi * 3.0 * np.sqrt(0.8), 2 * np.pi * 2.6
    damping = near["today"]["damping_ratios"][0]["value"]
    size = 0.5 / np.hypot(omega**2 - pushed**2, 2 * damping * omega * pushed)
    assert out["peak"]["lo"] < 2 * size
    assert out["peak"]["hi"] > size
    off = order | {"load": SHAKEN["load"] | {"frequency_hz": 0.5}}
    far = asked(server, off)["outputs"]["mass"]
    assert out["rms"]["sd"] / out["rms"]["value"] > 3 * far["rms"]["sd"] / far["rms"]["value"]
    assert np.all(np.array(out["lo"]) <= np.array(out["hi"]))


def test_the_same_order_gives_the_same_answer_and_another_seed_another(server):
    order = {"load": {"kind": "white", "psd": 0.01}, "draws": 30, "seed": 5, "duration_s": 3.0}
    first, again = asked(server, order), asked(server, order)
    assert first == again
    other = asked(server, order | {"seed": 6})
    assert other["load"] != first["load"]
    assert np.var(first["load"]) == pytest.approx(0.5 * 0.01 * first["rate_hz"], rel=0.5)


def test_a_recorded_load_is_run_sample_by_sample(server):
    samples = [0.0, 1.0, 0.5, 0.0, 0.0, 0.0]
    order = {"load": {"kind": "recorded", "samples": samples}, "rate_hz": 50.0, "draws": 20}
    body = asked(server, order)
    assert body["load"] == samples
    assert body["t_s"] == [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]
    assert body["outputs"]["mass"]["value"][0] == 0.0


@pytest.mark.long
def test_a_frame_bends_where_it_is_weak_and_its_elements_err_together(framed):
    order = PUSHED | {"quantity": "displacement", "duration_s": 60.0, "rate_hz": 60.0}
    body = asked(framed, order | {"draws": 60, "outputs": ["floor1", "floor3"]}, FRAME)
    assert list(body["outputs"]) == ["floor1", "floor3"]
    out = body["outputs"]["floor3"]
    still = sum(1000.0 / k for k in (1.26e6, 0.92 * 0.95e6, 0.84e6))
    assert out["lo"][-1] * 0.97 < still < out["hi"][-1] * 1.03
    springs = [1.26e6, 0.92 * 0.95e6, 0.84e6]
    true = undamped_modes(assemble(shear_frame((1000.0, 1000.0, 800.0), springs)))
    for said, frequency in zip(body["today"]["frequencies_hz"], true.frequency_hz, strict=True):
        assert said["lo"] * 0.998 < frequency < said["hi"] * 1.002
        # Elements by themselves are known to some percent, what they make together better.
        assert said["sd"] / said["value"] < 0.004
    assert body["today"]["damping_ratios"][0]["value"] == pytest.approx(0.02, rel=0.1)
    assert body["load_unit"] == "N"


@pytest.mark.long
def test_a_model_with_effects_is_run_with_them(serving, ageing, eventually):
    """Friction that holds the load leaves nothing to be heard; without it there is motion."""
    own = serving()
    spring = {"id": "j1", "between": ["base", "m1"], "stiffness_n_per_m": 711.0}
    model: dict[str, Any] = {
        "slowtime_model": 1,
        "nodes": [{"id": "m1", "mass_kg": 2.0}],
        "elements": [spring | {"damping_n_s_per_m": 1.5}],
        "sensors": [
            {"channel": "a", "quantity": "acceleration", "node": "m1", "unit": "m/s^2"}
        ],
    }
    nominal = {"frequency_hz": 3.0, "damping_ratio": 0.02}
    load = {"kind": "harmonic", "amplitude": 2.0, "frequency_hz": 2.0}
    order = {"load": load, "on": "m1", "quantity": "displacement", "duration_s": 2.0}
    order |= {"rate_hz": 100.0, "draws": 20}
    peaks = {}
    for friction in (0.0, 5.0):
        if friction:
            stuck = {"effect": "coulomb", "element": "j1", "friction_n": friction}
            model["effects"] = [stuck]
        body = {"model": model, "nominal": nominal}
        assert own.client.put(TWIN, json=body).status_code in (200, 201)
        if not friction:
            own.feed(ageing(20))
            assert eventually(lambda: own.count() == 20)
        found = asked(own, order)
        peaks[friction] = found["outputs"]["m1"]["peak"]["value"]
        assert ("the structure is linear" in found["assumed"]) == (friction == 0.0)
    assert peaks[0.0] > 2.0 / 711.0
    assert peaks[5.0] < 1e-3 * peaks[0.0]
    long = order | {"duration_s": 190.0, "draws": 300}
    assert "a model with effects" in refused(own, long)[1]


@pytest.mark.parametrize(
    ("order", "status", "says"),
    [
        ({}, 422, "body.load"),
        ({"load": {"kind": "thunder"}}, 422, "harmonic"),
        ({"load": {"kind": "step", "amplitude": float("1e13")}}, 422, "amplitude"),
        ({"load": {"kind": "recorded", "samples": [1.0, 2.0]}}, 422, "Give rate_hz"),
        (
            {"load": {"kind": "recorded", "samples": [1.0] * 3}, "rate_hz": 9, "duration_s": 1},
            422, "Leave duration_s out",
        ),
        (SHAKEN | {"on": "floor9"}, 422, "Allowed: base, mass"),
        (SHAKEN | {"on": "mass"}, 422, "nominal.mass_kg"),
        (SHAKEN | {"outputs": ["roof"]}, 422, "Allowed: mass"),
        (SHAKEN | {"outputs": ["mass", "mass"]}, 422, "Name each once"),
        (SHAKEN | {"duration_s": 1e5}, 422, "Give a shorter duration_s"),
        (SHAKEN | {"duration_s": 0.001}, 422, "Give a longer duration_s"),
        (SHAKEN | {"duration_s": 100.0, "rate_hz": 200.0, "draws": 2000}, 422, "fewer draws"),
        (SHAKEN | {"draws": 1}, 422, "draws"),
        (SHAKEN | {"colour": "red"}, 422, "colour"),
    ],
)  # fmt: skip
def test_an_order_that_cannot_be_run_is_refused_with_what_to_do(server, order, status, says):
    found, detail = refused(server, order)
    assert found == status
    assert says in detail


def test_too_coarse_a_rate_is_said_to_be(server):
    body = asked(server, SHAKEN | {"rate_hz": 5.0, "duration_s": 4.0})
    assert body["valid"] is False
    assert any("samples a period" in reason for reason in body["reasons"])
    assert any("is not seen as it is" in reason for reason in body["reasons"])


def test_a_twin_that_is_still_learning_cannot_be_run(serving, ageing, eventually):
    own = serving()
    assert own.client.put(TWIN, json={"learn_epochs": 50}).status_code == 201
    assert refused(own, SHAKEN)[0] == 409
    own.feed(ageing(5))
    assert eventually(lambda: own.count() == 5)
    status, detail = refused(own, SHAKEN)
    assert status == 409
    assert "still being learnt" in detail
    assert own.client.post("/api/v1/twins/no.twin/simulate", json=SHAKEN).status_code == 404


def test_the_examples_of_the_document_are_orders():
    for example in SIMULATION_EXAMPLES:
        SimulationOrder.model_validate(example)
    simulations.SimulationModel.model_validate(simulations.EXAMPLE)
