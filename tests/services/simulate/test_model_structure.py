"""A structure of a model file, with effects that enter unannounced."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from slowtime_services.descriptions import description_of
from slowtime_services.models import run_model
from slowtime_services.simulate import SimulatedModel, simulated_structure

MODEL: dict[str, Any] = {
    "slowtime_model": 1,
    "nodes": [{"id": "m1", "mass_kg": 2.0}, {"id": "m2", "mass_kg": 1.0}],
    "elements": [
        {
            "id": f"j{i}", "between": between,
            "stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 2.0,
        }
        for i, between in ((1, ["base", "m1"]), (2, ["m1", "m2"]))
    ],
    "inputs": [{"channel": "u", "kind": "force", "node": "m1", "unit": "N"}],
    "sensors": [
        {"channel": "a1", "quantity": "acceleration", "node": "m1", "unit": "m/s^2"},
        {"channel": "x2", "quantity": "displacement", "node": "m2", "unit": "mm"},
    ],
}  # fmt: skip
FRICTION = {"effect": "coulomb", "element": "j2", "friction_n": 0.5}
FIELDS = {
    "kind": "model", "model": MODEL, "effects": [FRICTION], "enters": 2, "leaves": 4,
    "seconds": 8.0, "rate_hz": 100.0, "input_rms": 3.0, "band_hz": (1.0, 20.0),
    "interval_s": 8.0, "sensor": {"noise": 0.01, "dtype": "<f8"},
}  # fmt: skip


def made(**changes):
    return simulated_structure({**FIELDS, **changes})


def test_inputs_travel_beside_what_they_make_the_sensors_show():
    structure = made(sensor={"noise": 0.0, "dtype": "<f8"})
    (block,) = structure.epoch(0)
    assert block.channels == ("a1", "x2", "u")
    assert block.units == ("m/s^2", "mm", "N")
    force = block.samples[:, 2]
    assert force.std() == pytest.approx(3.0)
    described = description_of(structure.model)
    again = run_model(described, {"u": force}, 100.0, hold="band_limited")
    np.testing.assert_allclose(block.samples[:, 0], again["a1"], atol=1e-9)
    np.testing.assert_allclose(block.samples[:, 1], again["x2"], atol=1e-9)


def test_effects_are_there_from_the_epoch_they_enter_to_the_one_they_leave():
    without = made(effects=())
    same = [
        np.array_equal(one.samples, other.samples)
        for number in range(6)
        for one, other in zip(made().epoch(number), without.epoch(number), strict=True)
    ]
    assert same == [True, True, False, False, True, True]
    told = [made().truth(number)["effects"] for number in range(6)]
    assert told == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def test_an_epoch_is_the_same_whether_or_not_others_were_asked_for():
    structure = made()
    structure.epoch(0)
    np.testing.assert_array_equal(structure.epoch(3)[0].samples, made().epoch(3)[0].samples)


def test_noise_is_a_share_of_what_a_sensor_shows_and_inputs_have_none():
    clean, noisy = (
        made(sensor={"noise": 0.0}).epoch(1)[0],
        made(sensor={"noise": 0.1}).epoch(1)[0],
    )
    noise = (noisy.samples - clean.samples).std(axis=0)
    assert noise[:2] / clean.samples.std(axis=0)[:2] == pytest.approx(0.1, rel=0.5)
    assert noise[2] == 0.0


def test_age_and_temperature_act_on_the_stiffness_and_are_told_as_the_truth():
    ageing = {"kind": "linear", "rate": -0.01, "limit": -0.5}
    warm = {"swing_c": 10.0, "period": 8.0, "mean_c": 12.0, "stiffness_per_c": -0.002}
    structure = made(
        effects=(), stiffness={"j1": ageing}, temperature=warm,
        sensor={"noise": 0.0, "dtype": "<f8"},
    )  # fmt: skip
    truth = structure.truth(2)
    assert truth["lasting.element.j1"] == pytest.approx(-0.02)
    assert truth["lasting.element.j2"] == 0.0
    assert truth["element.j1"] == pytest.approx(0.98 * 0.98 - 1.0)  # 22 °C: a quarter period
    assert truth["element.j2"] == pytest.approx(-0.02)
    (block,) = structure.epoch(2)
    assert block.covariates["temperature_c"] == pytest.approx(22.0)
    elements = [
        element | {"stiffness_n_per_m": 4000.0 * (1.0 + truth[f"element.{element['id']}"])}
        for element in MODEL["elements"]
    ]
    same = made(
        model=MODEL | {"elements": elements}, effects=(), sensor={"noise": 0.0, "dtype": "<f8"}
    )
    np.testing.assert_allclose(block.samples, same.epoch(2)[0].samples, atol=1e-9)


def test_a_renewal_of_an_element_is_counted():
    renewed = {"j1": {"kind": "linear", "rate": -0.01, "renewed_after": 2.0}}
    assert [made(stiffness=renewed).renewals(number) for number in (0, 1, 2, 5)] == [0, 0, 1, 2]
    assert made().renewals(5) is None


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"model": {**MODEL, "inputs": []}}, "no inputs"),
        ({"effects": [{"effect": "coulumb", "element": "j2"}]}, "coulumb"),
        ({"effects": [{**FRICTION, "element": "j9"}]}, "j9"),
        ({"rate_hz": 12.0}, "Sample faster"),
    ],
)
def test_what_cannot_be_run_is_refused(changes, says):
    with pytest.raises(ValidationError, match=says):
        SimulatedModel(**{**FIELDS, **changes})
