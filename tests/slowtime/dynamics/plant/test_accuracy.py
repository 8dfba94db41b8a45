"""The plant against scipy's integrator, law by law; and friction from event to event."""

import numpy as np
import pytest

RATE = 200.0


def along(name, **parameters):
    return {"effect": name, "element": "k2"} | parameters


def gap(t, e, v, z):
    return 4000.0 * (max(e - 2e-3, 0.0) + min(e + 2e-3, 0.0))


SMOOTH = {
    "cubic": (along("cubic_hardening", k3_n_per_m3=2e8), lambda t, e, v, z: 2e8 * e**3),
    "gap": (along("gap_symmetric", kg_n_per_m=4000.0, gap_m=2e-3), gap),
    "stop": (
        along("gap_one_sided", kg_n_per_m=4000.0, gap_m=2e-3, side=-1),
        lambda t, e, v, z: 4000.0 * min(e + 2e-3, 0.0),
    ),
    "saturation": (
        along("saturating_stiffness", ks_n_per_m=2000.0, es_m=2e-3),
        lambda t, e, v, z: 2000.0 * (2e-3 * np.tanh(e / 2e-3) - e),
    ),
    "drag": (
        along("quadratic_damping", c2_n_s2_per_m2=90.0),
        lambda t, e, v, z: 90 * abs(v) * v,
    ),
    "song": (
        along("van_der_pol", cn_n_s_per_m=8.0, e0_m=2e-3),
        lambda t, e, v, z: 8.0 * ((e / 2e-3) ** 2 - 1) * v,
    ),
    "pulsation": (
        along("parametric", dk_n_per_m=900.0, frequency_hz=5.0, phase_rad=0.3),
        lambda t, e, v, z: 900.0 * np.cos(10 * np.pi * t + 0.3) * e,
    ),
    "jump": (
        along("stiffness_jump", dk_n_per_m=900.0, t_jump_s=0.8123),
        lambda t, e, v, z: -900.0 * e * (t >= 0.8123),
    ),
    "hysteresis": (
        along("bouc_wen", kh_n_per_m=2000.0, zy_m=1e-3, n=2.0),
        lambda t, e, v, z: 2000.0 * (z[0] - e),
    ),
}


def yielding(t, e, v, z):
    return v * (1 - abs(z[0] / 1e-3) ** 2 * (1 + np.sign(v * z[0])) / 2)


@pytest.mark.parametrize("name", SMOOTH)
def test_motion_is_that_of_another_integrator(rig, reference, push, name):
    effect, force = SMOOTH[name]
    forces = push(240)
    plant = rig(effect)
    found = plant.simulate(plant.values, forces, RATE)[:, :3]
    memory = yielding if name == "hysteresis" else None
    truth = reference(forces).smooth(force, memory)
    linear = rig().simulate(rig().values, forces, RATE)[:, :3]
    assert np.std(linear - truth) > 0.03 * np.std(truth)
    assert np.std(found - truth) < 1e-4 * np.std(truth)


@pytest.mark.parametrize(
    ("effect", "limit", "share"),
    [
        (along("coulomb", friction_n=12.0), lambda v: 12.0, (0.2, 0.8)),
        (
            along("stribeck", friction_n=2.0, static_n=3.5, vs_m_per_s=0.02),
            lambda v: 2.0 + 1.5 * np.exp(-((v / 0.02) ** 2)),
            (0.005, 0.1),
        ),
    ],
)
def test_friction_is_that_from_event_to_event(rig, reference, push, effect, limit, share):
    forces = push(160)
    plant = rig(effect)
    found = plant.simulate(plant.values, forces, RATE)[:, :3]
    truth, stuck = reference(forces).rubbing(limit)
    assert share[0] < stuck < share[1]
    assert np.std(found - truth) < 1e-5 * np.std(truth)


def test_what_sticks_stands_still_to_the_last_digit(rig, push):
    plant = rig(along("coulomb", friction_n=12.0))
    run = plant.run(plant.values, push(2000), RATE)
    speed = run.states[:, 4] - run.states[:, 3]
    stuck = np.abs(speed) < 1e-12 * np.abs(speed).max()
    assert 0.2 < stuck.mean() < 0.8
    held = np.abs(run.forces[stuck, 0])
    assert held.max() <= 12.0 * (1 + 1e-9)
    assert held.std() > 1.0
    np.testing.assert_allclose(np.abs(run.forces[~stuck, 0]), 12.0)
    both = stuck[1:] & stuck[:-1]
    elongation = run.states[:, 1] - run.states[:, 0]
    crept = np.abs(np.diff(elongation))[both]
    assert np.median(crept) < 1e-8 * np.abs(elongation).max()


def test_a_bound_joint_is_one_mass(rig, push):
    """Friction that nothing overcomes makes of two masses one: a chain of two."""
    plant = rig(along("coulomb", friction_n=1e6))
    found = plant.simulate(plant.values, push(1000), RATE)
    np.testing.assert_allclose(found[:, 0], found[:, 1], atol=1e-6 * np.abs(found).max())
    heavy = rig(along("viscous_damping", dc_n_s_per_m=1e9))
    glued = heavy.simulate(heavy.values, push(1000), RATE)
    np.testing.assert_allclose(found[:, :3], glued[:, :3], atol=1e-6 * np.abs(glued).max())


def test_two_frictions_stick_and_slide_by_themselves(rig, push):
    """The second so weak that it changes nothing, wherever it is put into the table."""
    strong = along("coulomb", friction_n=12.0)
    weak = {"effect": "coulomb", "element": "k3", "friction_n": 1e-9}
    alone, first, second = (
        rig(*effects) for effects in ((strong,), (weak, strong), (strong, weak))
    )
    forces = push(600)
    truth = alone.simulate(alone.values, forces, RATE)[:, :3]
    for plant in (first, second):
        found = plant.simulate(plant.values, forces, RATE)[:, :3]
        np.testing.assert_allclose(found, truth, atol=1e-7 * np.abs(truth).max())
    both = rig(strong, strong | {"element": "k3"})
    run = both.run(both.values, forces, RATE)
    speeds = np.diff(run.states[:, 3:6], axis=1)
    assert np.abs(run.forces).max() <= 12.0 * (1 + 1e-9)
    assert (np.abs(speeds) < 1e-12).mean(axis=0).min() > 0.2


def test_half_the_rate_of_samples_costs_no_accuracy(rig, push):
    """Straight lines between samples, split in two, are the same straight lines."""
    for effect in (SMOOTH["gap"][0], SMOOTH["hysteresis"][0], along("coulomb", friction_n=6.0)):
        plant = rig(effect)
        forces = push(600)
        fine = np.empty((2 * len(forces) - 1, 1))
        fine[::2], fine[1::2] = forces, (forces[:-1] + forces[1:]) / 2
        coarse = plant.simulate(plant.values, forces, RATE)[:, :3]
        finer = plant.simulate(plant.values, fine, 2 * RATE)[::2, :3]
        assert np.std(finer - coarse) < 1e-4 * np.std(coarse)


def test_motion_beyond_bounds_ends_in_not_a_number(rig, push):
    plant = rig(along("cubic_softening", k3_n_per_m3=-1e9))
    run = plant.run(plant.values, push(600), RATE)
    assert run.steps < 0
    assert np.isnan(run.outputs[-1]).all()
    assert np.isfinite(run.outputs[: -run.steps]).all()
