"""What needs no integration is exact: linear plants, inputs, sensors, and their faults."""

import dataclasses

import numpy as np
import pytest
import scipy.signal as sps

from slowtime.dynamics.builders import beam, chain
from slowtime.dynamics.description import Input, Sensor, assemble
from slowtime.dynamics.effects import Place, catalogue, force_along
from slowtime.dynamics.plant import Plant
from slowtime.dynamics.simulation import simulate_structure

RATE = 200.0


def three(masses, stiffnesses, dampings):
    return chain(masses, stiffnesses, dampings_n_s_per_m=dampings)


@pytest.mark.parametrize("hold", ["first", "zero"])
def test_without_effects_it_is_the_structure_stepped_exactly(rig, push, hold):
    forces = push(400)
    plant = rig(hold=hold)
    found = plant.simulate(plant.values, forces, RATE)
    loads = np.zeros((400, 3))
    loads[:, 0] = forces[:, 0]
    q, v, a = simulate_structure(assemble(plant.description), loads, RATE, hold=hold)
    truth = np.hstack([q, v, a / 9.80665])
    np.testing.assert_allclose(found, truth, atol=1e-11 * np.abs(truth).max(axis=0).max())


def test_a_beam_on_a_shaking_base_is_stepped_alike():
    bending = beam(1.0, 10.0, 1.0, elements=3, damping_s=1e-3, tip_mass_kg=0.3)
    top = bending.nodes[-1].id
    description = dataclasses.replace(
        bending,
        inputs=(Input(channel="ab", kind="base_acceleration", unit="g"),),
        sensors=(
            Sensor(channel="x", quantity="displacement", node=top, unit="mm"),
            Sensor(
                channel="r",
                quantity="velocity",
                node=top,
                unit="m/s",
                frame="relative_to_base",
            ),
        ),
    )
    shaking = np.random.default_rng(2).standard_normal(300)
    structure = assemble(description)
    force = structure.base_force(9.80665 * shaking)
    q, v, _ = simulate_structure(structure, force, RATE, hold="zero")
    plant = Plant.of(description, hold="zero")
    found = plant.simulate(plant.values, shaking[:, None], RATE)
    k = structure.dof(top)
    np.testing.assert_allclose(found[:, 1], v[:, k], atol=1e-9 * np.abs(v[:, k]).max())
    gained = np.concatenate([[0.0], np.cumsum(9.80665 * shaking[:-1]) / RATE])
    step = gained[:-1] / RATE + 9.80665 * shaking[:-1] / RATE**2 / 2
    base = np.concatenate([[0.0], np.cumsum(step)])
    np.testing.assert_allclose(found[:, 0], 1e3 * (q[:, k] + base), rtol=1e-6, atol=1e-6)


def test_values_move_the_plant_as_the_description_would(rig, push):
    plant, forces = rig(), push(200)
    softer = three([1.9, 2.1, 1.5], [4100.0, 3700.0, 3500.0], [2.3, 2.2, 2.6])
    other = rig(nodes=softer.nodes, elements=softer.elements)
    assert other.parameters == plant.parameters
    np.testing.assert_allclose(
        plant.simulate(other.values, forces, RATE),
        other.simulate(other.values, forces, RATE),
        rtol=1e-10,
        atol=1e-14,
    )
    assert not np.allclose(
        plant.simulate(plant.values, forces, RATE), plant.simulate(other.values, forces, RATE)
    )


def test_numbers_have_names_units_and_tolerances(rig):
    plant = rig({"effect": "coulomb", "element": "k2", "friction_n": 4.1})
    named = dict(zip(plant.parameters, plant.values, strict=True))
    assert named["stiffness", "k2"] == 3900.0
    assert named["effect", 0, "friction_n"] == 4.1
    claimed = dict(zip(plant.parameters, plant.prior_sd, strict=True))
    assert claimed["stiffness", "k2"] == pytest.approx(78.0)
    assert claimed["damping", "k1"] == pytest.approx(0.345)
    assert claimed["mass", "m1"] == 0.0
    assert claimed["effect", 0, "friction_n"] == np.inf
    assert dict(zip(plant.parameters, plant.units, strict=True))["damping", "k1"] == "N s/m"


@pytest.mark.parametrize(
    ("effect", "changed"),
    [
        (
            {"effect": "stiffness_loss", "element": "k2", "dk_n_per_m": 400.0},
            three([1.9, 2.1, 1.7], [4100.0, 3500.0, 3500.0], [2.3, 2.2, 2.0]),
        ),
        (
            {"effect": "viscous_damping", "element": "k2", "dc_n_s_per_m": 1.1},
            three([1.9, 2.1, 1.7], [4100.0, 3900.0, 3500.0], [2.3, 3.3, 2.0]),
        ),
        (
            {"effect": "added_mass", "node": "m2", "dm_kg": 0.4},
            three([1.9, 2.5, 1.7], [4100.0, 3900.0, 3500.0], [2.3, 2.2, 2.0]),
        ),
    ],
)
def test_linear_effects_are_changes_of_the_description(rig, push, effect, changed):
    shaken = (
        Input(channel="ab", kind="base_acceleration", unit="g"),
        Input(channel="u", kind="force", node="m1", unit="N"),
    )
    inputs = np.hstack([0.1 * push(200, seed=2), push(200)])
    plant = rig(effect, inputs=shaken)
    truth = rig(nodes=changed.nodes, elements=changed.elements, inputs=shaken)
    found, other = (p.simulate(p.values, inputs, RATE) for p in (plant, truth))
    np.testing.assert_allclose(found, other, atol=1e-10 * np.abs(other).max(axis=0).max())


def test_a_hidden_mass_is_a_node_that_nobody_listed(push):
    rider = chain([2.0, 0.3], [900.0, 0.3 * (6 * np.pi) ** 2], dampings_n_s_per_m=[2.0, 0.4])
    bare = chain([2.0], [900.0], dampings_n_s_per_m=[2.0])
    effect = {
        "effect": "extra_dof",
        "node": "m1",
        "mass_kg": 0.3,
        "frequency_hz": 3.0,
        "damping_n_s_per_m": 0.4,
    }
    shaken = (Input(channel="ab", kind="base_acceleration", unit="g"),)
    heard = (Sensor(channel="a", quantity="acceleration", node="m1", unit="g"),)
    found, truth = (
        Plant.of(dataclasses.replace(part, inputs=shaken, sensors=heard, effects=effects))
        for part, effects in ((bare, (effect,)), (rider, ()))
    )
    accelerations = push(300)
    assert found.state_names == (
        ("displacement", "m1"),
        ("displacement", "extra_dof 0.1"),
        ("velocity", "m1"),
        ("velocity", "extra_dof 0.1"),
    )
    told, true = (p.simulate(p.values, accelerations, RATE) for p in (found, truth))
    np.testing.assert_allclose(told, true, atol=1e-9)


def test_forces_along_the_motion_explain_the_motion(rig, push):
    """The force of naming and the force of the plant are one: put back as inputs, it fits."""
    effect = {"effect": "cubic_hardening", "element": "k1", "k3_n_per_m3": 1e8}
    plant, forces = rig(effect, hold="band_limited"), push(600)
    seen = plant.states(plant.values, forces, RATE, start_s=3.0)
    assert set(seen) == {
        *(Place("element", f"k{i}") for i in (1, 2, 3)),
        *(Place("node", f"m{i}") for i in (1, 2, 3)),
    }
    force = force_along(
        catalogue()["cubic_hardening"], {"k3_n_per_m3": 1e8}, seen[Place("element", "k1")]
    )
    linear = rig(hold="band_limited")
    found = linear.simulate(linear.values, forces - force[:, None], RATE)
    truth = plant.simulate(plant.values, forces, RATE)
    np.testing.assert_allclose(found, truth, atol=3e-3 * np.abs(truth).max())


def test_a_run_goes_on_from_its_state(rig, push):
    plant = rig({"effect": "coulomb", "element": "k2", "friction_n": 8.0})
    forces = push(400)
    whole = plant.run(plant.values, forces, RATE, start_s=2.0)
    rest = plant.simulate(
        plant.values, forces[150:], RATE, state0=whole.states[150], start_s=2.0 + 150 / RATE
    )
    np.testing.assert_allclose(rest, whole.outputs[150:], atol=1e-7)


@pytest.mark.parametrize(("share", "error"), [(0.05, 1e-6), (0.1, 1e-5), (0.25, 1e-3)])
def test_a_band_limited_input_is_that_of_a_finer_record(share, error):
    """A tone of the given share of the sampling rate, against the same tone sampled finely."""
    one = chain([1.0], [(2 * np.pi * 12.0) ** 2], dampings_n_s_per_m=[2.0])
    description = dataclasses.replace(
        one,
        inputs=(Input(channel="u", kind="force", node="m1", unit="N"),),
        sensors=(Sensor(channel="x", quantity="displacement", node="m1", unit="m"),),
    )
    times = np.arange(600 * 32) / (32 * RATE)
    # Ends softly: what a signal was before its record is not known.
    tone = np.sin(2 * np.pi * share * RATE * times) * sps.windows.tukey(len(times), 0.4)
    fine, whole, straight = (
        Plant.of(description, hold=hold).simulate(
            Plant.of(description).values, tone[::every, None], RATE * 32 / every
        )[:: 32 // every, 0]
        for hold, every in (("first", 1), ("band_limited", 32), ("first", 32))
    )
    # Straight lines even of the fine record lack (pi f / 32 fs)^2 / 3.
    floor = (np.pi * share / 32) ** 2 / 3
    assert np.std(whole - fine) < (error + 2 * floor) * np.std(fine)
    lacks = 1 - np.sinc(share) ** 2
    assert np.std(straight - fine) == pytest.approx(lacks * np.std(fine), rel=0.2)


def test_inputs_are_gained_and_delayed(rig, push):
    gained = rig({"effect": "input_gain", "input": "u", "gain": 0.8})
    plain, forces = rig(), push(400)
    np.testing.assert_allclose(
        gained.simulate(gained.values, forces, RATE),
        plain.simulate(plain.values, 0.8 * forces, RATE),
        atol=1e-12,
    )
    late = rig({"effect": "input_delay", "input": "u", "delay_s": 3 / RATE})
    forces *= sps.windows.tukey(400, 0.3)[:, None]
    truth = plain.simulate(plain.values, np.roll(forces, 3, axis=0), RATE)
    found = late.simulate(late.values, forces, RATE)
    assert (np.std(found - truth, axis=0) < 1e-3 * np.std(truth, axis=0)).all()


def test_sensors_tell_what_their_faults_make_of_the_truth(rig, push):
    plain, forces = rig(), push(400)
    truth = plain.simulate(plain.values, forces, RATE, start_s=5.0)[:, 6]
    times = 5.0 + np.arange(400) / RATE
    clip = float(np.quantile(np.abs(truth), 0.9))
    faults = {
        ("sensor_bias", ("bias", 0.3)): truth + 0.3,
        ("sensor_drift", ("drift_total", 0.3)): truth + 0.3 * times / times[-1],
        ("sensor_gain", ("gain", 1.2)): 1.2 * truth,
        ("sensor_saturation", ("clip", clip)): np.clip(truth, -clip, clip),
    }
    for (name, (key, value)), told in faults.items():
        plant = rig({"effect": name, "sensor": "a_m1", key: value})
        found = plant.simulate(plant.values, forces, RATE, start_s=5.0)
        np.testing.assert_allclose(found[:, 6], told, atol=1e-12)
        others = plain.simulate(plain.values, forces, RATE)[:, :6]
        np.testing.assert_array_equal(found[:, :6], others)


@pytest.mark.parametrize("held", [0, 1])
def test_a_sensor_that_fell_silent_tells_nothing_or_its_last(rig, push, held):
    silent = {"from_s": 1.0, "for_s": 0.5, "held": held}
    plant = rig({"effect": "sensor_dropout", "sensor": "d_m1"} | silent)
    forces = push(400)
    found = plant.simulate(plant.values, forces, RATE)[:, 0]
    truth = rig().simulate(rig().values, forces, RATE)[:, 0]
    np.testing.assert_array_equal(found[200:300], truth[199] if held else 0.0)
    others = np.r_[0:200, 300:400]
    np.testing.assert_array_equal(found[others], truth[others])


def test_a_clock_that_is_fast_reads_what_comes_later(rig):
    times = np.arange(800) / RATE
    forces = 10 * np.sin(2 * np.pi * 3.0 * times)[:, None]
    plant = rig({"effect": "sensor_clock", "sensor": "d_m1", "skew": 0.01})
    found = plant.simulate(plant.values, forces, RATE)[:, 0]
    fine = rig().simulate(rig().values, forces, RATE)[:, 0]
    truth = np.interp(times * 1.01, times, fine)
    inner = times * 1.01 < times[-30]
    assert np.std((found - truth)[inner]) < 3e-3 * np.std(truth)


def test_motion_of_the_base_may_be_given_beside_what_was_measured(rig, push):
    shaken = (Input(channel="ab", kind="base_acceleration", unit="m/s^2"),)
    plant = rig(inputs=shaken)
    both = plant.simulate(plant.values, push(200) + push(200, seed=2), RATE)
    one = plant.simulate(plant.values, push(200), RATE, base=push(200, seed=2)[:, 0])
    np.testing.assert_allclose(one, both, atol=1e-12 * np.abs(both).max())


def test_what_cannot_be_run_is_refused(rig, push):
    plant = rig()
    for values, inputs, rate, says in (
        (plant.values[1:], push(40), RATE, r"8 values were given for 9 parameters"),
        (plant.values, push(40), 0.0, r"rate_hz=0\.0 is not a valid sampling rate"),
        (plant.values, np.zeros((10, 2)), RATE, r"2 columns were given for 1 inputs"),
        (plant.values, np.full((10, 1), np.nan), RATE, r"hold NaN or infinity"),
    ):
        with pytest.raises(ValueError, match=says):
            plant.simulate(values, inputs, rate)
    with pytest.raises(ValueError, match=r"hold='cubic' is not a valid way to hold a signal"):
        rig(hold="cubic").simulate(plant.values, push(40), RATE)
